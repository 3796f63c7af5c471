# SPDX-License-Identifier: GPL-3.0-or-later
"""Connecting without waiting, `dial`; what hello has to show; the pauses between tries, `Retry`.

skind is found by its socket's path, or by "tcp:PORT" where it listens on a port of this machine (or
something carries that port to another). No thread, no state beyond a Retry's own.
"""

from __future__ import annotations

import errno
import os
import re
import socket
import struct
from typing import Callable

PATH_BYTES_MAX = 107  # what the system has room for in a socket's address
PORT = re.compile(r"tcp:0*([1-9][0-9]{0,4})")
FIRST_S = 0.1
LAST_S = 2.0


class Nobody(Exception):
    """Nobody listens there."""


class Refused(ConnectionError):
    """It cannot be connected to; the text says why and what to do. `final`: no use in trying."""

    def __init__(self, text: str, final: bool = False) -> None:
        super().__init__(text)
        self.final = final


def usual_socket_path() -> str:
    """Where the daemon of a user listens who chose nothing; the same rule as the daemon's."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime.startswith("/"):
        return f"{runtime}/skind/skind.sock"
    return f"/tmp/skind-{os.getuid()}/skind.sock"


def port_of(path: str) -> int | None:
    """The port of "tcp:PORT"; None: it is a socket's path. Raises Refused."""
    if not path.startswith("tcp:"):
        return None
    match = PORT.fullmatch(path)
    if match is None or int(match[1]) > 65535:
        raise Refused(f"\"{path}\" is not tcp: and a port, 1 to 65535: choose another with "
                      "SKIND_SOCKET", final=True)
    return int(match[1])


def shown(path: str) -> dict:
    """What hello has to show there besides who asks: over TCP the daemon's token. Raises Refused.

    That of $SKIND_TOKEN, or of the file that the user's own daemon has beside its socket.
    """
    port = port_of(path)
    if port is None:
        return {}
    token = os.environ.get("SKIND_TOKEN", "")
    if token:
        return {"token": token}
    file = f"{usual_socket_path()}.token"
    try:
        with open(file, encoding="ascii") as lines:
            token, listens = lines.read(200).split()[:2]
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it does not hold a token and a port"
        raise Refused(f"cannot read skind's token in {file} ({why}): 'skinctl start --tcp {port}' "
                      "makes it; one that is elsewhere goes into SKIND_TOKEN") from None
    if listens != str(port):
        raise Refused(f"the token in {file} is for port {listens}: set SKIND_TOKEN to that of port "
                      f"{port}")
    return {"token": token}


def dial(path: str) -> socket.socket:
    """A connected socket that does not block; on this machine that works at once or not at all.

    Raises Nobody and Refused.
    """
    port = port_of(path)
    if port is not None:
        return _dial_port(port)
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
    owner = owner_of(connection)
    if owner != os.geteuid():  # one in /tmp may be somebody else's, who made it before us
        connection.close()
        raise Refused(f"{path} is a socket of user {owner} and not yours: choose another with "
                      "SKIND_SOCKET", final=True)
    return connection


def owner_of(connection: socket.socket) -> int:
    """The user who listens there."""
    credentials = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
    return struct.unpack("3i", credentials)[1]


def _dial_port(port: int) -> socket.socket:
    try:
        connection = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    except OSError as error:
        raise _explain(error, f"tcp:{port}") from None
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # small messages do not wait
    status = connection.connect_ex(("127.0.0.1", port))
    if status == errno.EINPROGRESS:  # on this machine it is decided by then: ask what came of it
        status = connection.connect_ex(("127.0.0.1", port))
    if status == 0:
        return connection
    connection.close()
    if status == errno.ECONNREFUSED:
        raise Refused(f"nobody listens on port {port} of this machine: 'skinctl start --tcp "
                      f"{port}' does, or choose another place with SKIND_SOCKET")
    if status == errno.EALREADY:
        status = errno.EAGAIN
    raise _explain(OSError(status, os.strerror(status)), f"tcp:{port}")


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
