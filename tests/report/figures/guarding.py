"""Guard poses: what they save in other poses at equal edit error, and what they cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..brush import Bump, bump, centres
from ..characters import FINE, Rig, load
from ..lab import ASSETS, Lab
from ..measure import apart, bisect
from ..session import Session

PLACES = 6
SIZES = (0.01, 0.02)
SOFTEST, STIFFEST = 1e-5, 3.0
COST_ROUNDS = 5


@dataclass(frozen=True)
class Setting:
    """How the guard is used; the last of SETTINGS is the one that the figure is about."""

    slots: str
    poses: int
    strength: float

    def __str__(self) -> str:
        return f"slots {self.slots}, {self.poses} poses, λ = {self.strength:g}"


SETTINGS = (Setting("keep", 8, 0.3), Setting("keep", 32, 1.0), Setting("evidence", 32, 0.3),
            Setting("evidence", 32, 1.0))


def changes(session: Session, poses: list[str], begin: dict, vertices: np.ndarray) -> np.ndarray:
    """How far a stroke moved the surface in poses that should have stayed as they were."""
    return np.concatenate([apart(session.evaluate(pose, vertices), begin[pose][vertices])
                           for pose in poses])


def compare(session: Session, pose: str, press: Bump, others: list[str], begin: dict,
            setting: Setting) -> tuple[np.ndarray, np.ndarray]:
    """Changes of the other poses with the guard, and without it at the same edit error."""
    def stroke(**options: object) -> float:
        answer = session.stroke(pose, press.vertices, press.targets, slots=setting.slots, **options)
        return float(answer["residual"]["after"]["mean"])

    def free_error(stiffness: float) -> float:
        error = stroke(stiffness=stiffness, guard=0.0)
        session.undo()
        return error

    wanted = stroke(guard=setting.strength)
    guarded = changes(session, others, begin, press.vertices)
    session.undo()
    stroke(stiffness=bisect(SOFTEST, STIFFEST, wanted, free_error, 10), guard=0.0)
    free = changes(session, others, begin, press.vertices)
    session.undo()
    return guarded, free


def measure_rig(lab: Lab, rig: Rig, setting: Setting) -> tuple[float, float]:
    """99th percentile and largest change in other poses, each against no guard."""
    with Session(lab, rig) as session:
        frames = [session.set_frame(index) for index in range(len(rig.frames))]
        session.call("guard.set", poses=frames[0::2], count=setting.poses)
        others = frames[1::2]
        begin = {pose: session.evaluate(pose) for pose in others}
        pairs = []
        for seed in range(3):
            pose = session.bend(seed)
            surface = session.evaluate(pose)
            for number, centre in enumerate(centres(rig, PLACES)):
                press = bump(rig, surface, centre, SIZES[number % 2] * (-1) ** (number // 2))
                pairs.append(compare(session, pose, press, others, begin, setting))
    guarded, free = (np.concatenate(side) for side in zip(*pairs))
    return (float(np.percentile(guarded, 99) / np.percentile(free, 99)),
            float(guarded.max() / free.max()))


def measure(lab: Lab, rigs: list[Rig]) -> dict:
    """At equal edit error, characters with clips: 99th percentile in other poses against no guard.

    Bumps are sculpted where bones bend, in three poses of 25 degrees. Of the clips' frames every
    other one is a candidate for the guard; the rest are the poses in which the change that a stroke
    makes is measured. With the guard the daemon chooses the stiffness; without it each stroke gets
    the stiffness at which its own edit error is the same, found by bisection. The figure is that of
    slots by evidence, 32 poses and a strength of 1; other settings are told.
    """
    table = {str(setting): {} for setting in SETTINGS}
    largest = {}
    for rig in rigs:
        if not rig.frames:
            continue
        lab.say(f"guard: {rig.name}")
        for setting in SETTINGS:
            table[str(setting)][rig.name], largest[rig.name] = measure_rig(lab, rig, setting)
    last = table[str(SETTINGS[-1])]
    return {"figures": {"guard_p99_max": max(last.values())} if last else {},
            "detail": {"guard_p99": table, "guard_largest": largest}}


def measure_cost(lab: Lab, rigs: list[Rig]) -> dict:
    """32 guard poses against none: the daemon's own time to solve the largest character there is,
    at one stiffness; medians of alternating strokes over the whole surface."""
    rig = rigs[0] if lab.quick else max(rigs, key=lambda rig: len(rig.positions))
    if not lab.quick and (ASSETS / FINE).exists():
        rig = load(lab, "makehuman, subdivided", ASSETS / FINE)
    lab.say(f"what a guard costs: {rig.name}, {len(rig.positions)} vertices")
    times = {0: [], 32: []}
    with Session(lab, rig) as session:
        pose = session.bend(0)
        guards = [session.bend(seed) for seed in range(1, 41)]
        everything = np.arange(len(rig.positions))
        targets = session.evaluate(pose) * 1.01
        for _ in range(COST_ROUNDS):
            for count in times:
                session.call("guard.set", **({"poses": guards, "count": count} if count else {}))
                answer = session.stroke(pose, everything, targets, stiffness=0.008, pin="none")
                times[count].append(answer["ms"]["solve"])
                session.undo()
    medians = {count: float(np.median(found)) for count, found in times.items()}
    return {"figures": {"guard32_cost": medians[32] / medians[0]},
            "detail": {"guard32_ms": medians[32], "guard0_ms": medians[0],
                       "guard_cost_vertices": len(rig.positions)}}
