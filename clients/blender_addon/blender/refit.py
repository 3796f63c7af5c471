# SPDX-License-Identifier: GPL-3.0-or-later
"""Refit: the weights with which the armature moves the mesh as another mesh moves.

Main thread. The other mesh and the armature are looked at frame by frame in a scene of our own, as
guards.py does with poses, and for the same reason: setting the frame of the artist's scene writes
every animated value over what is not keyed, in all of the file, and nothing brings that back. Our
scene's evaluation is not the active one, so it writes nothing into the originals. It holds

    the source itself     not a copy: baked caches stay behind when an object is copied
    the armature's copy   its bones' moves are read from it
    the mesh's copy       where the object is at the frame; without modifiers, because evaluating
                          what is in Sculpt Mode twice is not Blender's strength

Drivers, parents, constraints and bound meshes come along as Blender's dependencies. A simulation
does not: it is of the scene that it runs in, and of the frames before, so one that is not baked is
refused. The scene is there for the length of a slice only: undo never sees it.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import Iterator

import bpy
import numpy as np
from bpy.props import BoolProperty, IntProperty, StringProperty

from ..core import options, refitting
from . import guards, jobs, mesh, rig, session
from .messages import tell
from .properties import redraw_views

SIMULATED = {"CLOTH", "SOFT_BODY", "FLUID", "DYNAMIC_PAINT", "OCEAN", "EXPLODE"}
CACHED = {"CLOTH", "SOFT_BODY"}  # a bake of these comes with the object
SAMPLING = 0.9  # the share of the progress; how far the solve is, nobody tells
LIKE_SCENE = ("fps", "fps_base", "frame_map_old", "frame_map_new")  # of render: caches look at it


def frames_of(first: int, last: int, count: int) -> list[int]:
    """Evenly spaced, both ends included; fewer where there are not so many. Raises jobs.Refused."""
    if last < first:
        raise jobs.Refused(f"the last frame, {last}, comes before the first, {first}")
    return np.unique(np.linspace(first, last, count).round().astype(int)).tolist()


# ---- looking ----


def _source(name: str, vertices: int, sculpted: bpy.types.Object) -> bpy.types.Object:
    """The mesh to follow. Raises jobs.Refused where it cannot be followed."""
    source = bpy.data.objects.get((name, None)) or bpy.data.objects.get(name)
    told = f"\u201c{name}\u201d"
    if source is None:
        raise jobs.Refused(f"there is no object {told}: choose the mesh to follow" if name else
                           "choose the mesh to follow")
    if source == sculpted:
        raise jobs.Refused(f"{told} is the mesh that you sculpt: choose another one to follow")
    if source.type != 'MESH':
        raise jobs.Refused(f"{told} is not a mesh: choose one with the same vertices")
    if len(source.data.vertices) != vertices:
        raise jobs.Refused(f"{told} has {len(source.data.vertices):,} vertices and not {vertices:,}"
                           ": choose a mesh with the same vertices")
    if source.mode == 'EDIT':
        raise jobs.Refused(f"{told} is in Edit Mode: leave it first (Tab)")
    if source.hide_viewport:
        raise jobs.Refused(f"{told} is disabled in viewports, so Blender does not deform it: "
                           "enable it in the Outliner")
    for modifier in source.modifiers:
        if modifier.show_viewport and modifier.type in SIMULATED and not (
                modifier.type in CACHED and modifier.point_cache.is_baked):
            raise jobs.Refused(f"the modifier \u201c{modifier.name}\u201d of {told} is not baked: "
                               "bake it, or export the mesh to Alembic and choose that")
    return source


class _Stage:
    """A scene of our own with what has to be looked at."""

    def __init__(self, scene: bpy.types.Scene, source: bpy.types.Object,
                 armature: bpy.types.Object, stand_in: bpy.types.Object) -> None:
        self._scene = scene
        self._source, self._armature, self._stand_in = source, armature, stand_in

    def look(self, frame: int, names: list[str], binds: np.ndarray,
             vertices: int) -> tuple[np.ndarray, np.ndarray]:
        """A frame's pose f64 [B,4,4] and the source's vertices f32 [V,3], both in the mesh space
        of that frame, as the Armature modifier would have it."""
        self._scene.frame_set(frame)
        graph = self._scene.view_layers[0].depsgraph
        here = self._stand_in.evaluated_get(graph)
        armature = self._armature.evaluated_get(graph)
        pose = rig.in_mesh(here, armature, rig.channels(armature, names), binds)
        source = self._source.evaluated_get(graph)
        to_mesh = (np.linalg.inv(np.array(here.matrix_world, np.float64))
                   @ np.array(source.matrix_world, np.float64))
        try:
            shape = mesh.read_positions(source.to_mesh()).astype(np.float64)
        finally:
            source.to_mesh_clear()
        if len(shape) != vertices:
            raise jobs.Refused(f"\u201c{self._source.name}\u201d has {len(shape):,} vertices in "
                               f"frame {frame} and not {vertices:,}: hide the modifiers that add "
                               "or remove some")
        if not np.isfinite(shape).all():
            raise jobs.Refused(f"\u201c{self._source.name}\u201d has coordinates that are not "
                               f"numbers in frame {frame}")
        return pose, (shape @ to_mesh[:3, :3].T + to_mesh[:3, 3]).astype(np.float32)


@contextmanager
def _stage(obj: bpy.types.Object, source: bpy.types.Object) -> Iterator[_Stage]:
    scene = bpy.data.scenes.new("Skind")
    copies = []
    try:
        for name in LIKE_SCENE:
            setattr(scene.render, name, getattr(bpy.context.scene.render, name))
        for original in (rig.armature_of(obj), obj):
            copies.append(original.copy())
            copies[-1].hide_viewport = False
            scene.collection.objects.link(copies[-1])
        armature, stand_in = copies
        guards.point_at(armature, rig.armature_of(obj))
        stand_in.modifiers.clear()
        scene.collection.objects.link(source)
        yield _Stage(scene, source, armature, stand_in)
    finally:
        bpy.data.scenes.remove(scene)
        for copy in copies:
            bpy.data.objects.remove(copy)


def sample(obj_name: str, source_name: str, names: list[str], binds: np.ndarray, vertices: int,
           frames: list[int]):
    """Job: (poses f64 [P,B,4,4], positions f32 [P,V,3]), a frame in a slice."""
    poses, positions = [], []
    for frame in frames:
        obj = bpy.data.objects[(obj_name, None)]
        with _stage(obj, _source(source_name, vertices, obj)) as stage:
            pose, shape = stage.look(frame, names, binds, vertices)
        poses.append(pose)
        positions.append(shape)
        yield SAMPLING * len(poses) / len(frames)
    return np.array(poses), np.array(positions)


# ---- solving ----


def refit(live, source_name: str, first: int, last: int, count: int, other_bones: bool):
    """Job: looks, asks, and tells how near it came. The change arrives as others' changes do."""
    sculpt, channel = live.sculpt, session.channel()
    frames = frames_of(first, last, count)
    limit = channel.hello["limits"]["target_poses"]
    if len(frames) > limit:
        raise jobs.Refused(f"{len(frames)} frames are more than skind takes, {limit}: take fewer")
    if 12 * len(frames) * sculpt.vertices >= channel.hello["limits"]["frame_bytes"]:
        raise jobs.Refused(f"{len(frames)} frames of so many vertices are more than fits into one "
                           "message: take fewer")
    poses, positions = yield from sample(live.object_name, source_name, sculpt.rig.names,
                                         sculpt.rig.binds, sculpt.vertices, frames)
    answers: list = []
    asked = refitting.refit(sculpt, poses, positions, [f"frame {frame}" for frame in frames],
                            other_bones, lambda *answer: answers.append(answer))
    if asked is None:
        raise jobs.Refused(f"the armature does not move in the frames {frames[0]} to {frames[-1]}: "
                           "choose frames in which it does")
    try:
        while not answers:
            yield jobs.WAIT
    finally:
        if not answers:  # it may be done before the daemon reads this; then it is a step to undo
            sculpt.asks.cancel(asked)
    result, error = answers[0]
    if error is not None:
        raise jobs.Refused(str(error))
    tell(_sentence(result, live.object().matrix_world.median_scale))


