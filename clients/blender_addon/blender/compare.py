# SPDX-License-Identifier: GPL-3.0-or-later
"""Before and after: hold to compare, a switch, and the clip played with either weights.

Three operators, one key (Y in the 3D viewport, free in Blender's own key map there), and the big
word on top of the viewport that tells which weights are seen. Which they are is the session's to
know; this module owns only what playing the clip changed in the scene, and puts it back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import bpy
import gpu

from . import drawing, rig, session
from .properties import redraw_views

HOLD_KEY = 'Y'
# What still does its work while the key is held: looking around, and playing.
PASSED = {'MOUSEMOVE', 'INBETWEEN_MOUSEMOVE', 'MIDDLEMOUSE', 'WHEELUPMOUSE', 'WHEELDOWNMOUSE',
          'TRACKPADPAN', 'TRACKPADZOOM', 'NDOF_MOTION', 'TIMER', 'LEFT_SHIFT', 'LEFT_CTRL',
          'LEFT_ALT', 'RIGHT_SHIFT', 'RIGHT_CTRL', 'RIGHT_ALT'}


def _is_ready() -> bool:
    live = session.current()
    return live is not None and live.is_ready and not live.is_stroking


def _show(before: bool) -> None:
    live = session.current()
    if live is not None:
        live.show(before)
    redraw_views()


class SKIND_OT_compare(bpy.types.Operator):
    """See the weights as they were at Start, for as long as you hold the button or the key"""

    bl_idname = "skind.compare"
    bl_label = "Hold to Compare"

    button: bpy.props.StringProperty(
        description="What is held, when it is not what called: a button of the panel says so",
        options={'HIDDEN', 'SKIP_SAVE'})

    _timer: bpy.types.Timer | None = None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _is_ready()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.button and event.value != 'PRESS':  # the search menu's: nothing to hold
            return self.execute(context)
        if self.button:
            self._timer = context.window_manager.event_timer_add(WATCH_S / 4,
                                                                 window=context.window)
        self.button = self.button or event.type
        _show(True)
        context.window_manager.modal_handler_add(self)
        return {'RUNNING_MODAL'}

    def execute(self, context: bpy.types.Context) -> set[str]:
        _show(not session.current().shown_before)
        return {'FINISHED'}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # A button of the panel keeps its release to itself: the timer's events tell of it after.
        released = {(event.type, event.value), (event.type_prev, event.value_prev)}
        if ((self.button, 'RELEASE') in released or event.type in {'ESC', 'WINDOW_DEACTIVATE'}
                or session.current() is None):
            self.cancel(context)
            return {'FINISHED', 'PASS_THROUGH'}
        return {'PASS_THROUGH'} if event.type in PASSED else {'RUNNING_MODAL'}

    def cancel(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        _show(False)


class SKIND_OT_show_before(bpy.types.Operator):
    """Switch between the weights as they were at Start and as they are now"""

    bl_idname = "skind.show_before"
    bl_label = "Before / After"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _is_ready()

    def execute(self, context: bpy.types.Context) -> set[str]:
        _show(not session.current().shown_before)
        return {'FINISHED'}


# ---- the clip ----

@dataclass(frozen=True)
class Clip:
    """What playing changed in a scene, as it was before."""

    scene_name: str
    frame: int
    uses_preview: bool
    preview: tuple[int, int]


WATCH_S = 0.2
_clip: Clip | None = None


def _frames(armature: bpy.types.Object | None) -> tuple[int, int] | None:
    """The first and last frame of the armature's action; None: it has none."""
    animation = armature.animation_data if armature is not None else None
    if animation is None or animation.action is None:
        return None
    first, last = animation.action.frame_range
    return (round(first), round(last)) if last > first else None


def is_playing() -> bool:
    """The clip runs, started by us. Opening another file ends the watch, and with it the clip."""
    return _clip is not None and bpy.app.timers.is_registered(_watch)


class SKIND_OT_play_clip(bpy.types.Operator):
    """Play the armature's action from its beginning, or stop it; compare while it runs"""

    bl_idname = "skind.play_clip"
    bl_label = "Play the Clip"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _is_ready()

    def execute(self, context: bpy.types.Context) -> set[str]:
        was_ours = is_playing()
        if context.screen.is_animation_playing:
            bpy.ops.screen.animation_cancel(restore_frame=False)
        if was_ours:
            _end()
            return {'FINISHED'}
        frames = _frames(rig.armature_of(session.current().object()))
        if frames is None:
            self.report({'WARNING'}, "The armature has no action: nothing to play.")
            return {'CANCELLED'}
        _begin(context.scene, frames)
        bpy.ops.screen.animation_play()
        bpy.app.timers.register(_watch, first_interval=WATCH_S)
        return {'FINISHED'}


def _begin(scene: bpy.types.Scene, frames: tuple[int, int]) -> None:
    global _clip
    _clip = Clip(scene.name, scene.frame_current, scene.use_preview_range,
                 (scene.frame_preview_start, scene.frame_preview_end))
    _set_preview(scene, True, frames)
    scene.frame_set(frames[0])


def _set_preview(scene: bpy.types.Scene, is_used: bool, frames: tuple[int, int]) -> None:
    scene.use_preview_range = True  # setting the ends switches it on in any case
    # The ends push each other along: the last first, then what it pushed.
    scene.frame_preview_end = frames[1]
    scene.frame_preview_start = frames[0]
    scene.frame_preview_end = frames[1]
    scene.use_preview_range = is_used


