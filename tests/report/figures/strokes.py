"""Single bumps that weights cannot reach: against the thesis, and whether anything gets worse."""

from __future__ import annotations

import numpy as np

from ..brush import bumps
from ..characters import L, Rig
from ..damage import DAMAGES
from ..lab import Lab
from ..measure import apart
from ..session import UNITS, Session

PLACES = 6
FILLS = ("hop", "infect", "neighbours", "none")
ROUNDING = 5e-7 * L  # float32 positions and weights: a vertex that moved by less did not


WAYS = {"thesis": {"method": "thesis"}, "slots kept": {"slots": "keep"},
        "slots by evidence": {"slots": "evidence"}}


def measure_bumps(lab: Lab, rigs: list[Rig]) -> dict:
    """Unreachable bumps, cm scene, 4 slots: the edit error (mean distance to where the brush put
    vertices) against the thesis's method, each stroke from the session's start.

    The figure is that of the exact method with four slots chosen by evidence; what it reaches in
    the slots that the thesis's method has too is told beside it. Stiffness is the daemon's choice.
    """
    ratios: dict[str, dict] = {name: {} for name in WAYS if name != "thesis"}
    for rig in rigs:
        lab.say(f"bumps against the thesis: {rig.name}")
        sums = dict.fromkeys(WAYS, 0.0)
        with Session(lab, rig, "cm") as session:
            for seed in range(2):
                pose = session.bend(seed)
                for press in bumps(rig, session.evaluate(pose), PLACES):
                    for name, options in WAYS.items():
                        answer = session.stroke(pose, press.vertices, press.targets, **options)
                        sums[name] += float(answer["residuals"].sum()) / session.scale
                        session.undo()
        for name in ratios:
            ratios[name][rig.name] = sums[name] / sums["thesis"]
    chosen, same = (list(ratios[name].values()) for name in ("slots by evidence", "slots kept"))
    return {"figures": {"bumps_cm_vs_thesis_max": max(chosen),
                        "bumps_cm_vs_thesis_median": float(np.median(chosen))},
            "detail": {"bumps_cm_vs_thesis": ratios,
                       "bumps_cm_vs_thesis_slots_kept_max": max(same),
                       "bumps_cm_vs_thesis_slots_kept_median": float(np.median(same))}}


def count_worse(session: Session, pose: str, vertices: np.ndarray, targets: np.ndarray,
                **options: object) -> tuple[int, float]:
    """How many vertices one stroke takes away from their targets, and the farthest; undone."""
    before = apart(session.evaluate(pose, vertices), targets)
    session.stroke(pose, vertices, targets, **options)
    excess = apart(session.evaluate(pose, vertices), targets) - before
    session.undo()
    return int((excess > ROUNDING).sum()), float(excess.max())


def measure_worse(lab: Lab, rigs: list[Rig]) -> dict:
    """Vertices farther from the target than before (one target, session's start, all slot rules).

    Slot rules: the four that fill free slots with slots kept, and slots by evidence. Strokes: bumps
    in metres, centimetres and millimetres; and the truth's whole surface on each damaged rig.
    """
    rules = [(fill, "keep") for fill in FILLS] + [("neighbours", "evidence")]
    worse, seen, farthest, thesis = 0, 0, 0.0, 0
    for rig in rigs:
        lab.say(f"worse vertices: {rig.name}")
        for unit in UNITS:
            for fill, slots in rules:
                with Session(lab, rig, unit, fill=fill) as session:
                    pose = session.bend(0)
                    for press in bumps(rig, session.evaluate(pose), PLACES if unit == "m" else 2):
                        count, most = count_worse(session, pose, press.vertices, press.targets,
                                                  slots=slots)
                        worse, farthest = worse + count, max(farthest, most)
                        seen += len(press.vertices)
                        if unit == "cm" and (fill, slots) == ("neighbours", "keep"):
                            thesis += count_worse(session, pose, press.vertices, press.targets,
                                                  method="thesis")[0]
        with Session(lab, rig) as session:
            target = session.evaluate(session.bend(0))
        for damage in DAMAGES.values():
            for fill, slots in rules:
                with Session(lab, damage(rig), fill=fill) as session:
                    everything = np.arange(len(target))
                    count, most = count_worse(session, session.bend(0), everything, target,
                                              slots=slots)
                    worse, seen, farthest = worse + count, seen + len(target), max(farthest, most)
    return {"figures": {"worse_vertices": worse},
            "detail": {"worse_vertices_of": seen, "worse_farthest_over_L": farthest / L,
                       "worse_vertices_thesis_cm": thesis}}
