# SPDX-License-Identifier: GPL-3.0-or-later
"""What a session is made from, and the spaces that a tool's mesh and a session's may differ in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .skin import NO_BONE, deformations
from .state import NONE, Change


@dataclass(frozen=True)
class Rig:
    """A tool's skinned mesh. B bones, V vertices, E influences; all in one space, the mesh's."""

    positions: np.ndarray  # f32 [V,3] rest, the tool's own bits
    triangles: np.ndarray  # u32 [T,3]
    names: list[str]  # bones that deform, parents before children
    parents: np.ndarray  # i32 [B] nearest deforming ancestor, -1: none
    binds: np.ndarray  # f64 [B,4,4] bone at rest -> mesh space
    offsets: np.ndarray  # u32 [V+1] influences of vertex v: offsets[v]:offsets[v + 1]
    joints: np.ndarray  # u16 [E]
    weights: np.ndarray  # f32 [E] as painted, not normalised; no zeros
    unweighted: np.ndarray  # bool [V] too little weight: no bone moves these, and no stroke can

    def params(self) -> dict:
        """As session.create takes it."""
        return {"positions": self.positions, "triangles": self.triangles,
                "bones": {"names": self.names, "parents": self.parents, "binds": self.binds},
                "influence_offsets": self.offsets, "influence_joints": self.joints,
                "influence_weights": self.weights}


# How Blender and others with z up show a glTF file, which has y up: (x, y, z) -> (x, -z, y).
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


class Space:
    """A session's bones and axes as the tool's.

    turn f64 [4,4]: mesh space to the session's. bones i64 [b]: which of the tool's bones each of
    the session's is. A session made from the tool's own rig has both as they are.
    """

    def __init__(self, rig: Rig, names: list[str] | None = None,
                 inverse_binds: np.ndarray | None = None, turn: np.ndarray | None = None,
                 start: np.ndarray | None = None) -> None:
        """`start` f32 [V,3]: the session's rest positions as it began."""
        self._rest = rig.positions
        self._start = rig.positions if start is None else start
        self.names = rig.names if names is None else names
        self.bones = np.array([rig.names.index(name) for name in self.names], np.int64)
        self._own = rig.binds
        self._binds = rig.binds if inverse_binds is None else np.linalg.inv(inverse_binds)
        self.turn = np.eye(4) if turn is None else turn
        self._is_own = names is None

    def pose(self, pose: np.ndarray) -> np.ndarray:
        """The tool's pose [B,4,4], bone to mesh, as the session's pose [b,4,4].

        Bones may point elsewhere in either at rest, so what is kept is how each deforms:
        pose' = T D T^-1 bind'.
        """
        if self._is_own:
            return pose
        moves = deformations(pose, self._own)[self.bones]
        return self.turn @ moves @ np.linalg.inv(self.turn) @ self._binds

    def axis(self, name: str) -> tuple[str, bool]:
        """Which of the session's axes one of mesh space is, and whether it points the other way."""
        column = self.turn[:3, "xyz".index(name)]
        largest = int(np.abs(column).argmax())
        return "xyz"[largest], bool(column[largest] < 0)

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points f32 [n,3] of mesh space in the session's."""
        return points if self._is_own else (points @ self.turn[:3, :3].T).astype(np.float32)

    def rest(self, vertices: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """The session's rest positions of some vertices in mesh space. Where they are those of its
        start, the tool's own bits, which may be others."""
        if self._is_own:
            return rest
        moved = (rest != self._start[vertices]).any(axis=1)
        back = (rest @ self.turn[:3, :3]).astype(np.float32)
        return np.where(moved[:, None], back, self._rest[vertices])

    def session_rest(self, vertices: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """The way back."""
        if self._is_own:
            return rest
        moved = (rest != self._rest[vertices]).any(axis=1)
        return np.where(moved[:, None], self.points(rest), self._start[vertices])

    def offsets(self, offsets: np.ndarray) -> np.ndarray:
        """The session's offsets f32 [n,3] in mesh space."""
        return offsets if self._is_own else (offsets @ self.turn[:3, :3]).astype(np.float32)

    def joints(self, joints: np.ndarray) -> np.ndarray:
        """The session's joints u16 [n,N] as indexes of the tool's bones."""
        if self._is_own:
            return joints
        theirs = np.full(NO_BONE + 1, NO_BONE, np.uint16)
        theirs[:len(self.bones)] = self.bones
        return theirs[joints]

    def session_joints(self, joints: np.ndarray) -> np.ndarray:
        """The way back."""
        if self._is_own:
            return joints
        ours = np.full(NO_BONE + 1, NO_BONE, np.uint16)
        ours[self.bones] = np.arange(len(self.bones), dtype=np.uint16)
        return ours[joints]

    def change(self, params: dict) -> Change:
        """The arrays of stroke.weights or session.update as a change of the tool's."""
        vertices = params.get("vertices")
        if vertices is None:  # of pins alone
            return Change(NONE, np.empty((0, params["influences"]), np.float32))
        joints, rest, offsets = (params.get(name) for name in ("joints", "rest", "offsets"))
        return Change(vertices, params["weights"],
                      None if joints is None else self.joints(joints),
                      None if rest is None else self.rest(vertices, rest),
                      params.get("shape", ""),
                      None if offsets is None else self.offsets(offsets))

    def params(self, change: Change) -> dict:
        """A change as weights.set takes it."""
        told = {"vertices": change.vertices, "weights": change.weights}
        if change.joints is not None:
            told["joints"] = self.session_joints(change.joints)
        if change.rest is not None:
            told["rest"] = self.session_rest(change.vertices, change.rest)
        if change.offsets is not None:
            told["shape"], told["offsets"] = change.shape, self.points(change.offsets)
        return told
