# SPDX-License-Identifier: GPL-3.0-or-later
"""A non-blocking socket with the Exchange behind it: what Link waits for and Channel pumps.

Owns the socket and what is still to be written. No thread, never waits; one thread at a time.
"""

from __future__ import annotations

import socket
from collections import deque

from .exchange import Exchange
from .wire import Piece

PORTION_BYTES = 256 << 10  # at most this much in one system call, so that a caller keeps its time
PIECES_AT_ONCE = 64  # far below the system's limit for one sendmsg


class Stream:
    """Bytes between a connected socket and an Exchange, a portion at a time.

    Nothing is copied on the way: pieces are sent from where they are, and bytes are received into
    the memory that the arrays of their message will view.
    """

    def __init__(self, connection: socket.socket, exchange: Exchange) -> None:
        self.socket = connection
        self.exchange = exchange
        self.unsent_bytes = 0
        self._out: deque[memoryview] = deque()
        self.socket.setblocking(False)

    def close(self) -> None:
        self.socket.close()
        self._forget()

    def push(self, pieces: list[Piece]) -> None:
        """Pieces to be sent by send(), after those before."""
        for piece in pieces:
            self._out.append(memoryview(piece))
            self.unsent_bytes += len(piece)

    def send(self) -> int:
        """Sends a portion, as far as it goes now; returns the bytes. Raises OSError."""
        if not self._out:
            return 0
        try:
            # A peer that is gone must be an error here, not a signal that ends the program.
            sent = self.socket.sendmsg(self._portion(), [], socket.MSG_NOSIGNAL)
        except BlockingIOError:
            return 0
        except (BrokenPipeError, ConnectionResetError):
            # The daemon is gone; what it said last is still to be read, and says more than this.
            self._forget()
            return 0
        self._drop(sent)
        return sent

    def receive(self) -> int:
        """Takes a portion in, if one is there; returns the bytes.

        Raises ConnectionError when the peer closed, and OSError; from Exchange.advance SkindError
        and WireError.
        """
        try:
            count = self.socket.recv_into(self.exchange.get_buffer()[:PORTION_BYTES])
        except BlockingIOError:
            return 0
        if count == 0:
            raise ConnectionError("skind closed the connection")
        self.exchange.advance(count)
        return count

    def _portion(self) -> list[memoryview]:
        portion: list[memoryview] = []
        left = PORTION_BYTES
        for piece in self._out:
            if left <= 0 or len(portion) == PIECES_AT_ONCE:
                break
            portion.append(piece[:left])
            left -= len(piece)
        return portion

    def _drop(self, sent: int) -> None:
        self.unsent_bytes -= sent
        while sent:
            piece = self._out[0]
            if sent < len(piece):
                self._out[0] = piece[sent:]
                return
            sent -= len(piece)
            self._out.popleft()

    def _forget(self) -> None:
        self._out.clear()
        self.unsent_bytes = 0
