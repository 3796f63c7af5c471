# SPDX-License-Identifier: GPL-3.0-or-later
"""The sculpted character as glTF.

A session that was joined from a glTF file is written by the daemon: the same file but for its
weights. One that began in Blender is written by Blender's own exporter.
"""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import Iterator

import bpy

from . import connection, jobs, rig
from .messages import tell


def export(session, path: str):
    """Job: writes the file, and tells where it is."""
    yield from session.settle()
    if session.sculpt.source:
        if connection.channel().state != "ready":
            raise jobs.Refused("skind is not connected: it alone can write this file")
        answers: list = []
        connection.channel().request("session.export", {"session": session.sculpt.name, "path": path},
                                  lambda *answer: answers.append(answer))
        while not answers:
            yield jobs.WAIT
        result, error = answers[0]
        if error is not None:
            raise jobs.Refused(str(error))
        path = result["path"]
    else:
        yield from _by_blender(session, path)
    tell(f"Wrote {path}, {os.path.getsize(path) / 1e6:.1f} MB.")


def _by_blender(session, path: str):
    exporter = bpy.ops.export_scene.gltf
    try:
        known = exporter.get_rna_type().properties
    except KeyError:
        raise jobs.Refused("Blender's glTF exporter is switched off: enable \"glTF 2.0 format\" in "
                           "Preferences > Add-ons") from None
    options = {"export_all_influences": True} if "export_all_influences" in known else {}
    yield 0.5  # the panel can say so before Blender stands still
    obj = session.object()
    with _selected([obj, rig.armature_of(obj)]):
        try:
            exporter(filepath=path, use_selection=True, **options)
        except (RuntimeError, AttributeError) as error:
            raise jobs.Refused(f"Blender's glTF exporter failed: {error}") from None


@contextmanager
def _selected(objects: list[bpy.types.Object]) -> Iterator[None]:
    """These alone are selected, which hidden ones cannot be; then all is as it was, and in the mode
    that it was in, which the exporter leaves."""
    layer, active = bpy.context.view_layer, bpy.context.view_layer.objects.active
    mode = active.mode if active is not None else 'OBJECT'
    chosen = [each for each in layer.objects if each.select_get()]
    hidden = [(each, each.hide_get(), each.hide_viewport) for each in objects]
    try:
        for each in objects:
            each.hide_viewport = False
            each.hide_set(False)
        for each in layer.objects:
            each.select_set(each in objects)
        yield
    finally:
        if active is not None and active.mode != mode:
            bpy.ops.object.mode_set(mode=mode)
        for each, eye, viewport in hidden:
            each.hide_set(eye)
            each.hide_viewport = viewport
        for each in layer.objects:
            each.select_set(each in chosen)
