# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's tab "Skind": reads the session's state and draws it; owns and changes nothing.

Drawing happens at any time and often: it never asks the daemon, never walks the mesh, and a fault
in it becomes a line in the panel.
"""

from __future__ import annotations

import functools
import traceback
from typing import Callable

import blf
import bpy

from ..core.channel import NOT_RUNNING
from . import compare, operators, session

PARENT = "SKIND_PT_main"

LINK = {  # the channel's state -> icon and words
    "closed": ('UNLINKED', "Not connected"),
    "connecting": ('SORTTIME', "Connecting"),
    "starting": ('SORTTIME', "Starting skind"),
    "greeting": ('SORTTIME', "Connecting"),
    "ready": ('LINKED', "Connected"),
    "waiting": ('ERROR', "Not connected"),
}

OVERLAYS = ("RESIDUAL", "CHANGE", "INFLUENCES", "REACH")


def tag_redraw() -> None:
    """Asks for the sidebars to be drawn again."""
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            for area in window.screen.areas:
                if area.type == 'VIEW_3D':
                    for region in area.regions:
                        if region.type == 'UI':
                            region.tag_redraw()


# ---- text that fits ----


@functools.lru_cache(maxsize=256)
def _wrapped(text: str, width: int, size: float) -> tuple[str, ...]:
    """Lines of at most `width` pixels in the interface's font of `size` pixels."""
    if bpy.app.version >= (4, 0, 0):
        blf.size(0, size)
    else:
        blf.size(0, size, 72)
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and blf.dimensions(0, longer)[0] <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return tuple(lines)


def _wrap(context: bpy.types.Context, text: str, margin: float) -> tuple[str, ...]:
    """`margin`: what is not for text, in units of the interface."""
    scale = context.preferences.system.ui_scale
    points = context.preferences.ui_styles[0].widget.points
    region = context.region
    width = (region.width if region is not None else 220) - int(margin * scale)
    return _wrapped(text, max(width, 60), points * scale)


def say(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = 'NONE',
        alert: bool = False, margin: float = 58) -> None:
    """A sentence, over as many lines as the panel's width needs."""
    column = layout.column(align=True)
    column.alert = alert
    column.scale_y = 0.75
    for index, line in enumerate(_wrap(context, text, margin + 22 * (icon != 'NONE'))):
        column.label(text=line, icon=icon if index == 0 else 'NONE' if icon == 'NONE' else 'BLANK1')


def count(number: int, thing: str, things: str = "") -> str:
    return f"{number:,} {thing if number == 1 else things or thing + 's'}"


def _length(context: bpy.types.Context, thing: bpy.types.Object | None, value: float) -> str:
    """A length in the mesh's units, as the scene's units show it."""
    if thing is not None:
        value *= thing.matrix_world.median_scale
    units = context.scene.unit_settings
    if units.system == 'NONE':
        return f"{value:.3g}"
    return bpy.utils.units.to_string(units.system, 'LENGTH', value * units.scale_length,
                                     precision=2, compatible_unit=True)


def guarded(draw: Callable) -> Callable:
    """A draw method that says in the panel what went wrong in it."""
    @functools.wraps(draw)
    def wrapper(self: bpy.types.Panel, context: bpy.types.Context) -> None:
        try:
            draw(self, context)
        except Exception as error:
            traceback.print_exc()
            self.layout.label(text=f"{type(error).__name__}: {error}", icon='ERROR')
    return wrapper


# ---- the panel ----


class Panel:
    bl_space_type = 'VIEW_3D'
    bl_region_type = 'UI'
    bl_category = "Skind"


class SKIND_PT_main(Panel, bpy.types.Panel):
    bl_label = "Skind"

    @guarded
    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        _draw_link(context, layout)
        live = session.current()
        if live is None:
            _draw_idle(context, layout)
        else:
            _draw_sculpting(context, layout, live)


