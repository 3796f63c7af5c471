"""The figures to reach: what each is about, what is wanted, what it needs, who measures it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable

from . import guarding, noise, reduction, repeated, rest, strokes, winning


@dataclass(frozen=True)
class Figure:
    key: str
    wanted: float
    text: str
    measure: Callable
    needs: tuple[str, ...] = ()
    at_least: bool = False

    def is_reached(self, value: float) -> bool:
        return value >= self.wanted if self.at_least else value <= self.wanted


FIGURES = (
    Figure("worse_vertices", 0, "vertices farther from their target than before",
           strokes.measure_worse, ("slots.evidence",)),
    Figure("bumps_cm_vs_thesis_max", 0.9, "edit error of bumps against the thesis, worst character",
           strokes.measure_bumps, ("stiffness.auto", "residuals", "slots.evidence")),
    Figure("bumps_cm_vs_thesis_median", 0.6, "the same, median character",
           strokes.measure_bumps, ("stiffness.auto", "residuals", "slots.evidence")),
    Figure("evidence4_vs_hop_max", 0.1, "unseen error of slots by evidence against hop padding",
           winning.measure_evidence, ("pins", "slots.evidence")),
    Figure("evidence4_vs_hop_geomean", 0.01, "the same, geometric mean",
           winning.measure_evidence, ("pins", "slots.evidence")),
    Figure("evidence4_rms_over_L_max", 1e-4, "true bones removed: RMS in unseen poses / L",
           winning.measure_evidence, ("pins", "slots.evidence")),
    Figure("guard_p99_max", 0.8, "change of other poses at equal edit error, against no guard",
           guarding.measure, ("guards", "slots.evidence")),
    Figure("drift20", 1.001, "change of other poses, 20 strokes to one target against one",
           repeated.measure, ("pins",)),
    Figure("out_and_back_over_L", 1e-6, "10 strokes out and 10 back: what is left / L",
           repeated.measure, ("pins",)),
    Figure("fix_kept20", 0.98, "share of a fix that 20 strokes from the shown surface keep",
           repeated.measure, ("pins",), at_least=True),
    Figure("guard32_cost", 2.5, "time with 32 guard poses against none",
           guarding.measure_cost, ("guards",)),
    Figure("refit_unseen_rms_over_L_max", 1e-4, "refit from 8 poses: RMS in unseen poses / L",
           winning.measure_refit, ("refit",)),
    Figure("noise_fine_meshes", 0.7, "noisy brush, smoothing on: error in other poses against none",
           noise.measure, ("smoothing",)),
    Figure("rest4_vs_weights_max", 0.1, "rest positions too: unseen error against weights only",
           rest.measure, ("pins", "residual.rest")),
    Figure("reduce4_clips", 0.25, "cut to 4 influences by posed error against by size, clips",
           reduction.measure, ("reduce",)),
    Figure("reduce4_random", 0.75, "the same with random poses added, on clips and random poses",
           reduction.measure, ("reduce",)),
)
