"""Rigged characters made or imported inside Blender, the same way in every version, and poses."""

from __future__ import annotations

import math
from pathlib import Path

import addon_utils
import bpy
import numpy as np
from mathutils import Vector

TUBE_HEIGHT, TUBE_RADIUS = 2.0, 0.3


def clear() -> None:
    """An empty scene; preferences and add-ons stay."""
    if bpy.context.object and bpy.context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.armatures,
                           *bpy.data.actions])


def activate(thing: bpy.types.Object, mode: str = "OBJECT") -> None:
    """Makes it the one selected and active object, in `mode`."""
    if bpy.context.object and bpy.context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for other in bpy.context.view_layer.objects:
        other.select_set(False)
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode=mode)


def add_mesh(name: str, positions: np.ndarray, faces: np.ndarray) -> bpy.types.Object:
    """A mesh object in the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_chain(name: str, joints: np.ndarray) -> bpy.types.Object:
    """An armature of connected bones from joint to joint, `bone.0` and on."""
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(armature)
    activate(armature, "EDIT")
    parent = None
    for index, (head, tail) in enumerate(zip(joints[:-1], joints[1:])):
        bone = armature.data.edit_bones.new(f"bone.{index}")
        bone.head, bone.tail = head, tail
        bone.parent, bone.use_connect = parent, parent is not None
        parent = bone
    activate(armature)
    return armature


def bind(mesh: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Parents the mesh to the armature and gives it the one modifier."""
    mesh.parent = armature
    mesh.modifiers.new("Armature", "ARMATURE").object = armature


def tube(vertices: int, bones: int) -> tuple[bpy.types.Object, bpy.types.Object]:
    """(mesh, armature): an upright tube on a chain of bones, four smooth weights a vertex.

    Has as many vertices as asked for where the number has a divisor that makes near-square faces
    (round numbers do), else a few less.
    """
    ideal = math.sqrt(vertices * 2 * math.pi * TUBE_RADIUS / TUBE_HEIGHT)
    around = min((n for n in range(int(ideal / 2), int(ideal * 2) + 1)
                  if n >= 3 and vertices % n == 0),
                 key=lambda n: abs(math.log(n / ideal)), default=max(3, round(ideal)))
    rings = vertices // around
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    height = np.linspace(0, TUBE_HEIGHT, rings)
    circle = TUBE_RADIUS * np.stack([np.cos(angle), np.sin(angle)], -1)
    positions = np.concatenate([np.tile(circle, (rings, 1)),
                                np.repeat(height, around)[:, None]], -1)
    index = np.arange(rings * around).reshape(rings, around)
    after = np.roll(index, -1, 1)
    faces = np.stack([index[:-1], after[:-1], after[1:], index[1:]], -1).reshape(-1, 4)
    mesh = add_mesh("Tube", positions, faces)

    joints = np.zeros((bones + 1, 3))
    joints[:, 2] = np.linspace(0, TUBE_HEIGHT, bones + 1)
    armature = add_chain("TubeRig", joints)
    # Weights are the same around a ring, so one call writes a ring's.
    length = TUBE_HEIGHT / bones
    middle = (np.arange(bones) + 0.5) * length
    weights = np.exp(-((height[:, None] - middle) / (0.7 * length)) ** 2)
    kept = np.argsort(-weights, 1)[:, :4]
    weights = np.take_along_axis(weights, kept, 1)
    weights /= weights.sum(1, keepdims=True)
    groups = [mesh.vertex_groups.new(name=f"bone.{bone}") for bone in range(bones)]
    for ring in range(rings):
        members = index[ring].tolist()
        for bone, weight in zip(kept[ring], weights[ring]):
            groups[bone].add(members, float(weight), "REPLACE")
    bind(mesh, armature)
    bpy.context.view_layer.update()
    return mesh, armature


def imported(path: str | Path) -> tuple[list[bpy.types.Object], bpy.types.Object]:
    """(skinned meshes, armature) of a glTF file; the scene's other objects stay."""
    addon_utils.enable("io_scene_gltf2", default_set=True)
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(path))
    meshes = [thing for thing in bpy.data.objects if thing not in before and thing.type == "MESH"
              and any(modifier.type == "ARMATURE" for modifier in thing.modifiers)]
    armatures = {modifier.object for thing in meshes for modifier in thing.modifiers
                 if modifier.type == "ARMATURE"}
    assert len(armatures) == 1, f"{path} has {len(armatures)} armatures"
    return meshes, armatures.pop()


# Radii of the body around Rigify's human, by what the bone's name begins with; in metres.
BODY_RADII = {
    "spine.004": 0.055, "spine.005": 0.055, "spine.006": 0.1, "spine": 0.12, "shoulder": 0.06,
    "upper_arm": 0.05, "forearm": 0.04, "hand": 0.035, "thigh": 0.085, "shin": 0.06,
    "foot": 0.045, "toe": 0.035, "palm": 0.012, "thumb": 0.012, "f_": 0.01,
}


