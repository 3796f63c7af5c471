# SPDX-License-Identifier: GPL-3.0-or-later
"""How the daemon is made to follow where the tool is ahead: one request at a time.

The tool's own undo or redo becomes the daemon's, as long as what that would take next is the very
step that the tool went over: then its history stays what the artist sees. Where it is not, and for
whatever the tool changed by itself, the rows are set, which is a new step.
"""

from __future__ import annotations

from typing import Callable

import numpy as np

from .ahead import Ahead
from .asks import Ask, Asks
from .history import Entry
from .replica import Replica
from .rig import Space
from .state import NONE, Change, State, changes_to
from .wire import GONE, SkindError

SUM_SLACK = 1e-7  # weights.set keeps rows to the bit that sum to one so nearly


class WriteBack:
    """`fetch(vertices)` fetches all, and has these arrive in any case; `say` tells a refusal."""

    def __init__(self, asks: Asks, replica: Replica, ahead: Ahead,
                 fetch: Callable[[np.ndarray], None], say: Callable[[str], None]) -> None:
        self._asks, self._replica, self._ahead = asks, replica, ahead
        self._fetch, self._say = fetch, say

    def go_on(self, shown: State, space: Space) -> None:
        """Asks for the next thing that brings the daemon to what is shown, if there is any.

        To be called when nothing else is under way and all that arrived is shown.
        """
        history = self._replica.history
        if not self._ahead:
            return
        last = history.next("undo")
        if last is not None and last.dropped:
            self._go("undo", last)
            return
        hop = self._ahead.take_hop()
        if hop is not None:
            verb, step = hop
            entry = history.next(verb)
            if entry is not None and entry.step is step:
                self._go(verb, entry)
                return
            self._ahead.forget_hops()
        history.keep_dropped()
        ahead = changes_to(shown, self._replica.held, self._ahead.take_marks())
        if ahead:
            self._set(ahead[0], space)
            for change in ahead[1:]:
                self._ahead.mark(change.vertices)

    def _go(self, verb: str, entry: Entry) -> None:
        """history.undo or history.redo, which takes this entry."""
        history = self._replica.history

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None and history.next(verb) is entry:
                history.take(verb)
                entry.dropped = False  # what redoes it is another's wish
            else:
                history.forget()  # the daemon's is another: set the rows instead

        vertices = NONE if entry.step is None else entry.step.vertices
        self._asks.add(Ask(f"history.{verb}", {}, done, vertices, replays=False))

    def _set(self, change: Change, space: Space) -> None:
        vertices = change.vertices

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None:
                self._replica.rows_answered(result, change)
                sums = change.weights.sum(axis=1, dtype=np.float64)
                if result["vertices"] != len(vertices) or (abs(sums - 1) > SUM_SLACK).any():
                    self._fetch(vertices)  # twins went with them, or rows were scaled
                else:
                    self._ahead.mark(vertices)  # another's change may arrive on top of these
            elif error.name in GONE:
                self._ahead.mark(vertices)
            else:
                self._say(str(error))
                self._replica.rows_refused(change)

        self._asks.add(Ask("weights.set", space.params(change), done, vertices, replays=False))