def _draw_link(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    channel = session.channel()
    icon, words = LINK.get(channel.state, ('QUESTION', channel.state))
    if channel.state == "ready":
        server = channel.hello.get("server", {})
        words = f"skind {server.get('version', '')} is ready"
    if channel.problem == NOT_RUNNING:  # as it should be: nobody has needed it yet
        layout.label(text="Start also starts skind", icon='UNLINKED')
        return
    layout.label(text=words, icon=icon)
    if channel.problem:
        say(context, layout, channel.problem, alert=True)
    if channel.state in ("closed", "waiting"):
        layout.operator("skind.refresh", text="Try Again", icon='FILE_REFRESH')


def _draw_idle(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    thing = context.active_object
    remembered = session.remembered(thing)
    if remembered:
        box = layout.box()
        say(context, box, f"This file was saved while “{remembered}” was sculpted.",
            icon='FILE_TICK', margin=76)
        row = box.row(align=True)
        row.operator("skind.rejoin", icon='FILE_REFRESH')
        row.operator("skind.forget", icon='X')
    column = layout.column()
    column.scale_y = 1.6
    column.operator("skind.start", icon='SCULPTMODE_HLT')
    if thing is None or thing.type != 'MESH':
        say(context, layout, "Select the mesh of a posed character.", icon='INFO')
    for sentence in operators.refusals(context):
        say(context, layout, sentence, icon='ERROR', alert=True)
    _draw_message(context, layout)
    _draw_sessions(layout)


def _draw_sessions(layout: bpy.types.UILayout) -> None:
    column = layout.column(align=True)
    row = column.row(align=True)
    row.label(text="Join a session")
    row.operator("skind.refresh", text="", icon='FILE_REFRESH')
    sessions = session.available()
    if not sessions:
        column.label(text="No other tool holds one", icon='BLANK1')
    for held in sessions:
        row = column.row(align=True)
        row.operator("skind.join", text=held["session"], icon='COMMUNITY').name = held["session"]
        row.label(text=count(held["vertices"], "vertex", "vertices"))


def _draw_sculpting(context: bpy.types.Context, layout: bpy.types.UILayout,
                    live: session.Session) -> None:
    thing = live.object()
    box = layout.box()
    column = box.column(align=True)
    column.label(text=live.object_name, icon='OUTLINER_OB_MESH' if thing else 'ERROR')
    if thing is None:
        say(context, box, "The mesh is gone; undo brings it back.", alert=True, margin=76)
    if live.layout is not None:
        _draw_session(context, column, live, thing)
    if live.is_outside:
        say(context, box, "Undone to before Start; redo comes back.", icon='INFO', margin=76)
    _draw_message(context, layout)
    _draw_work(layout, live.job)
    if live.layout is None:
        return
    if live.job is None and live.sculpt.pending:
        layout.operator("skind.cancel_work", text="Cancel Pending", icon='X')
    column = layout.column(align=True)
    row = column.row(align=True)
    row.scale_y = 1.4
    row.operator("skind.finish", icon='CHECKMARK')
    row.operator("skind.cancel", text="Cancel", icon='LOOP_BACK')
    column.operator("skind.solve", icon='MOD_SMOOTH')
    column.menu("SKIND_MT_weights", icon='MOD_VERTEX_WEIGHT')
    column.operator("skind.export", text="Export glTF…", icon='EXPORT')


def _draw_session(context: bpy.types.Context, column: bpy.types.UILayout, live: session.Session,
                  thing: bpy.types.Object | None) -> None:
    sculpt = live.sculpt
    if sculpt.name != live.object_name:
        column.label(text=f"Session {sculpt.name}", icon='BLANK1')
    column.label(text=count(sculpt.strokes, "stroke"), icon='BRUSH_DATA')
    if sculpt.pending:
        column.label(text=f"{len(sculpt.pending)} pending", icon='SORTTIME')
    if sculpt.unkept:
        say(context, column, "Strokes are not kept on the disk until it can be written again: make "
            f"room there ({sculpt.unkept}).", icon='ERROR', alert=True, margin=76)
    if sculpt.damage:
        say(context, column, f"The session's file was damaged: {sculpt.damage}", icon='ERROR',
            alert=True, margin=76)
    _draw_last(context, column, sculpt.last, thing)


def _draw_last(context: bpy.types.Context, column: bpy.types.UILayout, last: dict,
               thing: bpy.types.Object | None) -> None:
    """The last stroke: what it cost, what it won, and what stayed out of reach."""
    if not last:
        return
    column.label(text=f"{count(last['vertices'], 'vertex', 'vertices')} "
                      f"in {1000 * last['seconds']:.0f} ms", icon='TIME')
    before, after = (_length(context, thing, last["residual"][when]["mean"])
                     for when in ("before", "after"))
    column.label(text=f"Off by {before} → {after}", icon='FULLSCREEN_EXIT')
    if last["unreached"]:
        row = column.row()
        row.alert = True
        row.label(text=f"{last['unreached']:,} out of reach", icon='ERROR')
    for key, words in (("slots_changed", "use other bones"), ("rest_moved", "moved at rest"),
                       ("shaped", "in the shape key")):
        if last[key]:
            column.label(text=f"{last[key]:,} {words}", icon='BLANK1')


def _draw_message(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    if session.told():
        say(context, layout, session.told(), icon='INFO')


def _draw_work(layout: bpy.types.UILayout, job: object | None) -> None:
    """What takes long: its name, how far it is, and a way to stop it."""
    if job is None:
        return
    row = layout.row(align=True)
    if job.progress is None:
        row.label(text=job.label, icon='SORTTIME')
    elif hasattr(row, "progress"):  # since 4.0
        row.progress(factor=job.progress, text=f"{job.label} {job.progress:.0%}")
    else:
        row.label(text=job.label, icon='SORTTIME')
        full = round(job.progress * 5)
        row.label(text=f"{'▮' * full}{'▯' * (5 - full)} {job.progress:.0%}")
    row.operator("skind.cancel_work", text="", icon='X')


# ---- seeing ----


class SKIND_PT_seeing(Panel, bpy.types.Panel):
    bl_label = "Seeing"
    bl_parent_id = PARENT

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and live.layout is not None

    @guarded
    def draw(self, context: bpy.types.Context) -> None:
        settings, live = context.scene.skind, session.current()
        grid = self.layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
        for overlay in OVERLAYS:
            grid.prop_enum(settings, "overlay", overlay)
        self.layout.prop_enum(settings, "overlay", 'NONE')
        armature = next((modifier.object for modifier in live.object().modifiers
                         if modifier.type == 'ARMATURE' and modifier.object is not None),
                        None) if live.object() is not None else None
        if settings.overlay == 'REACH' and armature is not None:
            self.layout.prop_search(settings, "overlay_bone", armature.data, "bones", text="")
        compare.draw_buttons(self.layout, context)


# ---- notes ----


class SKIND_PT_notes(Panel, bpy.types.Panel):
    bl_label = "Notes"
    bl_parent_id = PARENT
    bl_options = {'DEFAULT_CLOSED'}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and live.layout is not None and bool(live.sculpt.notes)

    @guarded
    def draw(self, context: bpy.types.Context) -> None:
        say(context, self.layout, "What was mended when the session began:")
        for note in session.current().sculpt.notes:
            say(context, self.layout, f"{note.get('text', '')} ({note.get('count', 0):,})",
                icon='DOT')


CLASSES = (SKIND_PT_main, SKIND_PT_seeing, SKIND_PT_notes)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
