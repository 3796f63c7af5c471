# SPDX-License-Identifier: GPL-3.0-or-later
"""What keeps a mesh from being sculpted with skind, each told with what to change.

Main thread, reads only. Everything is refused that would make the shape on screen something else
than linear blend skinning of the rest shape by the vertex groups, and what cannot be written back.
Sentences use the words of Blender's own menus and panels.
"""

from __future__ import annotations

from typing import Iterable, Iterator

import bpy
import numpy as np

from ..core.skin import LEAST_SUM
from . import rig, shapes
from .mesh import read_positions

# After the armature these keep the sculpted vertices where they are, or nearly so.
HARMLESS_AFTER = {"EDGE_SPLIT", "MIRROR", "NORMAL_EDIT", "SOLIDIFY", "SUBSURF", "TRIANGULATE",
                  "WEIGHTED_NORMAL"}
LEAST_SCALE = 1e-9
NAMES_TOLD = 3


def refusals(obj: bpy.types.Object | None, settings: bpy.types.PropertyGroup,
             any_influences: bool = False, own_keys: bool = False) -> list[str]:
    """Sentences, each with what is wrong and what to change; [] means that sculpting may begin.

    Not for every redraw: it may look at each vertex once. `any_influences`: not held against
    settings.influences, because the mesh will take on other weights. `own_keys`: corrective shape
    keys of the session that goes on are right.
    """
    if obj is None:
        return ["Nothing is active: click on the character's mesh first."]
    if obj.type != "MESH":
        return [f"{_quoted(obj)} is not a mesh: click on the character's mesh first."]
    if _is_linked(obj) or _is_linked(obj.data):
        return [f"{_quoted(obj)} is linked from another file, which Blender does not let anyone "
                "sculpt: Object > Relations > Make Local > Selected Objects and Data."]
    found = [*_of_object(obj), *_of_mesh(obj, own_keys), *_of_modifiers(obj)]
    armature = rig.armature_of(obj)
    if armature is not None:
        found += _of_armature(obj, armature)
        # Only for what can be sculpted otherwise: this is the part that takes time.
        if not found:
            limit = None if any_influences or settings.reduce else int(settings.influences)
            found += _of_weights(obj, armature, limit)
    return found


def problem_since_start(obj: bpy.types.Object, bones: list[str]) -> str:
    """Why a mesh in a session cannot be sculpted further: its rig was changed. Else "".

    Quick: for each stroke. `bones`: those that the session has.
    """
    found = [*_of_shape_keys(obj, own_keys=True), *_of_modifiers(obj)]
    return found[0] if found else missing_bones(obj, bones)


def missing_bones(obj: bpy.types.Object, bones: list[str]) -> str:
    """Bones of the session that the armature no longer has, as a sentence, or ""."""
    armature = rig.armature_of(obj)
    if armature is None or armature.type != "ARMATURE":
        return ""  # there are other sentences for that
    missing = [name for name in bones if name not in armature.data.bones]
    if not missing:
        return ""
    return f"Bones were renamed or removed, which the session needs: undo that. {_listed(missing)}"


def _quoted(thing: bpy.types.ID | bpy.types.Modifier) -> str:
    return f"\u201c{thing.name}\u201d"


def _listed(names: list[str]) -> str:
    """“a”, “b”, “c” and 4 more"""
    told = ", ".join(f"\u201c{name}\u201d" for name in names[:NAMES_TOLD])
    return told if len(names) <= NAMES_TOLD else f"{told} and {len(names) - NAMES_TOLD} more"


def _is_linked(block: bpy.types.ID) -> bool:
    return block.library is not None or block.override_library is not None


def _is_flat(obj: bpy.types.Object) -> bool:
    """Its scale is zero along some axis, which nothing can be taken back from."""
    matrix = np.array(obj.matrix_world, np.float64)[:3, :3]
    return not np.isfinite(matrix).all() or np.linalg.svd(matrix, compute_uv=False)[2] < LEAST_SCALE


