# SPDX-License-Identifier: GPL-3.0-or-later
"""The weights that a tool shows, and the states that its own undo can take it back to.

A modelling program restores its data by itself when the user presses Ctrl+Z, and tells only which
state it is in now. So states form a tree with a number each; going from one to another is a walk
over the tree that patches the weights on its way, and gives the vertices that changed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LOG_BYTES_MAX = 512 << 20  # then the oldest states are forgotten


@dataclass(frozen=True)
class Step:
    """From state `parent` to state `id`: rows f32 [n,N] of `vertices` u32 [n], before and after."""

    id: int
    parent: int
    vertices: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @property
    def bytes(self) -> int:
        return self.vertices.nbytes + self.before.nbytes + self.after.nbytes


class Steps:
    """`weights` f32 [V,N] is what is shown in the state `live`; changed in place."""

    def __init__(self, weights: np.ndarray) -> None:
        self.weights = weights
        self.live = 0
        self._next = 1
        self._steps: dict[int, Step] = {}
        self._bytes = 0

    def add(self, vertices: np.ndarray, rows: np.ndarray) -> Step:
        """Shows new rows: a new state below the live one."""
        step = Step(self._next, self.live, vertices, self.weights[vertices], rows)
        self._next += 1
        self._steps[step.id] = step
        self._bytes += step.bytes
        while self._bytes > LOG_BYTES_MAX and len(self._steps) > 1:
            self._bytes -= self._steps.pop(min(self._steps)).bytes
        self.weights[vertices] = rows
        self.live = step.id
        return step

    def _way_up(self, id: int) -> list[int]:
        """The state and those above it, as far as they are known."""
        way = [id]
        while way[-1] in self._steps:
            way.append(self._steps[way[-1]].parent)
        return way

    def path(self, to: int) -> tuple[list[Step], list[Step]] | None:
        """The steps to undo, and those to redo after them, each in order; None: no way is known."""
        up, down = self._way_up(self.live), self._way_up(to)
        meeting = next((id for id in up if id in down), None)
        if meeting is None:
            return None
        undo = [self._steps[id] for id in up[:up.index(meeting)]]
        redo = [self._steps[id] for id in reversed(down[:down.index(meeting)])]
        return undo, redo

    def go(self, to: int) -> tuple[list[Step], list[Step]] | None:
        """Makes a state live. Returns what path() told, or None, and then nothing was changed."""
        path = self.path(to)
        if path is None:
            return None
        undo, redo = path
        for step in undo:
            self.weights[step.vertices] = step.before
        for step in redo:
            self.weights[step.vertices] = step.after
        self.live = to
        return path
