# SPDX-License-Identifier: GPL-3.0-or-later
"""The one sculpting session of this Blender: how it begins, is found, and ends with Blender."""

from __future__ import annotations

import bpy

from ..core import opening
from . import checks, connection, jobs, mesh
from .connection import ask_sessions, available
from .messages import fault, tell, told
from .sculpting import Session

_current: Session | None = None


def current() -> Session | None:
    return _current


def channel():
    """This Blender's connection, with its callbacks set."""
    made = connection.is_made()
    link = connection.channel()
    if not made:
        link.on_ready, link.on_lost, link.on_notification = _ready, _lost, _notice
        link.on_error = fault
    return link


def connect() -> None:
    """The artist asks for the connection: a daemon is started if none runs."""
    channel()
    connection.need()
    ask_sessions()


def _ready() -> None:
    ask_sessions()
    if _current is not None and _current.sculpt is not None and _current.sculpt.phase == "lost":
        opening.resume(_current.sculpt)


def _lost(reason: str) -> None:
    if _current is not None and _current.sculpt is not None:
        _current.sculpt.lost()


def _notice(message) -> None:
    if _current is not None and _current.sculpt is not None:
        _current.sculpt.notice(message)


def face() -> tuple:
    """What the panel shows, in short: it is drawn again when this changes."""
    job = jobs.current()
    link = connection.channel() if connection.is_made() else None
    live = _current.face() if _current is not None else ()
    return (told(), link and (link.state, link.problem), len(available()), live,
            job and (job.label, job.progress and round(job.progress, 1)))


def is_busy() -> bool:
    """Something is under way that the next tick should go on with soon."""
    link = connection.channel() if connection.is_made() else None
    return jobs.current() is not None or bool(link and (link.unanswered or link.unsent_bytes))


# ---- beginning ----


def start(context: bpy.types.Context) -> list[str]:
    """Begins a session on the active mesh. Returns why not, or [] when it is under way."""
    obj, settings = context.active_object, context.scene.skind
    refusals = _occupied() or checks.refusals(obj, settings)
    if not refusals:
        session = _take(obj.name)
        session.run(session.start(int(settings.influences), settings.reduce, settings.durability),
                    "Starting")
    return refusals


def join(context: bpy.types.Context, name: str) -> list[str]:
    """Joins a session that another tool holds, with the active mesh. Returns as start() does."""
    obj, settings = context.active_object, context.scene.skind
    refusals = _occupied() or checks.refusals(obj, settings, any_influences=True)
    if not refusals:
        session = _take(obj.name)
        session.run(session.join(name), f"Joining {name}")
    return refusals


def rejoin(context: bpy.types.Context) -> list[str]:
    """Goes on with the session that the active mesh was saved in."""
    obj = context.active_object
    name = remembered(obj)
    if name is None:
        return ["This mesh was not saved in a session."]
    settings = context.scene.skind
    refusals = _occupied() or checks.refusals(obj, settings, any_influences=True, own_keys=True)
    if not refusals:
        session = _take(obj.name)
        session.run(session.rejoin(name, int(settings.influences), settings.durability),
                    f"Rejoining {name}")
    return refusals


def remembered(obj: bpy.types.Object | None) -> str | None:
    """The session that this mesh was in when its file was saved, if it is not in it now."""
    if obj is None or obj.type != 'MESH' or _current is not None:
        return None
    return obj.data.get(mesh.SESSION)


def forget(context: bpy.types.Context) -> None:
    """Leaves the mesh as it is, and its old session be."""
    mesh.unmark(context.active_object.data)


def _occupied() -> list[str]:
    if _current is None:
        return []
    return [f"\"{_current.object_name}\" is being sculpted: Finish or Cancel that first."]


def _take(object_name: str) -> Session:
    global _current
    tell("")
    channel()
    connection.need()
    _current = Session(object_name, _let_go)
    return _current


def _let_go() -> None:
    global _current
    _current = None
    connection.release()


def drop(remember: bool) -> None:
    """Lets the session go and leaves the mesh whole: quitting, or another file.

    `remember`: the mesh stays, and gets what Cancel will need after a Rejoin.
    """
    jobs.clear()
    session = _current
    if session is None:  # or no longer: its job was to begin it, or to end it
        return
    _let_go()
    session.landing.put_back()
    if remember and session.is_marked:
        session.remember()
    if session.sculpt is not None:
        opening.leave(session.sculpt)


def unregister() -> None:
    drop(remember=True)
    connection.close()
