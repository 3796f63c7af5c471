# SPDX-License-Identifier: GPL-3.0-or-later
"""A rigged mesh as the daemon wants it: rest shape, bones, raw weights; and its pose now.

Main thread, reads only. All in *mesh space*, the object's own. The Armature modifier goes into the
armature's space and back, so a bone's matrix there is

    M = object.matrix_world^-1 @ armature.matrix_world
    bind = M @ bone.matrix_local     deform = M @ pose_bone.matrix_channel @ M^-1 = pose @ bind^-1

and linear blend skinning with these is the evaluated mesh; checks.py refuses what would make it
something else.
"""

from __future__ import annotations

from typing import Iterable

import bpy
import numpy as np

from ..core.rig import Rig
from ..core.skin import LEAST_SUM
from .mesh import read_positions
from .weights import (
    ARRAYS_AT_ONCE,
    Progress,
    entries,
    mesh_named,
    object_named,
    within,
)

TRIANGLES_AT_ONCE = 400  # more objects alive at once would set off collections of garbage


def armature_modifiers(obj: bpy.types.Object) -> list[bpy.types.ArmatureModifier]:
    """Those that take part in the viewport."""
    return [modifier for modifier in obj.modifiers
            if modifier.type == "ARMATURE" and modifier.show_viewport]


def armature_of(obj: bpy.types.Object) -> bpy.types.Object | None:
    """The armature of the object's one visible Armature modifier."""
    found = armature_modifiers(obj)
    return found[0].object if len(found) == 1 else None


def _to_mesh(obj: bpy.types.Object, armature: bpy.types.Object) -> np.ndarray:
    """f64 [4,4]: armature space -> mesh space."""
    return (np.linalg.inv(np.array(obj.matrix_world, np.float64))
            @ np.array(armature.matrix_world, np.float64))


def _matrices(values: Iterable) -> np.ndarray:
    """f64 [n,4,4]"""
    return np.array([np.array(value) for value in values], np.float64).reshape(-1, 4, 4)


def deforming_bones(armature: bpy.types.Object) -> list[bpy.types.Bone]:
    """In the armature's order, in which parents come before their children."""
    return [bone for bone in armature.data.bones if bone.use_deform]


def pose(obj: bpy.types.Object, names: list[str], binds: np.ndarray | None = None) -> np.ndarray:
    """f64 [B,4,4]: bones to mesh space as posed now; core.skin.deformations(pose, binds) follows.

    `binds` are those that were read with the rig. With them the pose is right as well after mesh or
    armature were moved as objects, or bones at rest, because the result is told relative to them;
    without, nothing but pose bones may have moved. Raises KeyError for a bone that is gone.
    """
    armature = armature_of(obj)
    if armature is None:
        raise KeyError(f"\u201c{obj.name}\u201d has no armature")
    if binds is None:
        binds = _to_mesh(obj, armature) @ _matrices(
            armature.pose.bones[name].bone.matrix_local for name in names)
    return in_mesh(obj, armature, channels(armature, names), binds)


def channels(armature: bpy.types.Object, names: list[str]) -> np.ndarray:
    """f64 [B,4,4]: what the modifier itself uses, so that the rounding in pose_bone.matrix and back
    is not ours. `armature` may be an evaluated one."""
    return _matrices(armature.pose.bones[name].matrix_channel for name in names)


def in_mesh(obj: bpy.types.Object, armature: bpy.types.Object, moves: np.ndarray,
            binds: np.ndarray) -> np.ndarray:
    """channels() as a pose in mesh space."""
    to_mesh = _to_mesh(obj, armature)
    return to_mesh @ moves @ np.linalg.inv(to_mesh) @ binds


def label(obj: bpy.types.Object) -> str:
    """Where the pose is from, for people: "frame 12", or "pose" when nothing is animated."""
    armature = armature_of(obj)
    animation = armature.animation_data if armature is not None else None
    if animation is None or (animation.action is None and not animation.nla_tracks):
        return "pose"
    return f"frame {bpy.context.scene.frame_current}"


def read(obj_name: str) -> Progress[Rig]:
    """Job: reads it. Raises weights.MeshChanged when the object changes meanwhile."""
    obj = object_named(obj_name)
    armature = armature_of(obj)
    if armature is None:
        raise KeyError(f"\u201c{obj_name}\u201d has no armature")
    bones = deforming_bones(armature)
    names = [bone.name for bone in bones]
    index_of = {name: index for index, name in enumerate(names)}
    parents = np.array([next((index_of[parent.name] for parent in bone.parent_recursive
                              if parent.name in index_of), -1) for bone in bones], np.int32)
    binds = _to_mesh(obj, armature) @ _matrices(bone.matrix_local for bone in bones)
    bone_of_group = np.array([index_of.get(group.name, -1) for group in obj.vertex_groups] or [-1],
                             np.int32)
    positions = read_positions(obj.data)
    yield 0.0
    triangles = yield from within(_triangles(obj_name, len(positions)), 0.0, 0.3)
    found = yield from within(entries(obj_name), 0.3, 0.9)

    counts, sums = np.zeros(len(positions) + 1, np.int64), np.zeros(len(positions))
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    for first in range(0, len(positions), ARRAYS_AT_ONCE):
        offsets = found.offsets[first:first + ARRAYS_AT_ONCE + 1]
        number = len(offsets) - 1
        span = slice(offsets[0], offsets[-1])
        bone_of, weights = bone_of_group[found.groups[span]], found.weights[span]
        used = (bone_of >= 0) & (weights != 0)
        owners = np.repeat(np.arange(number), np.diff(offsets))[used]
        counts[first + 1:first + 1 + number] = np.bincount(owners, minlength=number)
        sums[first:first + number] = np.bincount(owners, weights[used], minlength=number)
        parts.append((bone_of[used].astype(np.uint16), weights[used]))
        yield 0.9 + 0.1 * first / len(positions)
    joints, weights = (np.concatenate(column) for column in zip(*parts))
    return Rig(positions, triangles, names, parents, binds, np.cumsum(counts).astype(np.uint32),
               joints, weights, sums <= LEAST_SUM)


def _triangles(obj_name: str, vertices: int) -> Progress[np.ndarray]:
    """Job: u32 [T,3]."""
    mesh = mesh_named(obj_name, vertices)
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    found = np.empty((count, 3), np.uint32)
    # Not foreach_get, which has no fast way for these and holds Blender up 20 ms for 100k vertices.
    for first in range(0, count, TRIANGLES_AT_ONCE):
        mesh = mesh_named(obj_name, vertices)
        mesh.calc_loop_triangles()  # costs nothing while they are there
        part = mesh.loop_triangles[first:first + TRIANGLES_AT_ONCE]
        flat = [vertex for triangle in part for vertex in triangle.vertices]
        found[first:first + len(part)] = np.array(flat, np.uint32).reshape(-1, 3)
        yield first / count
    return found
