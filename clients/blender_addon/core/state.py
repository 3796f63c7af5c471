# SPDX-License-Identifier: GPL-3.0-or-later
"""What a session is made of, vertex by vertex, and what a step changes of it. Pure.

    State     all vertices: bones, weights, rest positions, corrective shapes
    Change    some vertices: their weights, and of the others what may be different

Everything is the tool's: its order of bones, its axes (see rig.Space).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .skin import differing

NONE = np.empty(0, np.uint32)  # vertices


@dataclass(frozen=True, eq=False)
class Change:
    """Rows of `vertices` u32 [n]; what is None stays as it is.

    weights f32 [n,N], joints u16 [n,N], rest f32 [n,3]; offsets f32 [n,3] of the corrective shape
    of the pose that is called `shape`.
    """

    vertices: np.ndarray
    weights: np.ndarray
    joints: np.ndarray | None = None
    rest: np.ndarray | None = None
    shape: str = ""
    offsets: np.ndarray | None = None

    @property
    def bytes(self) -> int:
        parts = (self.vertices, self.weights, self.joints, self.rest, self.offsets)
        return sum(part.nbytes for part in parts if part is not None)


def joined(changes: list[Change], slots: int) -> Change:
    """The rows of several changes of one step, each of its own vertices, in one."""
    if not changes:
        return Change(NONE, np.empty((0, slots), np.float32))
    if len(changes) == 1:
        return changes[0]

    def all_of(name: str) -> np.ndarray | None:
        parts = [getattr(change, name) for change in changes]
        return None if parts[0] is None else np.concatenate(parts)

    return Change(all_of("vertices"), all_of("weights"), all_of("joints"), all_of("rest"),
                  changes[0].shape, all_of("offsets"))


class State:
    """joints u16 [V,N], weights f32 [V,N], rest f32 [V,3]; shapes: pose name -> f32 [V,3].

    Arrays are changed in place. A shape of zeros is the same as none.
    """

    def __init__(self, joints: np.ndarray, weights: np.ndarray, rest: np.ndarray,
                 shapes: dict[str, np.ndarray] | None = None) -> None:
        self.joints, self.weights, self.rest = joints, weights, rest
        self.shapes = {} if shapes is None else shapes

    def copy(self) -> "State":
        return State(self.joints.copy(), self.weights.copy(), self.rest.copy(),
                     {name: offsets.copy() for name, offsets in self.shapes.items()})

    def take(self, change: Change) -> Change:
        """The rows that are here, of what the change would change."""
        vertices, offsets = change.vertices, None
        if change.offsets is not None:
            held = self.shapes.get(change.shape)
            offsets = np.zeros_like(change.offsets) if held is None else held[vertices]
        return Change(vertices, self.weights[vertices],
                      None if change.joints is None else self.joints[vertices],
                      None if change.rest is None else self.rest[vertices], change.shape, offsets)

    def whole(self, change: Change) -> Change:
        """The change with all that is here of its vertices: as a change of any other state."""
        return replace(change, weights=self.weights[change.vertices],
                       joints=self.joints[change.vertices], rest=self.rest[change.vertices])

    def trimmed(self, change: Change) -> Change:
        """The change without what is here already."""
        vertices = change.vertices
        joints, rest, offsets = change.joints, change.rest, change.offsets
        if joints is not None and np.array_equal(joints, self.joints[vertices]):
            joints = None
        if rest is not None and np.array_equal(rest, self.rest[vertices]):
            rest = None
        if offsets is not None:
            held = self.shapes.get(change.shape)
            if np.array_equal(offsets, 0 * offsets if held is None else held[vertices]):
                offsets = None
        return replace(change, joints=joints, rest=rest, offsets=offsets,
                       shape=change.shape if offsets is not None else "")

    def put(self, change: Change) -> None:
        vertices = change.vertices
        self.weights[vertices] = change.weights
        if change.joints is not None:
            self.joints[vertices] = change.joints
        if change.rest is not None:
            self.rest[vertices] = change.rest
        if change.offsets is not None:
            if change.shape not in self.shapes:
                self.shapes[change.shape] = np.zeros_like(self.rest)
            self.shapes[change.shape][vertices] = change.offsets

    def differing(self, other: "State", vertices: np.ndarray | None = None) -> np.ndarray:
        """u32: which vertices (of these) have other bones, weights or rest positions there."""
        part = slice(None) if vertices is None else vertices
        found = differing(self.weights[part], other.weights[part])
        for mine, theirs in ((self.joints, other.joints), (self.rest, other.rest)):
            more = differing(mine[part], theirs[part])
            if len(more):
                found = np.union1d(found, more)
        return found if vertices is None else vertices[found]

    def reshaped(self, other: "State", vertices: np.ndarray | None = None
                 ) -> list[tuple[str, np.ndarray]]:
        """(shape, which vertices of these have another offset there), for each shape that has."""
        part = slice(None) if vertices is None else vertices
        found = []
        for name in {**self.shapes, **other.shapes}:
            mine, theirs = (state.shapes.get(name) for state in (self, other))
            none = np.zeros((1, 3), np.float32)
            differs = np.flatnonzero(((none if mine is None else mine[part])
                                      != (none if theirs is None else theirs[part])).any(axis=1))
            if len(differs):
                found.append((name, differs.astype(np.uint32) if vertices is None
                              else vertices[differs]))
        return found

    def of(self, vertices: np.ndarray, like: "State | None" = None, shape: str = "") -> Change:
        """A change that brings vertices to what they are here.

        `like`: told without what is the same there. `shape`: with the offsets of this one.
        """
        held = self.shapes.get(shape) if shape else None
        offsets = None
        if shape:
            offsets = (np.zeros((len(vertices), 3), np.float32) if held is None
                       else held[vertices])
        change = Change(vertices, self.weights[vertices], self.joints[vertices],
                        self.rest[vertices], shape, offsets)
        return change if like is None else like.trimmed(change)


@dataclass(frozen=True, eq=False)
class Held:
    """All that a session has, as it was fetched; `joints` as the daemon counts bones."""

    revision: int
    joints: np.ndarray
    state: State


def changes_to(goal: State, now: State, vertices: np.ndarray | None = None) -> list[Change]:
    """What makes `now` the goal, where these vertices are concerned: one change for weights, bones
    and rest positions, and one for each shape."""
    ahead = goal.differing(now, vertices)
    found = [goal.of(ahead, now)] if len(ahead) else []
    return found + [goal.of(those, now, name) for name, those in goal.reshaped(now, vertices)]