def rigify(human: bool = False, bendy: bool = False,
           levels: int = 2) -> tuple[bpy.types.Object, bpy.types.Object]:
    """(body, rig): Rigify's basic human, or the one with fingers and face, and a body on it.

    The body comes from a Skin modifier along the meta-rig's bones, subdivided `levels` times, with
    Blender's automatic weights. Rigify gives deform bones B-bone segments; unless `bendy`, they
    are set to 1, as rigs for games have them.
    """
    addon_utils.enable("rigify", default_set=True)
    if human:
        bpy.ops.object.armature_human_metarig_add()
    else:
        bpy.ops.object.armature_basic_human_metarig_add()
    meta = bpy.context.object
    before = set(bpy.data.objects)
    bpy.ops.pose.rigify_generate()
    rig = next(thing for thing in bpy.data.objects
               if thing not in before and thing.type == "ARMATURE")
    if not bendy:
        for bone in rig.data.bones:
            bone.bbone_segments = 1
    body = skin_along(meta, levels)
    activate(body)
    rig.select_set(True)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.parent_set(type="ARMATURE_AUTO")
    bpy.data.objects.remove(meta)
    bare = sum(1 for vertex in body.data.vertices if not vertex.groups)
    assert bare == 0, f"automatic weights left {bare} vertices without any"
    activate(body)
    return body, rig


def skin_along(meta: bpy.types.Object, levels: int) -> bpy.types.Object:
    """A closed body around the bones of a meta-rig that BODY_RADII names."""
    points: list[Vector] = []
    radii: list[float] = []
    edges: list[tuple[int, int]] = []

    def point(position: Vector, radius: float) -> int:
        for index, other in enumerate(points):
            if (other - position).length < 1e-4:
                radii[index] = max(radii[index], radius)
                return index
        points.append(position)
        radii.append(radius)
        return len(points) - 1

    used = {}
    for bone in meta.data.bones:  # parents come before their children
        radius = next((size for name, size in BODY_RADII.items() if bone.name.startswith(name)), 0)
        if radius == 0:
            continue
        head = point(bone.head_local.copy(), radius)
        tail = point(bone.tail_local.copy(), radius)
        edges.append((head, tail))
        used[bone.name] = tail
        if bone.parent is not None and bone.parent.name in used and used[bone.parent.name] != head:
            near = min((point(bone.parent.head_local.copy(), 0), used[bone.parent.name]),
                       key=lambda end: (points[end] - points[head]).length)
            if near != head:
                edges.append((near, head))
    mesh = bpy.data.meshes.new("Body")
    mesh.from_pydata(points, edges, [])
    frame = bpy.data.objects.new("Body", mesh)
    bpy.context.scene.collection.objects.link(frame)
    frame.modifiers.new("Skin", "SKIN").use_smooth_shade = True
    smooth = frame.modifiers.new("Subdivision", "SUBSURF")
    smooth.levels = levels
    activate(frame)
    for item, radius in zip(mesh.skin_vertices[0].data, radii):
        item.radius = (radius, radius)
        item.use_root = False
    mesh.skin_vertices[0].data[0].use_root = True
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    frame.data = bpy.data.meshes.new_from_object(frame.evaluated_get(graph))
    frame.modifiers.clear()
    bpy.data.meshes.remove(mesh)
    frame.data.name = "Body"
    return frame


def rest(armature: bpy.types.Object) -> None:
    """The pose in which the character was modelled, with nothing that plays."""
    if armature.animation_data is not None:
        armature.animation_data_clear()
    for bone in armature.pose.bones:
        bone.matrix_basis.identity()
    bpy.context.view_layer.update()


def pose(armature: bpy.types.Object, degrees: dict[str, tuple[float, float, float]]) -> None:
    """Turns bones by Euler angles in their own axes; bones not named stay as they are."""
    for name, angles in degrees.items():
        bone = armature.pose.bones[name]
        bone.rotation_mode = "XYZ"
        bone.rotation_euler = [math.radians(angle) for angle in angles]
    bpy.context.view_layer.update()


def bend(armature: bpy.types.Object, degrees: float) -> None:
    """Turns every second deform bone, each about another axis: a pose for any rig."""
    bones = [bone.name for bone in armature.data.bones if bone.use_deform]
    pose(armature, {name: tuple(degrees * (axis == index // 2 % 3) for axis in range(3))
                    for index, name in enumerate(bones) if index % 2})


def play(armature: bpy.types.Object, action: bpy.types.Action, frame: int) -> None:
    """Shows one frame of one action, whatever else the armature plays."""
    data = armature.animation_data or armature.animation_data_create()
    for track in data.nla_tracks:
        track.mute = True
    data.action = action
    if hasattr(data, "action_slot") and data.action_slot is None:
        data.action_slot = action.slots[0]
    bpy.context.scene.frame_set(frame)


def co(mesh: bpy.types.Object) -> np.ndarray:
    """[V,3] rest coordinates, float32."""
    values = np.empty(len(mesh.data.vertices) * 3, np.float32)
    mesh.data.vertices.foreach_get("co", values)
    return values.reshape(-1, 3)


def posed(mesh: bpy.types.Object) -> np.ndarray:
    """[V,3] coordinates after the modifiers, in the object's space, float32."""
    shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    values = np.empty(len(shown.vertices) * 3, np.float32)
    shown.vertices.foreach_get("co", values)
    return values.reshape(-1, 3)


def weights(mesh: bpy.types.Object) -> np.ndarray:
    """[V,G] every group's weight, float32, 0 where a vertex is not in the group."""
    table = np.zeros((len(mesh.data.vertices), len(mesh.vertex_groups)), np.float32)
    for vertex in mesh.data.vertices:
        for member in vertex.groups:
            table[vertex.index, member.group] = member.weight
    return table
