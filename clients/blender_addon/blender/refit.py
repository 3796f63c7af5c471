# SPDX-License-Identifier: GPL-3.0-or-later
"""Refit: all weights from another mesh that shows how the character should move.

The other mesh has the same vertices: a simulation, a point cache, the character with corrective
keys. At some frames its shape is read, and the pose of our armature; the daemon finds the weights
(and bones) that come nearest to these shapes.

Main thread. What deforms the other mesh may be anything in the scene, so the scene's own frame is
changed to look at it; but only within a slice: the artist's frame, and poses that are not keyed,
are back before Blender goes on.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Iterator

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty, StringProperty

from ..core import options
from . import jobs, rig, session
from .messages import tell

FRAMES = 8
CHANNELS = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale")


def chosen_frames(first: int, last: int, count: int) -> list[int]:
    """Evenly spread, first and last included."""
    return sorted({round(frame) for frame in np.linspace(first, last, count)})


def problem(obj: bpy.types.Object, source: bpy.types.Object | None, frames: list[int],
            most: int) -> str:
    """Why it cannot be done, as a sentence; "" when it can."""
    if source is None or source.type != 'MESH':
        return "choose the mesh object that shows how the character should move"
    if source == obj:
        return "the other mesh must be another object than the character itself"
    count, wanted = len(source.data.vertices), len(obj.data.vertices)
    if count != wanted:
        return (f"\u201c{source.name}\u201d has {count:,} vertices and \u201c{obj.name}\u201d "
                f"{wanted:,}: they must be the same ones, in the same order")
    if len(frames) > most:
        return f"{len(frames)} frames are too many: skind takes {most} at once"
    return ""


@contextmanager
def _at(frame: int) -> Iterator[bpy.types.Depsgraph]:
    """The scene at a frame; afterwards everything is where the artist had it."""
    scene = bpy.context.scene
    kept = scene.frame_current, scene.frame_subframe
    poses = [(bone, [(name, tuple(getattr(bone, name))) for name in CHANNELS])
             for thing in scene.objects if thing.pose is not None for bone in thing.pose.bones]
    try:
        scene.frame_set(frame)
        yield bpy.context.evaluated_depsgraph_get()
    finally:
        scene.frame_set(kept[0], subframe=kept[1])
        for bone, channels in poses:
            for name, value in channels:
                if tuple(getattr(bone, name)) != value:
                    setattr(bone, name, value)


def _shape(obj: bpy.types.Object, source: bpy.types.Object, graph: bpy.types.Depsgraph,
           in_place: bool) -> np.ndarray:
    """f32 [V,3]: the other mesh as it is seen, in our mesh's space; or in its own, taken for ours."""
    seen = source.evaluated_get(graph)
    mesh = seen.to_mesh()
    try:
        found = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", found)
    finally:
        seen.to_mesh_clear()
    found = found.reshape(-1, 3)
    if len(found) != len(obj.data.vertices):
        raise jobs.Refused(f"modifiers of \u201c{source.name}\u201d change its vertices: switch off "
                           "those that do")
    if not in_place:
        return found
    to_ours = np.array(obj.evaluated_get(graph).matrix_world.inverted()
                       @ seen.matrix_world, np.float64)
    return (found @ to_ours[:3, :3].T + to_ours[:3, 3]).astype(np.float32)


def sample(live, source_name: str, frames: list[int], in_place: bool):
    """Job: f32 [P,V,3] shapes and f64 [P,B,4,4] poses, both in mesh space."""
    names, binds = live.sculpt.rig.names, live.sculpt.rig.binds
    shapes, poses = [], []
    for number, frame in enumerate(frames):
        obj = bpy.data.objects[(live.object_name, None)]
        armature = rig.armature_of(obj)
        with _at(frame) as graph:
            shapes.append(_shape(obj, bpy.data.objects[(source_name, None)], graph,
                                 in_place))
            moves = rig.channels(armature.evaluated_get(graph), names)
            poses.append(rig.in_mesh(obj.evaluated_get(graph), armature.evaluated_get(graph),
                                     moves, binds))
        yield (number + 1) / len(frames)
    return np.array(shapes), np.array(poses)


def _sentence(result: dict) -> str:
    before, after = (result["residual"][when]["mean"] for when in ("before", "after"))
    said = f"Refitted {result['vertices']:,} vertices: {before:.3g} away before, {after:.3g} after."
    return " ".join([said, *(warning["text"] for warning in result["warnings"])])


def fit(live, source_name: str, frames: list[int], in_place: bool, slots: str):
    """Job: looks at the frames, and asks the daemon for the weights."""
    sculpt = live.sculpt
    shapes, poses = yield from sample(live, source_name, frames, in_place)
    if len(poses) > 1 and np.abs(poses - poses[0]).max() <= 1e-6 * max(sculpt.length, 1e-6):
        raise jobs.Refused("the armature does not move in these frames: weights show only where "
                           "bones move")
    live.show(False)
    sculpt.refit(shapes, poses, {"slots": slots}, lambda result: tell(_sentence(result)))


class SKIND_OT_refit(bpy.types.Operator):
    """Find all weights anew, so that the character moves as another mesh of the same vertices does"""

    bl_idname = "skind.refit"
    bl_label = "Refit to a Mesh"
    bl_options = {'REGISTER'}

    source: StringProperty(name="Mesh", description="A mesh object of the same vertices")
    first: IntProperty(name="First Frame")
    last: IntProperty(name="Last Frame")
    count: IntProperty(name="Frames", description="How many are looked at, evenly spread",
                       min=1, max=256, default=FRAMES)
    in_place: BoolProperty(name="Where It Stands", default=True, description=(
        "Both are compared where they stand in the scene; off: the other mesh stands aside, and its "
        "shape is taken as if it stood here"))
    other_bones: BoolProperty(name="Let Vertices Use Other Bones", default=True)

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return (live is not None and live.is_ready
                and options.can("refit", session.channel().capabilities))

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.first, self.last = context.scene.frame_start, context.scene.frame_end
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop_search(self, "source", bpy.data, "objects")
        for name in ("first", "last", "count", "in_place", "other_bones"):
            layout.prop(self, name)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        live = session.current()
        frames = chosen_frames(self.first, max(self.first, self.last), self.count)
        most = session.channel().hello["limits"].get("target_poses", 0)
        wrong = problem(live.object(), bpy.data.objects.get(self.source), frames, most)
        if wrong:
            self.report({'ERROR'}, wrong[0].upper() + wrong[1:] + ".")
            return {'CANCELLED'}
        slots = "evidence" if self.other_bones else "keep"
        live.run(fit(live, self.source, frames, self.in_place, slots), "Looking at the other mesh")
        return {'FINISHED'}


def register() -> None:
    bpy.utils.register_class(SKIND_OT_refit)


def unregister() -> None:
    bpy.utils.unregister_class(SKIND_OT_refit)
