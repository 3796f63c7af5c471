# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend that is saved in the middle of a session, and one that is opened.

What is saved is whole: the rest shape, the weights answered, the session's name, and the snapshot
that Cancel needs, which lies in the mesh only while the file is written.
"""

from __future__ import annotations

import bpy

from . import jobs, mesh, session, shapes

_sculpted: list = []  # the shape to show again after saving: object's name, positions


@bpy.app.handlers.persistent
def _before_save(*_: object) -> None:
    _sculpted.clear()
    jobs.drain()
    live = session.current()
    if live is None or live.layout is None or live.is_outside or not live.is_whole:
        return
    data = live.object().data
    shape = mesh.read_positions(data)
    live.landing.put_back()
    live.remember()
    _sculpted[:] = [(live.object().name, shape)]
    if not hasattr(bpy.app.handlers, "save_post_fail"):  # the next moment after one that failed
        bpy.app.timers.register(_after_save, first_interval=0.0)


@bpy.app.handlers.persistent
def _after_save(*_: object) -> None:
    """After a save that failed, too."""
    for name, shape in _sculpted:
        data = bpy.data.objects[name].data
        for mark in mesh.SAVED:
            del data[mark]
        shapes.write_positions(data, shape)
    _sculpted.clear()


@bpy.app.handlers.persistent
def _before_load(*_: object) -> None:
    session.drop(remember=False)


HANDLERS = (("save_pre", _before_save), ("save_post", _after_save), ("load_pre", _before_load))


def register() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)
    if hasattr(bpy.app.handlers, "save_post_fail"):  # since 3.6: a full disk
        bpy.app.handlers.save_post_fail.append(_after_save)


def unregister() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    if hasattr(bpy.app.handlers, "save_post_fail"):
        bpy.app.handlers.save_post_fail.remove(_after_save)
