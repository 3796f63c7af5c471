# SPDX-License-Identifier: GPL-3.0-or-later
"""What a tool shows of a session, and the states that its own undo can take it back to.

A modelling program restores its data by itself when the user presses Ctrl+Z, and tells only which
state it is in now. So states form a tree with a number each; going from one to another is a walk
over the tree that patches the whole state on its way, to the bit: bones, weights, rest positions
and shapes, as far as a step changed them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .state import Change, State

LOG_BYTES_MAX = 512 << 20  # then the oldest states are forgotten


@dataclass(frozen=True)
class Step:
    """From state `parent` to state `id`: the same vertices and kinds of rows, before and after."""

    id: int
    parent: int
    before: Change
    after: Change

    @property
    def vertices(self) -> np.ndarray:
        return self.after.vertices

    @property
    def bytes(self) -> int:
        return self.before.bytes + self.after.bytes


class Steps:
    """`state` is what is shown in the state numbered `live`; changed in place."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.live = 0
        self._next = 1
        self._steps: dict[int, Step] = {}
        self._bytes = 0

    def add(self, change: Change) -> Step:
        """Shows a change: a new state below the live one."""
        step = Step(self._next, self.live, self.state.take(change), change)
        self._next += 1
        self._steps[step.id] = step
        self._bytes += step.bytes
        while self._bytes > LOG_BYTES_MAX and len(self._steps) > 1:
            self._bytes -= self._steps.pop(min(self._steps)).bytes
        self.state.put(change)
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
            self.state.put(step.before)
        for step in redo:
            self.state.put(step.after)
        self.live = to
        return path
