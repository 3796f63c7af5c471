"""Method by method: the error in the edited pose and in poses that nobody sculpted.

Two jobs on each character, in scenes of metres, centimetres and millimetres:

    weights won back   weights with true bones removed; the artist sculpts what the rig's own do
    bumps              the rig's own weights; the artist wants bumps of 1 % of L at its joints, the
                       same on the body in every pose, which weights alone cannot make

An error is the distance to what the artist wants, over the vertices that are sculpted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .brush import RADIUS, centres, normals, reach_of
from .characters import L, Rig
from .damage import bones_removed
from .lab import Lab
from .measure import apart, statistics
from .session import UNITS, Session

EDITED = 0
PINNED = (1, 2, 3)
GUARDS = range(200, 232)
OTHERS = range(100, 106)
BUMPS, BUMP_SIZE = 6, 0.01

# (name, sculpted in three more poses, guard poses, options of each stroke)
METHODS = (
    ("thesis", False, False, {"method": "thesis"}),
    ("exact", False, False, {}),
    ("exact + guard", False, True, {"guard": 0.3}),
    ("exact + pins", True, False, {}),
    ("+ slots", True, False, {"slots": "evidence"}),
    ("+ smooth", True, False, {"slots": "evidence", "smooth": 0.003}),
    ("+ rest", True, False, {"slots": "evidence", "residual": "rest"}),
)


def jobs(rig: Rig) -> dict[str, tuple[Rig, Rig, np.ndarray]]:
    """(what the artist wants, what the session begins with, vertices sculpted) by job."""
    everything = np.arange(len(rig.positions))
    positions, outward = rig.positions.copy(), normals(rig, rig.positions)
    touched = np.zeros(len(positions), bool)
    for number, centre in enumerate(centres(rig, BUMPS)):
        vertices, falloff = reach_of(rig.positions, centre, RADIUS)
        way = BUMP_SIZE * L * (-1) ** number * falloff[:, None] * outward[vertices]
        positions[vertices] += np.where(touched[vertices, None], 0, way)
        touched[vertices] = True
    return {"weights won back": (rig, bones_removed(rig), everything),
            "bumps": (replace(rig, positions=positions), rig, np.flatnonzero(touched))}


def surfaces(lab: Lab, rig: Rig) -> dict[int, np.ndarray]:
    with Session(lab, rig) as session:
        return {seed: session.evaluate(session.bend(seed)) for seed in (EDITED, *PINNED, *OTHERS)}


def errors(session: Session, wanted: dict, vertices: np.ndarray) -> dict:
    """The statistics of the edited pose and of the others as they are now, in metres."""
    def error(seed: int) -> np.ndarray:
        return apart(session.evaluate(session.bend(seed), vertices), wanted[seed][vertices])

    return {"edited": statistics(error(EDITED)),
            "other": statistics(np.array([error(seed) for seed in OTHERS]))}


def solve(session: Session, wanted: dict, vertices: np.ndarray, pinned: bool, guarded: bool,
          options: dict) -> dict:
    """The errors after one method's strokes."""
    if guarded:
        session.call("guard.set", poses=[session.bend(seed) for seed in GUARDS], count=32)
    for number, seed in enumerate((EDITED, *PINNED) if pinned else (EDITED,)):
        # From one pose rest positions cannot be told; they move from the second on.
        some = {name: value for name, value in options.items() if name != "residual" or number}
        session.stroke(session.bend(seed), vertices, wanted[seed][vertices], **some)
    return errors(session, wanted, vertices)


def measure(lab: Lab, rigs: list[Rig]) -> dict:
    """{character: {job: {unit: {method: {edited|other: statistics}}}}}, metres of L = 2 m."""
    found: dict = {}
    for rig in rigs:
        lab.say(f"tables: {rig.name}")
        for job, (body, start, vertices) in jobs(rig).items():
            wanted = surfaces(lab, body)
            for unit in UNITS:
                rows = found.setdefault(rig.name, {}).setdefault(job, {}).setdefault(unit, {})
                with Session(lab, start, unit) as session:
                    rows["before"] = errors(session, wanted, vertices)
                for name, pinned, guarded, options in METHODS:
                    with Session(lab, start, unit) as session:
                        rows[name] = solve(session, wanted, vertices, pinned, guarded, options)
    return found
