# SPDX-License-Identifier: GPL-3.0-or-later
"""The boxes Options and Poses of the tab: what the artist may set, and what is held in which pose.

As panel.py: reads, draws, and changes nothing.
"""

from __future__ import annotations

import bpy

from ..core import options
from . import session
from .panel import PARENT, Panel, count, guarded, say

POSES_SHOWN = 8


class SKIND_PT_options(Panel, bpy.types.Panel):
    bl_label = "Options"
    bl_parent_id = PARENT
    bl_options = {'DEFAULT_CLOSED'}

    @guarded
    def draw(self, context: bpy.types.Context) -> None:
        settings = context.scene.skind
        hello = session.channel().hello
        layout = self.layout
        if not hello:
            say(context, layout, options.reason("keep", hello), icon='INFO')
        Options(context, layout, settings, hello).draw()


class Options:
    """The rows of the options. What skind cannot do is greyed, with the reason below it."""

    def __init__(self, context: bpy.types.Context, layout: bpy.types.UILayout,
                 settings: bpy.types.PropertyGroup, hello: dict) -> None:
        self.context, self.layout, self.settings, self.hello = context, layout, settings, hello

    def draw(self) -> None:
        layout, settings = self.layout, self.settings
        column = layout.column(align=True)
        column.enabled = session.current() is None  # a session's influences are fixed
        self._choice(column, "influences", "Influences")
        column.prop(settings, "reduce")
        self._choice(column, "durability", "Kept when skind dies")
        self._choice(layout.column(align=True), "method", "Method")
        column = layout.column()
        column.active = settings.method == 'exact'  # the thesis knows none of what follows
        self._stiffness(column.column(align=True))
        self._choice(column.column(align=True), "slots", "Bones")
        self.row(column.column(align=True), "smoothing").prop(settings, "smoothing", slider=True)
        row = self.row(column.column(align=True), "mix")
        row.prop(settings, "mix", slider=True)
        row.prop(settings, "use_mask", text="", icon='MOD_MASK')
        self._choice(column.column(align=True), "residual", "Out of reach")
        self._locked()

    def _stiffness(self, column: bpy.types.UILayout) -> None:
        self.row(column, "automatic").prop(self.settings, "automatic", text="Automatic Stiffness")
        row = column.row(align=True)
        row.active = not (self.settings.automatic and self.can("automatic"))
        row.prop(self.settings, "stiffness")
        live = session.current()
        if live is not None and live.sculpt is not None and live.sculpt.last and not row.active:
            column.label(text=f"Chosen last: {live.sculpt.last['stiffness']:.2g}")

    def can(self, option: str) -> bool:
        # What is chosen before Start may be chosen before skind runs, which Start may start.
        return options.can(option, self.hello.get("capabilities", ())) or (
            not self.hello and option.startswith(("influences.", "durability.")))

    def row(self, column: bpy.types.UILayout, option: str) -> bpy.types.UILayout:
        """A row for one option that may be greyed, the reason below it."""
        row = column.row(align=True)
        row.enabled = self.can(option)
        self._why(column, option)
        return row

    def _why(self, column: bpy.types.UILayout, option: str) -> None:
        reason = options.reason(option, self.hello)
        if self.hello and reason:
            below = column.column()
            below.active = False
            say(self.context, below, reason)

    def _choice(self, column: bpy.types.UILayout, name: str, label: str) -> None:
        """An enumeration as buttons, each greyed by itself."""
        column.label(text=label)
        row = column.row(align=True)
        for item in self.settings.bl_rna.properties[name].enum_items:
            option = f"{name}.{item.identifier}"
            cell = row.row(align=True)
            cell.enabled = self.can(option)
            cell.prop_enum(self.settings, name, item.identifier)
            self._why(column, option)

    def _locked(self) -> None:
        live = session.current()
        thing = live.object() if live is not None else self.context.active_object
        if thing is None or thing.type != 'MESH':
            return
        locked = sum(group.lock_weight for group in thing.vertex_groups)
        column = self.layout.column(align=True)
        column.label(text=f"{count(locked, 'locked group')} of {len(thing.vertex_groups)}",
                     icon='LOCKED' if locked else 'UNLOCKED')
        if locked:
            self._why(column, "locks")
        else:
            say(self.context, column, "Padlocks in the mesh's Vertex Groups list keep a bone's "
                                      "weights as they are.")


# ---- poses ----


class SKIND_PT_poses(Panel, bpy.types.Panel):
    bl_label = "Poses"
    bl_parent_id = PARENT
    bl_options = {'DEFAULT_CLOSED'}

    @guarded
    def draw(self, context: bpy.types.Context) -> None:
        settings, live = context.scene.skind, session.current()
        rows = Options(context, self.layout, settings, session.channel().hello)
        self._keep(rows, settings, live)
        if live is not None and live.layout is not None:
            self._sculpted(live)

    def _keep(self, rows: "Options", settings: bpy.types.PropertyGroup,
              live: "session.Session | None") -> None:
        column = self.layout.column(align=True)
        row = rows.row(column, "keep")
        row.prop(settings, "keep")
        row.operator("skind.keep_again", text="", icon='FILE_REFRESH')
        if not (settings.keep and rows.can("keep")):
            return
        column.prop(settings, "keep_strength", slider=True)
        grid = column.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        grid.prop(settings, "keep_from", expand=True)
        if settings.keep_from == 'CHOSEN':
            column.prop(settings, "keep_frames", text="")
        row = column.row(align=True)
        row.operator("skind.keep_pose", icon='ADD')
        kept = live.kept if live is not None else []
        if kept:
            row.operator("skind.keep_none", text="", icon='X')
        said = count(len(live.sculpt.guard.kept), "pose") if live and live.sculpt else ""
        if said:
            column.label(text=f"{said} kept" + (f", {len(kept)} by hand" if kept else ""),
                         icon='ARMATURE_DATA')

    def _sculpted(self, live: "session.Session") -> None:
        """The poses that were sculpted in, each with its targets."""
        column = self.layout.column(align=True)
        pins = live.sculpt.pins
        column.label(text="Sculpted in" if pins else "Nothing is sculpted in a pose yet")
        for pin in pins[:POSES_SHOWN]:
            box = column.box().column(align=True)
            row = box.row(align=True)
            row.operator("skind.pins_solve", text=pin["pose"], icon='POSE_HLT').pose = pin["pose"]
            row.operator("skind.pins_clear", text="", icon='X').pose = pin["pose"]
            row = box.row(align=True)
            row.label(text=count(pin["vertices"], "vertex", "vertices"))
            weigh = row.operator("skind.pins_weigh", text=f"× {pin['weight']:.3g}")
            weigh.pose, weigh.weight = pin["pose"], pin["weight"]
        if len(pins) > POSES_SHOWN:
            column.label(text=f"and {len(pins) - POSES_SHOWN} more")
        if pins:
            column.operator("skind.pins_clear", text="Forget All Poses").pose = ""


CLASSES = (SKIND_PT_options, SKIND_PT_poses)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