def _of_object(obj: bpy.types.Object) -> Iterator[str]:
    if obj.mode == "EDIT":
        yield f"{_quoted(obj)} is in Edit Mode: leave it first (Tab)."
    if not obj.visible_get():
        yield (f"{_quoted(obj)} is hidden: show it in the Outliner, "
               "or by Object > Show/Hide > Show Hidden Objects.")
    if _is_flat(obj):
        yield f"{_quoted(obj)} has a scale of zero: change its Scale in Object Properties."
    if obj.use_dynamic_topology_sculpting:
        yield ("Dyntopo is on, which makes and removes vertices: switch it off in the header of "
               "Sculpt Mode.")
    # Blender's old way: the parent deforms without a modifier that one could see.
    if obj.parent is not None and obj.parent_type in {"ARMATURE", "LATTICE"}:
        yield (f"{_quoted(obj.parent)} deforms the mesh as its parent, besides the modifier: "
               "choose Object in Object Properties > Relations > Parent Type.")


def _of_mesh(obj: bpy.types.Object, own_keys: bool) -> Iterator[str]:
    mesh = obj.data
    users = mesh.users - mesh.use_fake_user
    if users > 1:
        yield (f"The mesh {_quoted(mesh)} has {users} users, which would all change: "
               "Object > Relations > Make Single User > Object & Data.")
    yield from _of_shape_keys(obj, own_keys)
    if len(mesh.vertices) == 0 or len(mesh.polygons) == 0:
        yield f"{_quoted(obj)} has no faces: there is nothing to sculpt. Choose another mesh."
    elif not np.isfinite(read_positions(mesh)).all():
        yield (f"{_quoted(obj)} has vertices whose coordinates are not numbers: delete them in "
               "Edit Mode (Mesh > Clean Up).")


def _of_shape_keys(obj: bpy.types.Object, own_keys: bool) -> Iterator[str]:
    if own_keys and shapes.are_ours_alone(obj.data):
        return
    if obj.data.shape_keys is not None:
        yield (f"{_quoted(obj)} has shape keys, which weights do not know about: delete them in "
               "Object Data Properties > Shape Keys, on a copy if they are needed.")


def _of_modifiers(obj: bpy.types.Object) -> Iterator[str]:
    if any(modifier.type == "MULTIRES" for modifier in obj.modifiers):
        yield ("There is a Multiresolution modifier, whose sculpted levels weights do not know "
               "about: apply or remove it.")
    shown = [modifier for modifier in obj.modifiers if modifier.show_viewport]
    armatures = rig.armature_modifiers(obj)
    if not armatures:
        yield from _without_armature(obj)
        return
    if len(armatures) > 1:
        yield (f"{len(armatures)} Armature modifiers are at work: hide all but one by its screen "
               "icon, or remove them.")
        return
    modifier = armatures[0]
    place = shown.index(modifier)
    for other in shown[:place]:
        if other.type != "MULTIRES":
            yield (f"The modifier {_quoted(other)} stands before {_quoted(modifier)}: drag the "
                   "Armature modifier to the top, or hide the other by its screen icon.")
    for other in shown[place + 1:]:
        if other.type not in HARMLESS_AFTER | {"MULTIRES"}:
            yield (f"The modifier {_quoted(other)} may change the shape after the armature did: "
                   "hide it by its screen icon while you sculpt, or remove it. Subdivision, "
                   "Mirror and Solidify may stay.")
    yield from _of_settings(modifier)


def _without_armature(obj: bpy.types.Object) -> Iterator[str]:
    if any(modifier.type == "ARMATURE" for modifier in obj.modifiers):
        yield "The Armature modifier is hidden: switch its screen icon on in Modifier Properties."
    else:
        yield (f"{_quoted(obj)} has no Armature modifier: select it and then its armature, and "
               "Object > Parent > Armature Deform > With Automatic Weights.")


