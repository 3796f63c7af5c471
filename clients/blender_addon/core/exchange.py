# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests and their answers as bytes, for whoever holds the socket: `Exchange`.

What a program with a loop of its own builds on: bytes in, answers and notifications out. Owns what
was asked and what was answered. No socket, no thread; one thread at a time.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Callable

from .wire import Decoder, Message, Piece, WireError, encode_notification, encode_request


class Exchange:
    """Requests and their answers, without a socket: what is sent and received passes through.

    `watch(direction, raw)`, if given, sees each message as JSON: "sent" or "received".
    """

    def __init__(self, *, lines: bool = False, first_id: int = 1,
                 watch: Callable[[str, dict], None] | None = None) -> None:
        self.lines = lines
        self.notifications: deque[Message] = deque()
        self.on_notification: Callable[[Message], None] | None = None
        self._watch = watch
        self._decoder = Decoder()
        self._answers: dict[Any, Message] = {}
        self._waiting: set[Any] = set()
        self._next_id = first_id

    @property
    def unanswered(self) -> int:
        return len(self._waiting)

    def request(self, method: str, params: dict | None = None) -> tuple[int, list[Piece]]:
        """A new request: its id, and the pieces to write."""
        pieces = encode_request(self._next_id, method, params, lines=self.lines)
        id, self._next_id = self._next_id, self._next_id + 1
        self._waiting.add(id)
        self._see_sent(pieces)
        return id, pieces

    def cancel(self, id: int) -> list[Piece]:
        """The pieces that ask for a request to be given up; its answer still comes."""
        pieces = encode_notification("cancel", {"id": id}, lines=self.lines)
        self._see_sent(pieces)
        return pieces

    def _see_sent(self, pieces: list[Piece]) -> None:
        if self._watch is None:
            return
        # Through a decoder of our own: what is watched is what was written.
        decoder = Decoder()
        for piece in pieces:
            rest = memoryview(piece)
            while len(rest):
                into = decoder.get_buffer()
                count = min(len(into), len(rest))
                into[:count] = rest[:count]
                for message in decoder.advance(count):
                    self._watch("sent", message.raw)
                rest = rest[count:]

    def get_buffer(self) -> memoryview:
        return self._decoder.get_buffer()

    def advance(self, count: int) -> None:
        """`count` bytes were received: files answers, and hands out notifications.

        Raises SkindError when the daemon refused what it could not even read, and WireError when
        the stream is broken; the connection is of no use after either.
        """
        for message in self._decoder.advance(count):
            if self._watch is not None:
                self._watch("received", message.raw)
            if message.method is not None:
                self.notifications.append(message)
            elif message.id in self._waiting:
                self._waiting.discard(message.id)
                self._answers[message.id] = message
            elif message.error is not None:
                raise message.error
            else:
                raise WireError(f"an answer to {message.id!r}, which was not asked")
        # Last, so that a callback which fails loses nothing that came with it.
        while self.on_notification is not None and self.notifications:
            self.on_notification(self.notifications.popleft())

    def take(self, id: int) -> dict | None:
        """The result of a request, or None while it is not there. Raises SkindError."""
        message = self._answers.pop(id, None)
        if message is None:
            if id not in self._waiting:
                raise KeyError(f"no request {id} waits for an answer")
            return None
        if message.error is not None:
            raise message.error
        return message.result

    def take_all(self) -> list[Message]:
        """All answers that came and were not taken, in the order in which they came."""
        answers, self._answers = list(self._answers.values()), {}
        return answers
