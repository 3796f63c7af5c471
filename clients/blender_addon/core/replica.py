# SPDX-License-Identifier: GPL-3.0-or-later
"""What the daemon holds of a session in the last revision heard of, and what of it is not shown.

Three things tell what the daemon holds: answers to our own strokes, updates about all else, and
rows that were fetched. Each is put into `held` and then waits in `arrived` until the tool has time
to show it. There are two exceptions. Where the tool is ahead (see ahead.py), what was missed does
not arrive: what it shows counts. And what is fetched, or told of several changes at once, may be
the doing of an ask without an answer: then it is hidden with the ask (see asks.py), and arrives
with the answer.

An answer may come before the update that leads to it, or after. What is told of a revision is put
into `held` once, in order: a stroke's own rows only if nothing was in between, else an update that
covers them comes, or came (protocol/PROTOCOL.md, Revisions).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from .ahead import Ahead
from .asks import Ask, Asks, Stroke
from .history import Entry, History
from .rig import Space
from .state import NONE, Change, Held, State, joined


@dataclass(frozen=True, eq=False)
class Arrival:
    """A change that the daemon has made and the tool has not shown. Its vertices are told whole."""

    cause: str  # "stroke", "undo", "redo", "set", "mirror" and other edits, "resync"
    client: str
    change: Change
    entry: Entry | None = None
    stroke: Stroke | None = None
    user: str = ""  # the person at that client, where it was told

    @property
    def vertices(self) -> np.ndarray:
        return self.change.vertices


class Replica:
    """`held` in `revision`; `history` is the daemon's. `client`: our name, by which updates tell of
    our own changes."""

    def __init__(self, client: str, asks: Asks, ahead: Ahead) -> None:
        self._client, self._asks, self._ahead = client, asks, ahead
        self.held = State(np.empty((0, 4), np.uint16), np.empty((0, 4), np.float32),
                          np.empty((0, 3), np.float32))
        self.revision = 0
        self.history = History()
        self.arrived: deque[Arrival] = deque()
        self._behind = 0  # up to this revision updates tell what was missed
        self._due = 0  # and up to this one they come

    @property
    def influences(self) -> int:
        """Of each vertex."""
        return self.held.weights.shape[1]

    @property
    def is_current(self) -> bool:
        """Whether all updates have come that answers told of."""
        return self.revision >= self._due

    # ---- the connection ----

    def adopt(self, held: Held) -> None:
        """A session was opened: that is what it has."""
        self.held, self.revision = held.state, held.revision

    def lost(self) -> None:
        self._behind = self._due = 0

    def resumed(self, revision: int, missed: bool) -> None:
        """What happened up to this revision comes as updates; see Sculpt.resumed."""
        self._behind = self._due = revision
        if missed:
            self.history.forget()
            self._ahead.forget_hops()

    # ---- answers ----

    def expect(self, revision: int) -> None:
        """An answer told of this revision."""
        self._due = max(self._due, revision)

    def _advance(self, result: dict, change: Change) -> bool:
        """Whether what we know of our own change is all that we lack; then it is held. Else an
        update that covers it comes, or came."""
        is_next = (result["vertices"] > 0 and result["revision"] == self.revision + 1
                   and not result.get("repeated"))
        if is_next:
            self.revision = result["revision"]
            self.held.put(change)
        return is_next

    def stroke_answered(self, stroke: Stroke) -> None:
        """It has a result; what it changed was told in chunks."""
        result = stroke.result
        change = joined(stroke.chunks, self.influences)
        stroke.chunks.clear()
        if "residuals" not in result:  # it was done before, and its arrays went with the connection
            result["residuals"] = np.full(len(stroke.vertices), np.nan, np.float32)
            self._delay(stroke, self.held.of(stroke.vertices))
        elif self._advance(result, change) or not result["vertices"]:
            self._take_answer(stroke, change)
        else:
            self._delay(stroke, change)

    def _delay(self, stroke: Stroke, change: Change) -> None:
        self._asks.delay(stroke, change)
        self._take_covered()

    def _take_covered(self) -> None:
        """Strokes that were answered, and whose revision `held` has reached since."""
        for stroke, change in self._asks.take_covered(self.revision):
            # A vertex that has a corrective shape keeps it with any stroke in its pose.
            shape = stroke.pose_name if stroke.pose_name in self.held.shapes else ""
            self._take_answer(stroke, self.held.of(change.vertices, shape=shape))
            self.reveal(stroke.ask)

    def _take_answer(self, stroke: Stroke, change: Change) -> None:
        """The stroke's change is in `held`."""
        entry = None
        if stroke.result["vertices"]:
            entry = self.history.add(Entry(dropped=stroke.dropped))
            if stroke.result["revision"] < self.revision:
                self.history.forget()  # the steps after it were not told one by one
        if stroke.dropped:
            self._ahead.mark(change.vertices)
        else:
            self._arrive("stroke", self._client, change, entry, stroke)
            stroke.ask.cover(change)

    def drop(self, stroke: Stroke) -> None:
        """It was undone before it was shown."""
        for arrival in [each for each in self.arrived if each.stroke is stroke]:
            self.arrived.remove(arrival)
            if arrival.entry is not None:
                arrival.entry.dropped = True
            self._ahead.mark(arrival.vertices)

    def pins_answered(self, result: dict) -> None:
        """Of a change of pins alone, which moves nothing, and which nobody tells who asked."""
        nothing = Change(NONE, np.empty((0, self.influences), np.float32))
        if self._advance(result, nothing):
            self._arrive("pins", self._client, nothing, self.history.add(Entry()))

    def rows_answered(self, result: dict, change: Change) -> None:
        """Rows were set; what we set is shown already."""
        if self._advance(result, change):
            self.history.add(Entry())

    def rows_refused(self, change: Change) -> None:
        """What the tool wanted of these is not to be: what is held arrives instead."""
        self._arrive("resync", "", self.held.of(change.vertices, shape=change.shape))

    def _arrive(self, cause: str, client: str, change: Change, entry: Entry | None = None,
                stroke: Stroke | None = None, user: str = "") -> None:
        """A change that is in `held` already waits to be shown."""
        self.arrived.append(Arrival(cause, client, self.held.whole(change), entry, stroke, user))

    # ---- updates ----

    def update(self, params: dict, space: Space) -> bool:
        """session.update was told, of a revision that is new. False: it does not tell all that is
        new; then it must be fetched."""
        is_missed = params.get("since", self.revision) > self.revision
        self.revision = params["revision"]
        if params.get("resync") or is_missed:
            self.history.forget()
            return False
        change = space.change(params)
        self.held.put(change)
        if self._tells_late(params):
            self.history.forget()
            self._take_missed(change.vertices, change.shape)
        else:
            self._take_update(params, change)
        self._take_covered()
        return True

    def _tells_late(self, params: dict) -> bool:
        """Whether it tells several changes at once, or what was done while we were away."""
        return ("changes" in params or self.revision <= self._behind
                or (params["client"] == self._client and self._asks.in_doubt))

    def _take_update(self, params: dict, change: Change) -> None:
        """What was done, by whom; the change is in `held`."""
        cause = params["cause"]
        if params["client"] == self._client and cause == "stroke" and self._is_own(change):
            return
        if params["client"] == self._client and cause in ("undo", "redo", "set"):
            self._ahead.mark(change.vertices)  # ours; whether it did what it should is looked at
            return
        entry = None
        if cause in ("undo", "redo"):
            self.history.take(cause)
        else:
            entry = self.history.add(Entry())
        self._arrive(cause, params["client"], change, entry, user=params.get("user", ""))

    def _is_own(self, change: Change) -> bool:
        """Whether it is one of our strokes, whose answer says what to do with it."""
        if self._asks.has_late(self.revision):
            return True
        streamed = [joined(stroke.chunks, self.influences) for stroke in self._asks.strokes]
        return any(each.shape == change.shape and np.array_equal(each.vertices, change.vertices)
                   and np.array_equal(each.weights, change.weights) for each in streamed)

    # ---- what was fetched, and what was missed ----

    def catch_up(self, held: Held, scaled: np.ndarray = NONE) -> None:
        """All that the daemon has was fetched: what is new in it arrives, `scaled` anyway."""
        before, self.held, self.revision = self.held, held.state, held.revision
        self._take_covered()
        self._take_missed(np.union1d(self.held.differing(before), scaled).astype(np.uint32))
        for name, reshaped in self.held.reshaped(before):
            self._take_missed(reshaped, name)

    def reveal(self, ask: Ask) -> None:
        """It has its answer: what was done before or after it arrives, too."""
        for vertices, shape in ask.reveal():
            self._take_missed(vertices, shape)

    def _take_missed(self, vertices: np.ndarray, shape: str = "") -> None:
        """Something was done to these, which `held` has already. It arrives, but not where the tool
        is ahead, nor before the answer where what was asked for may have done it."""
        vertices = self._asks.hide(self._ahead.unmarked(vertices), shape)
        if len(vertices):
            self._arrive("resync", "", self.held.of(vertices, shape=shape))