def _end() -> None:
    if bpy.app.timers.is_registered(_watch):
        bpy.app.timers.unregister(_watch)
    _put_back()


def _put_back() -> None:
    global _clip
    if _clip is None:
        return
    clip, _clip = _clip, None
    scene = bpy.data.scenes.get(clip.scene_name)
    if scene is not None:
        _set_preview(scene, clip.uses_preview, clip.preview)
        scene.frame_set(clip.frame)


def _watch() -> float | None:
    """A timer, as long as the clip runs: notices that the space bar or Esc stopped it."""
    windows = bpy.context.window_manager.windows
    if _clip is not None and any(window.screen.is_animation_playing for window in windows):
        return WATCH_S
    _put_back()
    redraw_views()
    return None


# ---- the word on top ----

BEFORE_COLOUR = (1.0, 0.72, 0.20, 1.0)
AFTER_COLOUR = (0.45, 0.85, 1.0, 1.0)
BACKGROUND = (0.08, 0.08, 0.08, 0.82)
MUTED = (0.85, 0.85, 0.85, 1.0)
WORD_SIZE, HINT_SIZE = 34, 13


def _draw_word() -> None:
    """POST_PIXEL. A fault here is told and leaves the viewport alone."""
    try:
        live = session.current()
        if live is None or not (live.shown_before or is_playing()):
            return
        gpu.state.blend_set('ALPHA')
        try:
            draw_word(bpy.context, live.shown_before)
        finally:
            gpu.state.blend_set('NONE')
    except Exception as error:
        session.fault(error)


def draw_word(context: bpy.types.Context, before: bool) -> None:
    unit = drawing.scale()
    word, colour = ("BEFORE", BEFORE_COLOUR) if before else ("AFTER", AFTER_COLOUR)
    hint = "weights as they were at Start" if before else f"weights now; hold {HOLD_KEY}: before"
    widths = (drawing.text_width(word, WORD_SIZE * unit),
              drawing.text_width(hint, HINT_SIZE * unit))
    left, _, right, top = drawing.free_area(context.area, context.region)
    middle = (left + right) / 2
    width, height = max(widths) + 32 * unit, 72 * unit
    bottom = top - height - 12 * unit
    drawing.box(middle - width / 2, bottom, width, height, BACKGROUND)
    drawing.text(middle - widths[0] / 2, bottom + 34 * unit, word, WORD_SIZE * unit, colour)
    drawing.text(middle - widths[1] / 2, bottom + 12 * unit, hint, HINT_SIZE * unit, MUTED)


# ---- the button that can be held ----

def _get_held(_) -> bool:
    live = session.current()
    return live is not None and live.shown_before


def _set_held(_, is_pressed: bool) -> None:
    """A toggle's button acts on press, so there is a release to wait for.

    Calling the operator from within the button would press it again, without an end.
    """
    if is_pressed and _is_ready():
        bpy.app.timers.register(partial(_hold, bpy.context.window), first_interval=0.0)


def _hold(window: bpy.types.Window) -> None:
    """A timer's function, once; a timer's context has no window."""
    with bpy.context.temp_override(window=window):
        bpy.ops.skind.compare('INVOKE_DEFAULT', button='LEFTMOUSE')


def draw_buttons(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The row for the panel: hold, switch, play."""
    live = session.current()
    column = layout.column(align=True)
    column.enabled = _is_ready()
    column.prop(context.window_manager, "skind_hold_before", toggle=True, icon='HIDE_OFF',
                text=f"Hold to See Before ({HOLD_KEY})")
    # One below the other: beside each other they do not fit into a sidebar of the usual width.
    column.operator("skind.show_before", icon='ARROW_LEFTRIGHT',
                    depress=live is not None and live.shown_before)
    column.operator("skind.play_clip", text="Stop" if is_playing() else "Play the Clip",
                    icon='PAUSE' if is_playing() else 'PLAY')


CLASSES = (SKIND_OT_compare, SKIND_OT_show_before, SKIND_OT_play_clip)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)
_handlers: list = []
_keys: list = []


def register() -> None:
    _register_classes()
    bpy.types.WindowManager.skind_hold_before = bpy.props.BoolProperty(
        name="Hold to See Before",
        description="The weights as they were at Start, for as long as you hold the button",
        get=_get_held, set=_set_held, options={'SKIP_SAVE'})
    if bpy.app.background:
        return
    _handlers.append(bpy.types.SpaceView3D.draw_handler_add(_draw_word, (), 'WINDOW',
                                                            'POST_PIXEL'))
    keymap = bpy.context.window_manager.keyconfigs.addon.keymaps.new("3D View",
                                                                     space_type='VIEW_3D')
    _keys.append((keymap, keymap.keymap_items.new(SKIND_OT_compare.bl_idname, HOLD_KEY, 'PRESS')))


def unregister() -> None:
    if is_playing():
        _end()
    for keymap, item in _keys:
        keymap.keymap_items.remove(item)
    _keys.clear()
    while _handlers:
        bpy.types.SpaceView3D.draw_handler_remove(_handlers.pop(), 'WINDOW')
    del bpy.types.WindowManager.skind_hold_before
    _unregister_classes()
