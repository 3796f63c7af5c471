"""Strokes again and again: no drift, nothing left of a way back, nothing lost from the surface."""

from __future__ import annotations

import numpy as np

from ..brush import bump, centres
from ..characters import L, Rig
from ..lab import Lab
from ..measure import apart
from ..session import Session

STROKES = 20
SIZE = 0.01
PLACES = 3
OTHER = range(100, 104)


def others(session: Session) -> np.ndarray:
    """The surface in poses that nobody sculpts, [poses,V,3]."""
    return np.array([session.evaluate(session.bend(seed)) for seed in OTHER])


def drift(session: Session, pose: str, vertices: np.ndarray, targets: np.ndarray) -> float:
    """Mean change of the other poses after 20 strokes to one target, against after one."""
    begin = others(session)
    changes = []
    for _ in range(STROKES):
        session.stroke(pose, vertices, targets, pin="set")
        changes.append(apart(others(session), begin).mean() if len(changes) in (0, STROKES - 1)
                       else 0.0)
    session.undo(STROKES)
    return float(changes[-1] / changes[0])


def out_and_back(session: Session, pose: str, vertices: np.ndarray, targets: np.ndarray,
                 pin: str) -> tuple[float, float]:
    """Ten strokes out and ten back: the largest distance left over L, in the edited pose and in
    others.

    `set`: the tool tells where it wants the surface; `move`: each stroke begins from what is shown.
    """
    begin = np.concatenate([session.evaluate(pose)[None], others(session)])
    way = (targets - begin[0, vertices]) / 10
    for turn in range(20):
        if pin == "move":
            step = session.evaluate(pose, vertices) + (way if turn < 10 else -way)
        else:
            step = begin[0, vertices] + (turn + 1 if turn < 10 else 19 - turn) * way
        session.stroke(pose, vertices, step, pin=pin)
    end = np.concatenate([session.evaluate(pose)[None], others(session)])
    session.undo(20)
    left = apart(end, begin) / L
    return float(left[0].max()), float(left[1:].max())


def kept(session: Session, pose: str, vertices: np.ndarray, targets: np.ndarray) -> float:
    """Share of one stroke's change that 20 smaller ones keep, each from the shown surface."""
    begin = session.evaluate(pose, vertices)
    session.stroke(pose, vertices, targets)
    once = session.evaluate(pose, vertices) - begin
    session.undo()
    for _ in range(STROKES):
        step = session.evaluate(pose, vertices) + (targets - begin) / STROKES
        session.stroke(pose, vertices, step, pin="move")
    change = session.evaluate(pose, vertices) - begin
    session.undo(STROKES)
    return float(np.vdot(change, once) / np.vdot(once, once))


def measure(lab: Lab, rigs: list[Rig]) -> dict:
    """20 strokes to one target against one stroke; 10 out and 10 back: what is left; 20 strokes,
    each from the shown surface: share of the sculpted change kept against one stroke.

    What is left after 10 out and 10 back is the largest in any pose where each stroke tells its
    target; and in the edited pose where each stroke begins from the surface shown. In the latter
    case other poses show more (detail): what is shown is float32 twenty times over.
    """
    drifts, left, shown, shares = {}, {}, {}, {}
    for rig in rigs:
        lab.say(f"repeated strokes: {rig.name}")
        with Session(lab, rig) as session:
            pose = session.bend(0)
            surface = session.evaluate(pose)
            found = []
            for number, centre in enumerate(centres(rig, PLACES)):
                press = bump(rig, surface, centre, SIZE * (-1) ** number)
                stroke = (session, pose, press.vertices, press.targets)
                told, moved = out_and_back(*stroke, "set"), out_and_back(*stroke, "move")
                found.append((drift(*stroke), max(*told, moved[0]), moved[1], kept(*stroke)))
        columns = list(zip(*found))
        drifts[rig.name], left[rig.name] = max(columns[0]), max(columns[1])
        shown[rig.name], shares[rig.name] = max(columns[2]), min(columns[3])
    return {"figures": {"drift20": max(drifts.values()), "out_and_back_over_L": max(left.values()),
                        "fix_kept20": min(shares.values())},
            "detail": {"drift20_by_character": drifts, "out_and_back_by_character": left,
                       "out_and_back_shown_other_poses": shown, "fix_kept20_by_character": shares}}
