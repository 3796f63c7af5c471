"""Fewer influences: those that move the surface least, against the largest four."""

from __future__ import annotations

import numpy as np

from ..characters import MANY_INFLUENCES, NO_BONE, Rig, load
from ..lab import ASSETS, Lab
from ..measure import apart
from ..session import Session

USED_BENDS, OTHER_BENDS = range(16), range(100, 116)


def reduced_error(session: Session, truth: dict, vertices: np.ndarray, **how: object) -> dict:
    """Mean distance to the surface of all influences, by pose; the reduction is undone."""
    session.call("weights.reduce", influences=4, **how)
    found = {pose: float(apart(session.evaluate(pose, vertices), truth[pose][vertices]).mean())
             for pose in truth}
    session.undo()
    return found


def measure(lab: Lab, rigs: list[Rig]) -> dict:
    """MakeHuman's vertices of more than four influences, cut to four: posed error (mean) against
    keeping the largest four.

    reduce4_clips: the daemon is given every other frame of the clips, the rest is measured.
    reduce4_random: it is given these frames and 16 random poses of 25 degrees; measured are the
    other frames and 16 other random poses, and the worse of the two ratios counts. The truth has
    eight influences a vertex (the file's 14 vertices of nine lose their smallest).
    """
    path = ASSETS / MANY_INFLUENCES
    if not path.exists():
        return {"figures": {}, "detail": {}}
    lab.say("influences reduced to four: makehuman")
    rig = load(lab, "makehuman", path, influences=8)
    many = np.flatnonzero(((rig.joints != NO_BONE) & (rig.weights > 0)).sum(axis=1) > 4)
    with Session(lab, rig, influences=8) as session:
        frames = [session.set_frame(index) for index in range(len(rig.frames))]
        used, other = frames[0::2], frames[1::2]
        bends = [session.bend(seed) for seed in USED_BENDS]
        randoms = [session.bend(seed) for seed in OTHER_BENDS]
        truth = {pose: session.evaluate(pose) for pose in other + randoms}
        size = reduced_error(session, truth, many, by="size")
        clips = reduced_error(session, truth, many, by="poses", poses=used)
        both = reduced_error(session, truth, many, by="poses", poses=used + bends)

    def ratio(found: dict, poses: list[str]) -> float:
        return sum(found[pose] for pose in poses) / sum(size[pose] for pose in poses)

    return {"figures": {"reduce4_clips": ratio(clips, other),
                        "reduce4_random": max(ratio(both, other), ratio(both, randoms))},
            "detail": {"reduce4_vertices": len(many),
                       "reduce4_random_on_clips": ratio(both, other),
                       "reduce4_random_on_random": ratio(both, randoms),
                       "reduce4_clips_on_random": ratio(clips, randoms)}}
