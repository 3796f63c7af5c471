# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons. Each checks, calls session.py and says what came of it; none waits for anything.

Owns the refusals of the last Start, Join or Rejoin, which the panel shows until the selection
changes.
"""

from __future__ import annotations

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from . import session
from .properties import redraw_views

_refused: tuple[tuple, list[str]] = ((), [])


def _selection(context: bpy.types.Context) -> tuple:
    active = context.active_object
    return (active.name if active is not None else "",
            *sorted(chosen.name for chosen in context.selected_objects))


def refusals(context: bpy.types.Context) -> list[str]:
    """What the last Start, Join or Rejoin refused, if that is still about what is selected."""
    selection, sentences = _refused
    return sentences if selection == _selection(context) else []


class _Refusing:
    """What may be refused: the first sentence goes to the status bar, all of them to the panel."""

    def finish(self, context: bpy.types.Context, sentences: list[str]) -> set[str]:
        global _refused
        _refused = (_selection(context), list(sentences))
        redraw_views()
        if not sentences:
            return {'FINISHED'}
        self.report({'ERROR'}, sentences[0])
        return {'CANCELLED'}


class _Idle(_Refusing):
    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return session.current() is None


class _Sculpting:
    """From when the mesh is in the session: before that, there is only work to stop."""

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and live.layout is not None


class _Solving:
    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and live.is_ready


class SKIND_OT_start(_Idle, bpy.types.Operator):
    """Sculpt the active mesh in its armature's pose; its weights follow each stroke"""

    bl_idname = "skind.start"
    bl_label = "Start"
    bl_options = {'REGISTER'}

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.finish(context, session.start(context))


class SKIND_OT_join(_Idle, bpy.types.Operator):
    """Sculpt the active mesh in a session that another tool holds"""

    bl_idname = "skind.join"
    bl_label = "Join"
    bl_options = {'REGISTER'}

    name: StringProperty(name="Session", description="The session's name")

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.finish(context, session.join(context, self.name))


class SKIND_OT_rejoin(_Idle, bpy.types.Operator):
    """Go on where this file was saved: skind still holds its session, or gets it again"""

    bl_idname = "skind.rejoin"
    bl_label = "Rejoin"
    bl_options = {'REGISTER'}

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.finish(context, session.rejoin(context))


class SKIND_OT_forget(_Idle, bpy.types.Operator):
    """Keep the mesh and its weights as they are, and do not ask again"""

    bl_idname = "skind.forget"
    bl_label = "Forget"
    bl_options = {'REGISTER', 'UNDO'}

    def execute(self, context: bpy.types.Context) -> set[str]:
        session.forget(context)
        return self.finish(context, [])


class SKIND_OT_finish(_Sculpting, bpy.types.Operator):
    """Keep the new weights, put the rest shape back and end sculpting"""

    bl_idname = "skind.finish"
    bl_label = "Finish"
    bl_options = {'REGISTER'}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.current().finish()
        return {'FINISHED'}


class SKIND_OT_cancel(_Sculpting, bpy.types.Operator):
    """Put the mesh and all weights back to what they were before Start"""

    bl_idname = "skind.cancel"
    bl_label = "Cancel Sculpting"
    bl_options = {'REGISTER'}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self, width=320)

    def draw(self, _context: bpy.types.Context) -> None:
        sculpting = session.current()
        strokes = sculpting.sculpt.strokes if sculpting is not None else 0
        column = self.layout.column()
        column.label(text="Everything goes back to what it was before Start.", icon='LOOP_BACK')
        if strokes:
            column.label(text=f"{strokes} stroke{'' if strokes == 1 else 's'} will be lost.",
                         icon='BLANK1')

    def execute(self, _context: bpy.types.Context) -> set[str]:
        sculpting = session.current()
        if sculpting is None:  # it ended while the question was on the screen
            return {'CANCELLED'}
        sculpting.cancel()
        return {'FINISHED'}


class SKIND_OT_export(_Solving, ExportHelper, bpy.types.Operator):
    """Write the character with its new weights as a glTF file"""

    bl_idname = "skind.export"
    bl_label = "Export"
    bl_options = {'REGISTER'}

    filename_ext = ".glb"
    filter_glob: StringProperty(default="*.glb;*.gltf", options={'HIDDEN'})

    def check(self, _context: bpy.types.Context) -> bool:
        if self.filepath.endswith(".gltf"):
            return False
        return ExportHelper.check(self, _context)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        sculpting = session.current()
        if sculpting is None:
            return {'CANCELLED'}
        sculpting.export(bpy.path.abspath(self.filepath))
        return {'FINISHED'}


class SKIND_OT_solve(_Solving, bpy.types.Operator):
    """Solve what was changed without a brush: by a filter, in Edit Mode, by another add-on"""

    bl_idname = "skind.solve"
    bl_label = "Solve the Shape"
    bl_options = {'REGISTER'}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        changed = session.current().solve()
        if not changed:
            self.report({'INFO'}, "Nothing was sculpted since the last stroke.")
            return {'CANCELLED'}
        self.report({'INFO'}, f"{changed:,} vertices are being solved.")
        return {'FINISHED'}


class SKIND_OT_cancel_work(bpy.types.Operator):
    """Give up what is being done at this moment, or strokes that are not solved yet"""

    bl_idname = "skind.cancel_work"
    bl_label = "Stop"
    bl_options = {'REGISTER'}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and (live.job is not None or live.layout is not None)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.current().cancel_pending()
        redraw_views()
        return {'FINISHED'}


class SKIND_OT_refresh(bpy.types.Operator):
    """Connect to skind, and ask which sessions it holds"""

    bl_idname = "skind.refresh"
    bl_label = "Refresh"
    bl_options = {'REGISTER'}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.connect()
        return {'FINISHED'}


CLASSES = (
    SKIND_OT_start, SKIND_OT_join, SKIND_OT_rejoin, SKIND_OT_forget, SKIND_OT_finish,
    SKIND_OT_cancel, SKIND_OT_export, SKIND_OT_solve, SKIND_OT_cancel_work, SKIND_OT_refresh,
)
register, _unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def unregister() -> None:
    global _refused
    _refused = ((), [])
    _unregister_classes()
