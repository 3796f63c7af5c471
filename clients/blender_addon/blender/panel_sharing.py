# SPDX-License-Identifier: GPL-3.0-or-later
"""The box Also Here of the tab: who else is in the session, and who works on what.

As panel.py: reads, draws, and changes nothing.
"""

from __future__ import annotations

import time
from typing import Sequence

import bpy

from ..core.presence import Other
from . import session
from .panel import PARENT, Panel, count, guarded, say

BONES_SHOWN = 4
ICONS = {"Blender": 'BLENDER', "skinctl": 'CONSOLE'}


def ago(seconds: float) -> str:
    """How long something has been, in a word or two."""
    minutes = int(seconds // 60)
    if minutes < 1:
        return "just now"
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 24:
        return f"{hours} h {minutes} min" if minutes else f"{hours} h"
    return count(hours // 24, "day")


def what(bones: Sequence[str], vertices: int) -> str:
    """What a claim names: "Arm.L, Hand.L, 120 vertices"."""
    named = list(bones[:BONES_SHOWN])
    if len(bones) > BONES_SHOWN:
        named.append(f"{len(bones) - BONES_SHOWN} more bones")
    if vertices:
        named.append(count(vertices, "vertex", "vertices"))
    return ", ".join(named)


class SKIND_PT_sharing(Panel, bpy.types.Panel):
    bl_label = "Also Here"
    bl_parent_id = PARENT

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and live.layout is not None and bool(
            live.sculpt.presence.others or live.sculpt.presence.own)

    @guarded
    def draw(self, context: bpy.types.Context) -> None:
        presence = session.current().sculpt.presence
        column = self.layout.column(align=True)
        for other in presence.others:
            self._other(context, column.box().column(align=True), other)
        if presence.own:
            say(context, self.layout, "You claim "
                + what(presence.own.bones, len(presence.own.vertices)), icon='PINNED')
        row = self.layout.row(align=True)
        row.operator_menu_enum("skind.claim", "what", text="Claim")
        if presence.own:
            row.operator("skind.release")

    @staticmethod
    def _other(context: bpy.types.Context, box: bpy.types.UILayout, other: Other) -> None:
        row = box.row()
        row.label(text=other.name, icon=ICONS.get(other.tool.partition(" ")[0], 'USER'))
        since = row.row()
        since.alignment = 'RIGHT'
        since.label(text=ago(time.time() - other.since))
        if other.user:
            box.label(text=other.tool, icon='BLANK1')
        if other.claims:
            say(context, box, f"claims {what(other.bones, other.vertices)}", icon='PINNED',
                margin=76)


CLASSES = (SKIND_PT_sharing,)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
