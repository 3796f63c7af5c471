"""A body that no weights can make of another: rest positions that move, against weights only."""

from __future__ import annotations

from dataclasses import replace

from ..brush import swollen
from ..characters import Rig
from ..damage import DAMAGES
from ..lab import Lab
from ..session import Session
from .winning import SEEN, UNSEEN, sculpt, truth, unseen_error

STARTS = {"own weights": lambda rig: rig, **DAMAGES}
TOLD_ONLY = "nearest bone"


def error(lab: Lab, start: Rig, wanted: dict, slots: str, residual: str) -> float:
    """Mean error in unseen poses after four strokes in four poses."""
    with Session(lab, start) as session:
        sculpt(session, wanted, SEEN[:1], slots=slots)  # one pose cannot tell weights from rest
        sculpt(session, wanted, SEEN[1:], slots=slots, residual=residual)
        return float(unseen_error(session, wanted).mean())


def measure(lab: Lab, rigs: list[Rig]) -> dict:
    """Rest offsets with 4 poses: mean error in unseen poses against weights only.

    The targets are another body (swollen and shrunk along its normals by up to 1 % of L) on the
    same bones; the session has the first body, with its own weights, with smoothed ones, and with
    true bones removed. Slots by evidence and moving rest positions are held against weights only,
    with slots kept or by evidence, whichever is better. Weights that are nothing but the nearest
    bone are told and not counted: four poses do not tell so much from so little.
    """
    cases = []
    for rig in rigs:
        lab.say(f"rest positions: {rig.name}")
        wanted = truth(lab, replace(rig, positions=swollen(rig)), [*SEEN, *UNSEEN])
        for name, damage in STARTS.items():
            start = damage(rig)
            weights = min(error(lab, start, wanted, slots, "report")
                          for slots in ("keep", "evidence"))
            rest = error(lab, start, wanted, "evidence", "rest")
            cases.append({"character": rig.name, "start": name, "weights": weights, "rest": rest,
                          "ratio": rest / weights, "counts": name != TOLD_ONLY})
    return {"figures": {"rest4_vs_weights_max":
                        max(case["ratio"] for case in cases if case["counts"])},
            "detail": {"rest_cases": cases}}