def _sentence(result: dict, scale: float) -> str:
    """What the panel says; `scale`: from the mesh's units to the scene's."""
    before, after = (scale * result["residual"][when]["mean"] for when in ("before", "after"))
    warnings = [warning["text"] for warning in result["warnings"]]
    return " ".join([f"Refitted {result['vertices']:,} vertices: off by {before:.3g} before, "
                     f"{after:.3g} after, on average.",
                     *(f"{text[:1].upper()}{text[1:]}." for text in warnings)])


class SKIND_OT_refit(bpy.types.Operator):
    """Find the weights with which the armature moves this mesh as another mesh of the same vertices
    moves: a simulated, cached or otherwise corrected copy that lies where this one is"""

    bl_idname = "skind.refit"
    bl_label = "Refit"
    bl_options = {'REGISTER'}

    source: StringProperty(name="Follow", description="The mesh whose motion the weights should "
                           "reproduce; it has the same vertices, in the same order")
    first: IntProperty(name="First Frame", default=1)
    last: IntProperty(name="Last Frame", default=250)
    count: IntProperty(name="Frames", description="How many to take, evenly spaced. More poses "
                       "that bend the joints well tell bones better apart",
                       default=8, min=2, soft_max=64)
    other_bones: BoolProperty(name="Choose Bones", description="Let vertices use other bones than "
                              "those that they have places for", default=True)

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return (live is not None and live.is_ready and live.sculpt.phase == "ready"
                and options.can("refit", session.channel().capabilities))

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        scene = context.scene
        in_preview = scene.use_preview_range
        for name, value in (("first", scene.frame_preview_start if in_preview
                             else scene.frame_start),
                            ("last", scene.frame_preview_end if in_preview else scene.frame_end)):
            if not self.properties.is_property_set(name):
                setattr(self, name, value)
        return context.window_manager.invoke_props_dialog(self)

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.prop_search(self, "source", context.scene, "objects", icon='OUTLINER_OB_MESH')
        for name in ("first", "last", "count"):
            self.layout.prop(self, name)
        row = self.layout.row()
        row.enabled = options.can("slots.EVIDENCE", session.channel().capabilities)
        row.prop(self, "other_bones")

    def execute(self, _context: bpy.types.Context) -> set[str]:
        live = session.current()
        if live is None:  # it ended while the question was on the screen
            return {'CANCELLED'}
        live.show(False)
        other_bones = self.other_bones and options.can("slots.EVIDENCE",
                                                       session.channel().capabilities)
        live.run(refit(live, self.source, self.first, self.last, self.count, other_bones), "Refit")
        redraw_views()
        return {'FINISHED'}


register, unregister = bpy.utils.register_classes_factory((SKIND_OT_refit,))
