# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons for what is no stroke: pins, poses to keep, and edits of all weights.

Each asks the session for something and returns at once; what comes of it arrives as a change and is
a step of undo. Owns nothing.
"""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from ..core import options
from . import rig, session
from .properties import redraw_views

AXES = tuple((axis, axis.upper(), f"The mesh's own {axis.upper()} axis") for axis in "xyz")


def _many(number: int, thing: str, things: str) -> str:
    return f"{number:,} {thing if number == 1 else things}"


def _vertices(result: dict) -> str:
    return _many(result["vertices"], "vertex", "vertices")


class _Edit:
    """Polls for a session that takes strokes, and for what skind can do."""

    option = ""

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return (live is not None and live.is_ready
                and options.can(cls.option, session.channel().capabilities))

    def ask(self, method: str, params: dict, sentence) -> set[str]:
        """`sentence` makes what the panel says of the answer."""
        live = session.current()
        if live is None:  # it ended while the question was on the screen
            return {'CANCELLED'}
        live.edit(method, params, lambda result: session.tell(sentence(result)))
        redraw_views()
        return {'FINISHED'}


class _Asking(_Edit):
    """With a dialog for its properties."""

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)


# ---- pins ----


class SKIND_OT_pins_weigh(_Asking, bpy.types.Operator):
    """How much this pose counts against the others in which you sculpted the same vertices"""

    bl_idname = "skind.pins_weigh"
    bl_label = "Weigh Pose"
    bl_options = {'REGISTER'}
    option = "pins"

    pose: StringProperty(name="Pose", options={'HIDDEN'})
    weight: FloatProperty(name="Weight", min=0.0, soft_max=10.0, max=1000.0, default=1.0)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        pose, weight = self.pose, self.weight
        return self.ask("pins.weigh", {"pose": pose, "weight": weight}, lambda result: (
            f"{pose} counts {weight:.3g} for {_vertices(result)} from the next stroke on."))


class SKIND_OT_pins_clear(_Edit, bpy.types.Operator):
    """Forget what was sculpted in this pose; the weights stay as they are until the next stroke"""

    bl_idname = "skind.pins_clear"
    bl_label = "Forget Pose"
    bl_options = {'REGISTER'}
    option = "pins"

    pose: StringProperty(name="Pose", description="Empty: all poses", options={'HIDDEN'})

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return self.ask("pins.clear", {"pose": self.pose} if self.pose else {},
                        lambda result: f"Forgot the targets of {_vertices(result)}.")


class SKIND_OT_pins_solve(_Edit, bpy.types.Operator):
    """Solve again for what was sculpted in this pose, and for the same vertices in all others"""

    bl_idname = "skind.pins_solve"
    bl_label = "Solve Pose Again"
    bl_options = {'REGISTER'}
    option = "pins"

    pose: StringProperty(name="Pose", options={'HIDDEN'})

    def execute(self, _context: bpy.types.Context) -> set[str]:
        live = session.current()
        params = {"pose": self.pose, **options.solving(*live.settings())}
        return self.ask("pins.solve", params, lambda result: f"Solved {_vertices(result)} again.")


# ---- poses to keep ----


class SKIND_OT_keep_pose(_Edit, bpy.types.Operator):
    """Keep this pose as it is now, while others are corrected"""

    bl_idname = "skind.keep_pose"
    bl_label = "Keep This Pose"
    bl_options = {'REGISTER'}
    option = "keep"

    def execute(self, context: bpy.types.Context) -> set[str]:
        live = session.current()
        live.kept.append((rig.label(live.object()), live.pose()))
        context.scene.skind.keep = True
        live.want_guard()
        return {'FINISHED'}


class SKIND_OT_keep_none(_Edit, bpy.types.Operator):
    """Forget the poses that you kept by hand"""

    bl_idname = "skind.keep_none"
    bl_label = "Forget Kept Poses"
    bl_options = {'REGISTER'}
    option = "keep"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        live = session.current()
        live.kept.clear()
        live.want_guard()
        return {'FINISHED'}


class SKIND_OT_keep_again(_Edit, bpy.types.Operator):
    """Look at the poses to keep again: actions or markers have changed"""

    bl_idname = "skind.keep_again"
    bl_label = "Look Again"
    bl_options = {'REGISTER'}
    option = "keep"

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.current().want_guard()
        return {'FINISHED'}


# ---- all weights ----


class SKIND_OT_mirror(_Asking, bpy.types.Operator):
    """Write the weights of one side from those of the other"""

    bl_idname = "skind.mirror"
    bl_label = "Mirror Weights"
    bl_options = {'REGISTER'}
    option = "mirror"

    axis: EnumProperty(name="Axis", items=AXES, default="x")
    side: EnumProperty(name="From", items=(("+", "Positive", "Write the negative side"),
                                           ("-", "Negative", "Write the positive side")))

    def execute(self, _context: bpy.types.Context) -> set[str]:
        axis, turned = session.current().sculpt.space.axis(self.axis)
        side = self.side if not turned else {"+": "-", "-": "+"}[self.side]

        def sentence(result: dict) -> str:
            said = f"Mirrored {_vertices(result)}."
            if result["unmatched"]:
                said += f" {result['unmatched']:,} have no partner on the other side."
            if result["unpaired_bones"]:
                said += f" Bones without a partner: {', '.join(result['unpaired_bones'][:5])}."
            return said

        return self.ask("weights.mirror", {"axis": axis, "from": side}, sentence)


class SKIND_OT_prune(_Asking, bpy.types.Operator):
    """Remove small weights; what is left of a vertex sums to one"""

    bl_idname = "skind.prune"
    bl_label = "Prune Weights"
    bl_options = {'REGISTER'}
    option = "prune"

    below: FloatProperty(name="Below", min=0.0, max=1.0, default=0.01, precision=4)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return self.ask("weights.prune", {"below": self.below}, lambda result: (
            f"Removed {_many(result['removed'], 'weight', 'weights')} of {_vertices(result)}."))


class SKIND_OT_reduce(_Asking, bpy.types.Operator):
    """Keep at most so many bones a vertex"""

    bl_idname = "skind.reduce"
    bl_label = "Reduce Influences"
    bl_options = {'REGISTER'}
    option = "reduce"

    influences: IntProperty(name="Influences", min=1, max=8, default=4)
    by: EnumProperty(name="Keep", items=(
        ("poses", "What Poses Need", "Those with which poses move least: the poses that you keep, "
         "or random ones"),
        ("size", "The Largest", "Those of largest weight")))

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return self.ask("weights.reduce", {"influences": self.influences, "by": self.by},
                        lambda result: f"Reduced {_vertices(result)}.")


class SKIND_MT_weights(bpy.types.Menu):
    bl_idname = "SKIND_MT_weights"
    bl_label = "Weights"

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = 'INVOKE_DEFAULT'
        for name, icon in (("mirror", 'MOD_MIRROR'), ("prune", 'MOD_DECIM'),
                           ("reduce", 'MOD_VERTEX_WEIGHT')):
            layout.operator(f"skind.{name}", icon=icon)
        if options.can("refit", session.channel().capabilities):
            layout.operator("skind.refit", icon='MOD_MESHDEFORM')


CLASSES = (SKIND_OT_pins_weigh, SKIND_OT_pins_clear, SKIND_OT_pins_solve, SKIND_OT_keep_pose,
           SKIND_OT_keep_none, SKIND_OT_keep_again, SKIND_OT_mirror, SKIND_OT_prune,
           SKIND_OT_reduce, SKIND_MT_weights)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
