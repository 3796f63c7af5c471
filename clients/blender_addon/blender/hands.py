# SPDX-License-Identifier: GPL-3.0-or-later
"""Is the artist in the middle of something that we must not reach into?

While a modal operator holds the mesh (a stroke, a filter, a gesture), taking back or pushing a step
of undo, or telling Blender that the mesh changed, crashes it. Jobs wait until the hand is lifted.
Main thread; owns nothing but an operator that looks at the last event.
"""

from __future__ import annotations

import bpy

VIEWING = ("VIEW3D_OT_", "VIEW2D_OT_", "SCREEN_OT_")

_last_event = ("", "", "", "")  # type and value, and those of the one before


class SKIND_OT_look_at_hands(bpy.types.Operator):
    """Learns what the last event was: only operators are told"""

    bl_idname = "skind.look_at_hands"
    bl_label = "Look at Hands"
    bl_options = {'INTERNAL'}

    def invoke(self, _context: bpy.types.Context, event: bpy.types.Event) -> set:
        global _last_event
        _last_event = (event.type, event.value, event.type_prev, event.value_prev)
        return {'CANCELLED'}


def are_busy() -> bool:
    """True while something modal goes on, as far as this Blender lets us know."""
    if bpy.app.background:
        return False
    return any(_works_in(window) for window in bpy.context.window_manager.windows)


def _works_in(window: bpy.types.Window) -> bool:
    if hasattr(window, "modal_operators"):  # since 4.2
        return any(_holds_data(each.bl_idname) for each in window.modal_operators)
    # Before, there is only this: something was pressed and not released.
    with bpy.context.temp_override(window=window):
        bpy.ops.skind.look_at_hands('INVOKE_DEFAULT')
    return _last_event[1] == 'PRESS' or (_last_event[2].endswith('MOUSE')
                                         and _last_event[3] == 'PRESS'
                                         and _last_event[0] != _last_event[2])


def _holds_data(idname: str) -> bool:
    """Blender's own tools do, but for those of the view. Another add-on's operator that runs all
    the time (one that shows keys, say) must not keep us waiting for ever."""
    is_pythons = bpy.types.Operator.bl_rna_get_subclass_py(idname) is not None
    return not is_pythons and not idname.startswith(VIEWING)


register, unregister = bpy.utils.register_classes_factory((SKIND_OT_look_at_hands,))
