# SPDX-License-Identifier: GPL-3.0-or-later
"""Seeing each brush stroke begin and end, with Blender's own brushes and keys.

The stroke operator swallows the pen's release, so no modal of ours sees a stroke's end. A macro
does: begin, Blender's stroke, end, bound to the same keys; while there is no session its poll
fails and Blender's own binding comes next. A cancelled stroke (Esc) never reaches the macro's end:
then the watch, a modal that hears events only when the stroke no longer takes them, ends it.
"""

from __future__ import annotations

import bpy

from . import checks, session

WATCH_S = 0.02
KEYS = (({}, 'NORMAL'), ({"ctrl": True}, 'INVERT'), ({"shift": True}, 'SMOOTH'))
TOPOLOGY_BRUSHES = {'SIMPLIFY'}

_keymap_items: list = []


def _session_of(context: bpy.types.Context) -> "session.Session | None":
    """The session of the mesh that is sculpted here; not of one that is undone or over."""
    live, obj = session.current(), context.sculpt_object
    if live is None or obj is None or live.object() != obj:
        return None
    return live if live.layout is None or live.is_ready else None


def refusal(context: bpy.types.Context) -> str:
    """Why this brush cannot be used in a session, or ""."""
    obj, brush = context.sculpt_object, context.tool_settings.sculpt.brush
    if getattr(obj, "use_dynamic_topology_sculpting", False):
        return "Dyntopo changes the mesh's topology: turn it off while you sculpt weights."
    # 5.0 has another name for it.
    kind = getattr(brush, "sculpt_brush_type", None) or getattr(brush, "sculpt_tool", "")
    if kind in TOPOLOGY_BRUSHES:
        return f"The brush \"{brush.name}\" changes the mesh's topology: choose another."
    return checks.problem_since_start(obj, session.current().sculpt.rig.names)


def _occupation(live: "session.Session") -> str:
    """What has to be over before the next stroke, or "". A landing is not: it is hurried up."""
    job = live.job
    if job is None or live.landing.is_doing(job):
        return ""
    return f"{job.label}: sculpt on in a moment."


class SKIND_OT_stroke_begin(bpy.types.Operator):
    """Begin of a stroke that becomes weights"""

    bl_idname = "skind.stroke_begin"
    bl_label = "Begin Stroke"
    bl_options = {'INTERNAL'}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _session_of(context) is not None

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set:
        live = _session_of(context)
        occupation = _occupation(live)
        if occupation:
            self.report({'WARNING'}, occupation)
            return {'CANCELLED'}
        problem = refusal(context)
        if problem:
            self.report({'ERROR'}, problem)
            session.tell(problem)
            return {'CANCELLED'}
        live.show(False)
        live.landing.finish()
        live.is_stroking = True
        bpy.ops.skind.stroke_watch('INVOKE_DEFAULT')
        return {'FINISHED'}


class SKIND_OT_stroke_end(bpy.types.Operator):
    """End of a stroke that becomes weights"""

    bl_idname = "skind.stroke_end"
    bl_label = "End Stroke"
    bl_options = {'INTERNAL'}

    def execute(self, context: bpy.types.Context) -> set:
        _end()
        return {'FINISHED'}


def _end() -> None:
    live = session.current()
    if live is not None and live.is_stroking:
        live.is_stroking = False
        live.solve()


class SKIND_OT_stroke_watch(bpy.types.Operator):
    """Ends a stroke that was cancelled"""

    bl_idname = "skind.stroke_watch"
    bl_label = "Watch Stroke"
    bl_options = {'INTERNAL'}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set:
        manager = context.window_manager
        self._timer = manager.event_timer_add(WATCH_S, window=context.window)
        manager.modal_handler_add(self)
        return {'RUNNING_MODAL'}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set:
        live = session.current()
        is_over = live is None or not live.is_stroking
        if not is_over and (event.type.startswith('TIMER') or event.type == 'WINDOW_DEACTIVATE'):
            return {'PASS_THROUGH'}  # these reach us also while the stroke goes on
        context.window_manager.event_timer_remove(self._timer)
        _end()
        return {'FINISHED', 'PASS_THROUGH'}


class SKIND_OT_stroke(bpy.types.Macro):
    """Sculpt, and let the weights follow"""

    bl_idname = "skind.stroke"
    bl_label = "Sculpt Weights"
    bl_options = {'INTERNAL'}


CLASSES = (SKIND_OT_stroke_begin, SKIND_OT_stroke_end, SKIND_OT_stroke_watch, SKIND_OT_stroke)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register_classes()
    SKIND_OT_stroke.define("SKIND_OT_stroke_begin")
    SKIND_OT_stroke.define("SCULPT_OT_brush_stroke")
    SKIND_OT_stroke.define("SKIND_OT_stroke_end")
    keys = bpy.context.window_manager.keyconfigs.addon
    if keys is None:  # in the background
        return
    keymap = keys.keymaps.new(name='Sculpt', space_type='EMPTY')
    for modifiers, mode in KEYS:
        item = keymap.keymap_items.new("skind.stroke", 'LEFTMOUSE', 'PRESS', **modifiers)
        item.properties.SCULPT_OT_brush_stroke.mode = mode
        _keymap_items.append((keymap, item))


def unregister() -> None:
    for keymap, item in _keymap_items:
        keymap.keymap_items.remove(item)
    _keymap_items.clear()
    _unregister_classes()
