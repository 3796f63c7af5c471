# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a tool is ahead of the daemon: at which vertices, and by which undos and redos. Pure.

Vertices are marked rather than compared, because a mark is cheap and the states are large; a mark
says that they may differ. How the daemon is made to follow is writeback.py's.
"""

from __future__ import annotations

import numpy as np

from .history import OPPOSITE
from .state import NONE
from .steps import Step


class Ahead:
    """Marked vertices, and hops: the tool's own undos and redos that the daemon did not follow."""

    def __init__(self) -> None:
        self._marks: list[np.ndarray] = []
        self._hops: list[tuple[str, Step]] = []

    def __bool__(self) -> bool:
        return bool(self._marks)

    def mark(self, vertices: np.ndarray) -> None:
        """What is shown of these counts, whatever the daemon holds."""
        self._marks.append(vertices)

    def unmarked(self, vertices: np.ndarray) -> np.ndarray:
        """Those of them where the tool is not ahead."""
        for marked in self._marks:
            vertices = np.setdiff1d(vertices, marked)
        return vertices

    def take_marks(self) -> np.ndarray:
        """All that is marked, in order and once each; none is any more."""
        marked = np.unique(np.concatenate(self._marks))
        self._marks.clear()
        return marked

    def hop(self, undo: list[Step], redo: list[Step]) -> np.ndarray:
        """The tool went back these steps, and then forth those. Returns the vertices concerned.

        A hop there and back again is none.
        """
        hops = [("undo", step) for step in undo] + [("redo", step) for step in redo]
        for verb, step in hops:
            if self._hops and self._hops[-1] == (OPPOSITE[verb], step):
                self._hops.pop()
            else:
                self._hops.append((verb, step))
        touched = [step.vertices for _, step in hops]
        self._marks += touched
        return np.unique(np.concatenate(touched)) if touched else NONE

    def take_hop(self) -> tuple[str, Step] | None:
        """The first that the daemon has not followed, as (verb, step)."""
        return self._hops.pop(0) if self._hops else None

    def forget_hops(self) -> None:
        """They lead nowhere any more; what is marked says what is to be done."""
        self._hops.clear()
