# SPDX-License-Identifier: GPL-3.0-or-later
"""What a tool has asked a session to change and has no answer to, over lost connections too.

A change has a number by which the daemon knows it when it comes again (protocol/PROTOCOL.md,
Sharing). So what has no answer when a connection breaks is sent once more, in the same order and
with the same numbers, and is done once. That is the life of an ask:

    waits      there is no connection, or not yet
    sent       `request` is its id; from a lost connection it goes back to waiting, `in_doubt`
    late       a stroke's answer told of a revision that the updates have yet to reach; it is
               asked for again if the connection is lost before they do
    over       it was answered, or given up

What is fetched or told meanwhile may be an ask's own doing. At the vertices that it is about such
news is hidden until its answer says what to make of it.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Callable, Iterator, Protocol

import numpy as np

from .channel import Channel, Done
from .state import NONE, Change
from .wire import GONE, SkindError


@dataclass(eq=False)
class Stroke:
    """A stroke on its way. vertices u32 [n], targets f32 [n,3] in mesh space; pose f64 [B,4,4].

    `result` is there when it is answered, `error` when it was refused. `host` is the tool's own.
    """

    vertices: np.ndarray
    targets: np.ndarray
    pose: np.ndarray
    pose_name: str
    options: dict
    host: Any = None
    ask: Ask | None = None  # by which it was asked for last
    chunks: list[Change] = field(default_factory=list)
    solved: int = 0
    result: dict | None = None
    error: SkindError | None = None
    dropped: bool = False
    begun: float = field(default_factory=time.monotonic)
    seconds: float = 0.0

    @property
    def is_answered(self) -> bool:
        return self.result is not None or self.error is not None


@dataclass(eq=False)
class Ask:
    """A request that changes a session. `vertices`: which, as far as one knows it beforehand.

    `replays`: it is still wanted in a session that was made again, or in which others were at work
    meanwhile. An undo, or rows to set, are not: they follow from what the tool shows.
    """

    method: str
    params: dict
    done: Done
    vertices: np.ndarray = field(default_factory=lambda: NONE)
    stroke: Stroke | None = None
    replays: bool = True
    sequence: int = 0  # 0: it has none
    request: int | None = None  # None: not sent, or its connection was lost
    in_doubt: bool = False  # its connection was lost before the answer: it was done or not
    is_cancelled: bool = False
    is_given_up: bool = False  # nobody will know what became of it
    hidden: list[tuple[np.ndarray, str]] = field(default_factory=list)  # shown when it is answered

    @property
    def poses(self) -> list[str]:
        """Those that it names."""
        named = [self.params[key] for key in ("pose", "shape") if self.params.get(key)]
        return named + list(self.params.get("poses", ()))

    def hide(self, vertices: np.ndarray, shape: str) -> np.ndarray:
        """Keeps to itself what it may have done of a change to these, and returns the others."""
        own = np.intersect1d(vertices, self.vertices)
        if len(own) == 0:
            return vertices
        self.hidden.append((own, shape))
        return np.setdiff1d(vertices, own)

    def cover(self, change: Change) -> None:
        """The change is about to be shown as it is now: what it covers need not be revealed."""
        self.hidden = [(np.setdiff1d(those, change.vertices), shape)
                       if shape in ("", change.shape) else (those, shape)
                       for those, shape in self.hidden]

    def reveal(self) -> list[tuple[np.ndarray, str]]:
        """What was hidden, as (vertices, shape); nothing is any more."""
        hidden, self.hidden = self.hidden, []
        return hidden


class Session(Protocol):
    """What a queue needs of the session that it is of: a Sculpt."""

    phase: str
    channel: Channel

    def request(self, method: str, params: dict, done: Done) -> int | None:
        """Sends a request about the session."""

    def need_pose(self, name: str) -> None:
        """Tells the daemon a pose of ours that it has not heard of."""


class Asks:
    """Those that are not over, in order; true while there are any.

    `over(ask, result, error)` is called for each that is, and sees to it that done() is.
    """

    def __init__(self, session: Session,
                 over: Callable[[Ask, "dict | None", "SkindError | None"], None]) -> None:
        self._session, self._over = session, over
        self._open: list[Ask] = []  # what has no answer
        self._late: list[tuple[Stroke, Change]] = []  # and what it changed, as the answer told it
        # Numbers our changes; above those of an earlier session of this connection (1/4096 ms).
        self._sequence = int(time.time() * 1000) << 12

    def __bool__(self) -> bool:
        return bool(self._open or self._late)

    # ---- asking ----

    def add(self, ask: Ask) -> None:
        """Sends it. While there is no connection it waits for the next one; after the end of the
        session it is given up."""
        self._open.append(ask)
        if self._session.phase == "ready":
            self._send(ask)
        elif self._session.phase == "ended":
            self._give_up(ask)

    def _send(self, ask: Ask) -> None:
        channel = self._session.channel
        if channel.state != "ready":
            return  # the loss was not told yet; it is sent when resumed
        for name in ask.poses:
            self._session.need_pose(name)
        if not ask.sequence and "sequence" in channel.capabilities:
            self._sequence += 1
            ask.sequence = self._sequence
        numbered = {"sequence": ask.sequence} if ask.sequence else {}
        if ask.stroke is not None:
            ask.stroke.chunks.clear()
        ask.request = self._session.request(
            ask.method, {**ask.params, **numbered},
            lambda result, error: self._answered(ask, result, error))
        if ask.is_cancelled:
            channel.cancel(ask.request)

    def _answered(self, ask: Ask, result: dict | None, error: SkindError | None) -> None:
        if error is not None and error.name in GONE and self._session.phase != "ended":
            ask.request, ask.in_doubt = None, True  # it is sent again when resumed
            return
        self._open.remove(ask)
        ask.request = None
        self._over(ask, result, error)

    def cancel(self, ask: Ask) -> None:
        """Asks for a change to be given up; it is answered all the same."""
        if ask not in self._open:
            return
        if ask.request is not None:  # it may be done before the daemon reads this
            self._session.channel.cancel(ask.request)
        elif ask.in_doubt and ask.sequence:
            ask.is_cancelled = True  # it is sent again, to hear what became of it
        else:
            self._give_up(ask)

    def _give_up(self, ask: Ask) -> None:
        self._open.remove(ask)
        ask.is_given_up = True
        self._over(ask, None, SkindError(0, "lost", "the connection to skind was lost",
                                         retryable=True))

    # ---- the connection ----

    def lost(self) -> None:
        """The connection is gone. What is late comes with the same answer again."""
        for stroke, _ in self._late:
            stroke.result, stroke.ask.in_doubt = None, True
        self._open[:0] = [stroke.ask for stroke, _ in self._late]
        self._late.clear()
        for ask in self._open:
            ask.in_doubt |= ask.request is not None
            ask.request = None

    def resume(self, missed: bool, remembers: bool) -> None:
        """Sends what waits, but what nobody wants any more. See Sculpt.resumed."""
        for ask in list(self._open):
            knows = remembers and ask.in_doubt and ask.sequence  # it tells what became of it
            if (ask.is_cancelled or not ask.replays) and not knows or missed and not ask.replays:
                self._give_up(ask)
                continue
            ask.in_doubt &= remembers
            self._send(ask)

    def end(self) -> None:
        """Nobody should wait for an answer for ever; of strokes the tool sees that by itself."""
        for ask in [each for each in self._open if each.request is None and each.stroke is None]:
            self._give_up(ask)

    # ---- strokes ----

    @property
    def strokes(self) -> list[Stroke]:
        """Those that have no answer."""
        return [ask.stroke for ask in self._open if ask.stroke is not None]

    def stroke_of(self, request: int) -> Stroke | None:
        """The one that was sent as this request."""
        return next((ask.stroke for ask in self._open if ask.request == request), None)

    def delay(self, stroke: Stroke, change: Change) -> None:
        """It was answered with this change, and an update that covers it comes, or came."""
        self._late.append((stroke, change))

    def take_covered(self, revision: int) -> Iterator[tuple[Stroke, Change]]:
        """Late strokes, and what they changed, that updates up to this revision cover. One by one:
        the next hides its own until it is taken."""
        for late in [each for each in self._late if each[0].result["revision"] <= revision]:
            self._late.remove(late)
            yield late

    def has_late(self, revision: int) -> bool:
        """Whether this revision is a late stroke's."""
        return any(stroke.result["revision"] == revision for stroke, _ in self._late)

    # ---- what may be their doing ----

    @property
    def in_doubt(self) -> bool:
        """Whether one was perhaps done, and nobody said so."""
        return any(ask.in_doubt for ask in self._open)

    def hide(self, vertices: np.ndarray, shape: str) -> np.ndarray:
        """Those of the vertices that no ask is about. The others wait for the answer."""
        for ask in [*self._open, *(stroke.ask for stroke, _ in self._late)]:
            vertices = ask.hide(vertices, shape)
        return vertices
