"""A session of the daemon, in one of the scenes: metres, centimetres or millimetres.

Whatever goes in or comes out is in metres; only the daemon sees the scene's unit.
"""

from __future__ import annotations

import numpy as np

from .characters import NO_BONE, Rig, rescaled
from .lab import Lab

UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}


class Session:
    """`with Session(lab, rig) as session:` begins with the rig's weights, closes at the end."""

    def __init__(self, lab: Lab, rig: Rig, unit: str = "m", influences: int = 4,
                 fill: str = "neighbours", **options: object) -> None:
        self.lab, self.rig, self.scale = lab, rig, UNITS[unit]
        self.name = lab.new_name()
        kept = (rig.joints != NO_BONE) & (rig.weights > 0)
        self.made = lab.call(
            "session.create", name=self.name, influences=influences, fill=fill,
            positions=(rig.positions * self.scale).astype(np.float32), triangles=rig.triangles,
            bones={"parents": rig.parents.astype(np.int32), "names": rig.names,
                   "binds": rescaled(rig.binds, self.scale).reshape(-1, 16)},
            influence_offsets=np.concatenate([[0], np.cumsum(kept.sum(1))]).astype(np.uint32),
            influence_joints=rig.joints[kept].astype(np.uint16),
            influence_weights=rig.weights[kept].astype(np.float32), **options)
        self.length = self.made["length"] / self.scale

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.call("session.close")

    def call(self, request: str, **params: object) -> dict:
        return self.lab.call(request, session=self.name, **params)

    def bend(self, seed: int, degrees: float = 25.0) -> str:
        """A pose with every joint turned; its name."""
        self.call("pose.set", pose=f"bend {seed}", bend=degrees, seed=seed)
        return f"bend {seed}"

    def set_frame(self, index: int) -> str:
        """A frame of the character's clips as a pose; its name."""
        matrices = rescaled(self.rig.frames[index], self.scale)
        self.call("pose.set", pose=f"frame {index}", matrices=matrices.reshape(-1, 16))
        return f"frame {index}"

    def evaluate(self, pose: str, vertices: np.ndarray | None = None) -> np.ndarray:
        """The surface in a pose [n,3] f64, metres."""
        some = {} if vertices is None else {"vertices": vertices.astype(np.uint32)}
        return self.call("pose.evaluate", pose=pose, **some)["positions"].astype(float) / self.scale

    def stroke(self, pose: str, vertices: np.ndarray, positions: np.ndarray,
               **options: object) -> dict:
        """Applies targets [n,3] (metres) of vertices [n]."""
        return self.call("stroke.apply", pose=pose, vertices=vertices.astype(np.uint32),
                         positions=(positions * self.scale).astype(np.float32), stream=False,
                         **options)

    def undo(self, steps: int = 1) -> None:
        for _ in range(steps):
            self.call("history.undo")