def _of_settings(modifier: bpy.types.ArmatureModifier) -> Iterator[str]:
    where = f"in the modifier {_quoted(modifier)}"
    if modifier.object is None:
        yield f"No armature is named {where}: choose it in the field Object."
    elif modifier.object.type != "ARMATURE":
        yield f"What is named {where} is no armature: choose another in the field Object."
    if modifier.use_deform_preserve_volume:
        yield (f"Preserve Volume is on {where}: switch it off. It is another way of deforming, "
               "which game engines and skind do not have.")
    if not modifier.use_vertex_groups:
        yield f"Bind To > Vertex Groups is off {where}: switch it on."
    if modifier.use_bone_envelopes:
        yield (f"Bind To > Bone Envelopes is on {where}: switch it off. Envelopes move vertices "
               "without weights.")
    if modifier.vertex_group:
        yield (f"A vertex group, \u201c{modifier.vertex_group}\u201d, limits the armature {where}: "
               "empty the field Vertex Group.")
    if modifier.use_multi_modifier:
        yield f"Multi Modifier is on {where}: switch it off."


def _of_armature(obj: bpy.types.Object, armature: bpy.types.Object) -> Iterator[str]:
    if armature.type != "ARMATURE":
        return
    if armature.mode == "EDIT":
        yield f"{_quoted(armature)} is in Edit Mode: leave it first (Tab)."
    if _is_flat(armature):
        yield f"{_quoted(armature)} has a scale of zero: change its Scale in Object Properties."
    bones = rig.deforming_bones(armature)
    if not bones:
        yield (f"No bone of {_quoted(armature)} deforms: switch on Bone Properties > Deform for "
               "the bones that should.")
    groups = {group.name for group in obj.vertex_groups}
    bendy = [bone.name for bone in bones if bone.bbone_segments > 1 and bone.name in groups]
    if bendy:
        yield (f"Bendy bones deform in another way than skind and game engines: set Bone "
               f"Properties > Bendy Bones > Segments to 1 for {_listed(bendy)}. (Select them all, "
               "and hold Alt while you press Enter.)")
    multiplied = [bone.name for bone in bones
                  if bone.use_envelope_multiply and bone.name in groups]
    if multiplied:
        yield ("Bone Properties > Deform > Envelope Multiply changes weights by distance: switch "
               f"it off for {_listed(multiplied)}.")


def _of_weights(obj: bpy.types.Object, armature: bpy.types.Object,
                limit: int | None) -> Iterator[str]:
    bones = {bone.name for bone in rig.deforming_bones(armature)}
    is_bone = [group.name in bones for group in obj.vertex_groups]
    vertices = obj.data.vertices
    if not any(sum(_influences(vertex, is_bone)) > LEAST_SUM for vertex in vertices):
        yield (f"No vertex of {_quoted(obj)} has weight of a deforming bone: select it and then "
               "its armature, and Object > Parent > Armature Deform > With Automatic Weights.")
    elif limit is not None:
        # How many entries a vertex has is told at once; which bones, only one by one.
        counts = [sum(1 for _ in _influences(vertex, is_bone))
                  for vertex in vertices if len(vertex.groups) > limit]
        over = sum(count > limit for count in counts)
        if over:
            yield (f"{over} {'vertex has' if over == 1 else 'vertices have'} more than {limit} "
                   f"influences (up to {max(counts)}): switch on Reduce to Fit, "
                   f"{'choose 8 influences, ' if limit < 8 else ''}or "
                   "Weights > Limit Total in Weight Paint Mode.")


def _influences(vertex: bpy.types.MeshVertex, is_bone: list[bool]) -> Iterable[float]:
    """The weights other than zero of deforming bones."""
    return (entry.weight for entry in vertex.groups if is_bone[entry.group] and entry.weight != 0)
