# SPDX-License-Identifier: GPL-3.0-or-later
"""A connection to skind for scripts and tests: `Link`, over `Exchange`, which knows no socket.

    with Link.connect() as skind:
        session = skind.call("session.create", {"file": "/home/me/Knight.glb"})["session"]
        weights = skind.call("weights.get", {"session": session})["weights"]

Exchange is the part that a program with a loop of its own (a DCC's timer) uses directly: bytes in,
answers and notifications out.
"""

from __future__ import annotations

import os
import select
import socket
import time
from collections import deque
from itertools import islice
from typing import Any, Callable

import numpy as np

from .wire import (
    PROTOCOL,
    Decoder,
    Message,
    Piece,
    SkindError,
    WireError,
    encode_notification,
    encode_request,
)

PIECES_AT_ONCE = 64  # far below the system's limit for one sendmsg


def default_socket_path() -> str:
    """Where the daemon listens when nobody says otherwise; the same rule as the daemon's."""
    chosen = os.environ.get("SKIND_SOCKET", "")
    if chosen:
        return chosen
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime.startswith("/"):
        return f"{runtime}/skind/skind.sock"
    return f"/tmp/skind-{os.getuid()}/skind.sock"


class Exchange:
    """Requests and their answers, without a socket: what is sent and received passes through.

    `watch(direction, raw)`, if given, sees each message as JSON: "sent" or "received".
    """

    def __init__(self, *, lines: bool = False,
                 watch: Callable[[str, dict], None] | None = None) -> None:
        self.lines = lines
        self.notifications: deque[Message] = deque()
        self.on_notification: Callable[[Message], None] | None = None
        self._watch = watch
        self._decoder = Decoder()
        self._answers: dict[Any, Message] = {}
        self._waiting: set[Any] = set()
        self._next_id = 1

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


class Link:
    """A blocking connection to a daemon. One thread at a time.

    Notifications gather in `notifications`, or go to `on_notification` if that is set; either
    happens while some call waits, or in pump().
    """

    def __init__(self, connection: socket.socket, exchange: Exchange, timeout: float) -> None:
        self.socket = connection
        self.exchange = exchange
        self.timeout = timeout
        self.hello: dict = {}
        self._out: deque[memoryview] = deque()
        self.socket.setblocking(False)

    @classmethod
    def connect(cls, path: str | os.PathLike | None = None, *, name: str = "python",
                version: str = "", lines: bool = False, timeout: float = 60.0,
                watch: Callable[[str, dict], None] | None = None) -> "Link":
        """Connects and says hello; the answer is in `.hello`."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(os.fspath(path or default_socket_path()))
            link = cls(connection, Exchange(lines=lines, watch=watch), timeout)
            link.hello = link.call("hello", {"protocol": PROTOCOL,
                                             "client": {"name": name, "version": version}})
        except BaseException:
            connection.close()
            raise
        return link

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self.socket.close()

    @property
    def notifications(self) -> deque[Message]:
        return self.exchange.notifications

    def send(self, method: str, params: dict | None = None,
             arrays: dict[str, np.ndarray] | None = None) -> int:
        """Sends a request without waiting for its answer; returns its id.

        `arrays` are members of params that are NumPy arrays; they may as well stand in params.
        """
        id, pieces = self.exchange.request(method, {**(params or {}), **(arrays or {})})
        self._write(pieces)
        return id

    def wait(self, id: int, timeout: float | None = None) -> dict:
        """The result of a request that was sent. Raises SkindError, TimeoutError, ConnectionError."""
        deadline = time.monotonic() + (self.timeout if timeout is None else timeout)
        while True:
            result = self.exchange.take(id)
            if result is not None:
                return result
            self._step(deadline)

    def call(self, method: str, params: dict | None = None,
             arrays: dict[str, np.ndarray] | None = None, timeout: float | None = None) -> dict:
        """Sends a request and waits for its result, with arrays in place."""
        return self.wait(self.send(method, params, arrays), timeout)

    def cancel(self, id: int) -> None:
        """Asks the daemon to give a request up; wait(id) still ends, often with `cancelled`."""
        self._write(self.exchange.cancel(id))

    def pump(self, seconds: float = 0.0) -> None:
        """Takes in what is there already, and what comes within that time."""
        deadline = time.monotonic() + seconds
        while True:
            try:
                self._step(deadline)
            except TimeoutError:
                return

    def _write(self, pieces: list[Piece]) -> None:
        self._out.extend(memoryview(piece) for piece in pieces)
        deadline = time.monotonic() + self.timeout
        while self._out:
            self._step(deadline)

    def _step(self, deadline: float) -> None:
        """Waits for the socket once, then writes or reads as far as it goes.

        Reading goes on while there is something to write: a daemon that waits for us to read would
        otherwise never take it.
        """
        poll = select.poll()
        poll.register(self.socket, select.POLLIN | (select.POLLOUT if self._out else 0))
        left = max(0.0, deadline - time.monotonic())
        events = poll.poll(left * 1000)
        if not events:
            raise TimeoutError("skind did not answer in time")
        if events[0][1] & select.POLLOUT:
            self._flush()
        if events[0][1] & ~select.POLLOUT:
            self._receive()

    def _flush(self) -> None:
        try:
            sent = self.socket.sendmsg(list(islice(self._out, PIECES_AT_ONCE)))
        except BlockingIOError:
            return
        except (BrokenPipeError, ConnectionResetError):
            # The daemon is gone; what it said last is still to be read, and says more than this.
            self._out.clear()
            return
        while sent:
            piece = self._out[0]
            if sent < len(piece):
                self._out[0] = piece[sent:]
                return
            sent -= len(piece)
            self._out.popleft()

    def _receive(self) -> None:
        try:
            count = self.socket.recv_into(self.exchange.get_buffer())
        except BlockingIOError:
            return
        if count == 0:
            raise ConnectionError("skind closed the connection")
        self.exchange.advance(count)
