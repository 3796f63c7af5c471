# SPDX-License-Identifier: GPL-3.0-or-later
"""`Link`: a connection to skind for scripts and tests, which waits. A `Channel` never does.

    with Link.connect() as skind:
        session = skind.call("session.create", {"file": "/home/me/Knight.glb"})["session"]
        weights = skind.call("weights.get", {"session": session})["weights"]
"""

from __future__ import annotations

import os
import select
import socket
import time
from collections import deque
from typing import Callable

import numpy as np

from .dial import port_of, shown, usual_socket_path
from .exchange import Exchange
from .stream import Stream
from .wire import PROTOCOL, Message, Piece


def default_socket_path() -> str:
    """Where the daemon listens when nobody says otherwise; the same rule as the daemon's."""
    return os.environ.get("SKIND_SOCKET", "") or usual_socket_path()


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
        self._stream = Stream(connection, exchange)

    @classmethod
    def connect(cls, path: str | os.PathLike | None = None, *, name: str = "python",
                version: str = "", id: str = "", user: str = "", lines: bool = False,
                timeout: float = 60.0,
                watch: Callable[[str, dict], None] | None = None) -> "Link":
        """Connects and says hello; the answer is in `.hello`.

        `path` is a socket's, or "tcp:PORT". `id` is what the program goes by over reconnects, for
        `sequence` and `own`; `user` a person.
        """
        place = os.fspath(path or default_socket_path())
        port, token = port_of(place), shown(place)
        family = socket.AF_UNIX if port is None else socket.AF_INET
        connection = socket.socket(family, socket.SOCK_STREAM)
        try:
            connection.connect(place if port is None else ("127.0.0.1", port))
            link = cls(connection, Exchange(lines=lines, watch=watch), timeout)
            client = {"name": name, "version": version,
                      **({"id": id} if id else {}), **({"user": user} if user else {})}
            link.hello = link.call("hello", {"protocol": PROTOCOL, "client": client, **token})
        except BaseException:
            connection.close()
            raise
        return link

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._stream.close()

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
        self._stream.push(pieces)
        deadline = time.monotonic() + self.timeout
        while self._stream.unsent_bytes:
            self._step(deadline)

    def _step(self, deadline: float) -> None:
        """Waits for the socket once, then writes or reads as far as it goes.

        Reading goes on while there is something to write: a daemon that waits for us to read would
        otherwise never take it.
        """
        poll = select.poll()
        wanted = select.POLLIN | (select.POLLOUT if self._stream.unsent_bytes else 0)
        poll.register(self.socket, wanted)
        left = max(0.0, deadline - time.monotonic())
        events = poll.poll(left * 1000)
        if not events:
            raise TimeoutError("skind did not answer in time")
        if events[0][1] & select.POLLOUT:
            self._stream.send()
        if events[0][1] & ~select.POLLOUT:
            self._stream.receive()
