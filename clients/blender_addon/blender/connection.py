# SPDX-License-Identifier: GPL-3.0-or-later
"""This Blender's one connection to skind: made on first use, pumped by the timer.

It finds a daemon that runs. Only when the artist wants something of it, need(), is one started.
"""

from __future__ import annotations

import secrets
import time

import bpy

from ..core.channel import Channel
from ..core.launch import Launcher
from . import preferences

TAG = secrets.token_hex(3)
FAREWELL_S = 2.0  # only a daemon that does not answer costs it

_channel: Channel | None = None
_launcher: Launcher | None = None
_sessions: list[dict] = []


def client_name() -> str:
    """Unique: updates that we caused ourselves come back under it. Not by the process's number,
    which is the same for Blenders in containers."""
    return f"Blender {bpy.app.version_string.split()[0]} ({TAG})"


def channel() -> Channel:
    """The connection, opened on first use. It mends itself; see core/channel.py."""
    global _channel, _launcher
    if _channel is None:
        path = preferences.socket_path()
        _launcher = Launcher(path, preferences.candidates())
        _channel = Channel(path, name=client_name(), version=bpy.app.version_string,
                           user=preferences.person())
        _channel.open()
    return _channel


def need() -> None:
    """From here on a daemon is started where none runs."""
    channel().launcher = _launcher
    channel().open()


def release() -> None:
    """No daemon is needed: one that somebody stops stays stopped."""
    if _channel is not None:
        _channel.launcher = None


def is_made() -> bool:
    return _channel is not None


def ask_sessions() -> None:
    """Asks which sessions there are; available() tells when the answer has come."""
    def answered(result: dict | None, error: Exception | None) -> None:
        if result is not None:
            _sessions[:] = result["sessions"]

    if channel().state == "ready":
        channel().request("session.list", {}, answered)


def available() -> list[dict]:
    """What session.list told last."""
    return _sessions


def close() -> None:
    """Ends the connection, and the daemon with it if we started it and nobody else needs it.

    The one place that waits, for FAREWELL_S at most: Blender is quitting, or the add-on ends.
    """
    global _channel, _launcher
    if _channel is None:
        return
    deadline = time.monotonic() + FAREWELL_S
    _wait_for_answers(deadline)  # to the end of a session, which takes several requests
    if _channel.state == "ready":
        _say_farewell()
        _wait_for_answers(deadline)
    _channel.close()
    _launcher.close()
    _channel = _launcher = None
    _sessions.clear()


def _wait_for_answers(deadline: float) -> None:
    while _channel.unanswered and time.monotonic() < deadline:
        _channel.pump(0.01)
        time.sleep(0.001)


def _say_farewell() -> None:
    def answered(stats: dict | None, error: Exception | None) -> None:
        if stats and _launcher.started and stats["connections"] == 1 and stats["sessions"] == 0:
            _channel.request("shutdown")

    _channel.request("stats", {}, answered)
