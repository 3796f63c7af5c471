# SPDX-License-Identifier: GPL-3.0-or-later
"""Connecting without waiting, `dial`, and the pauses between tries, `Retry`. No thread, no state
beyond a Retry's own."""

from __future__ import annotations

import errno
import os
import socket
from typing import Callable

PATH_BYTES_MAX = 107  # what the system has room for in a socket's address
FIRST_S = 0.1
LAST_S = 2.0


class Nobody(Exception):
    """Nobody listens there."""


class Refused(Exception):
    """It cannot be connected to; the text says why and what to do. `final`: no use in trying."""

    def __init__(self, text: str, final: bool = False) -> None:
        super().__init__(text)
        self.final = final


def dial(path: str) -> socket.socket:
    """A connected socket that does not block; on a local socket that works at once or not at all.

    Raises Nobody and Refused.
    """
    address = os.fsencode(path)
    if len(address) > PATH_BYTES_MAX:
        raise Refused(f"the socket's path has {len(address)} bytes, and only {PATH_BYTES_MAX} "
                      f"are possible: choose a shorter one with SKIND_SOCKET ({path})", final=True)
    try:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.setblocking(False)
            connection.connect(address)
        except BaseException:
            connection.close()
            raise
    except OSError as error:
        raise _explain(error, path) from None
    return connection


def _explain(error: OSError, path: str) -> Exception:
    if error.errno in (errno.ENOENT, errno.ECONNREFUSED):
        return Nobody()
    if error.errno == errno.EAGAIN:
        return Refused("too many programs want to connect to skind just now: it is tried again")
    if error.errno in (errno.EACCES, errno.EPERM):
        return Refused(f"the system forbids to connect to {path}: look whose file that is, or "
                       "choose another path with SKIND_SOCKET")
    return Refused(f"cannot connect to {path}: {error.strerror or error}; look what is there, or "
                   "choose another path with SKIND_SOCKET")


class Retry:
    """When to try again: 0.1 s after a failure, then doubling up to 2 s; after a loss at once."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._pause_s = FIRST_S
        self._due_at = 0.0
        self._lost_at = float("-inf")

    @property
    def is_due(self) -> bool:
        return self._clock() >= self._due_at

    def reset(self) -> None:
        """The pauses begin anew with the short one."""
        self._pause_s = FIRST_S

    def lost(self) -> None:
        """What had worked was lost: at once, but not for ever at once if it is lost each time."""
        if self._clock() - self._lost_at >= LAST_S:
            self._pause_s = 0.0
        self._lost_at = self._clock()

    def pause(self, least_s: float = 0.0) -> None:
        """The next pause begins now; it lasts at least so long."""
        self._pause_s = max(self._pause_s, least_s)
        self._due_at = self._clock() + self._pause_s
        self._pause_s = min(max(2 * self._pause_s, FIRST_S), LAST_S)
