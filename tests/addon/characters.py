"""Characters of ../shared/assets that every Blender imports with exactly an Armature modifier."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Character:
    """A skinned mesh of a file. `mesh` names its object, which a file with several needs."""

    file: str
    mesh: str
    vertices: int
    bones: int
    influences: int  # the most on one vertex
    clips: int
    exact: bool = True  # Blender holds weights that sum to one, within 1e-4


CHARACTERS = [
    Character("makehuman/mh_body_4inf.glb", "body", 13_380, 163, 4, 3),
    Character("makehuman/mh_body_12inf.glb", "body", 13_380, 163, 9, 3),
    Character("variants/mh_body_4inf_quantized_w8.glb", "body", 13_380, 163, 4, 3),
    Character("kaykit_adventurers/Knight.glb", "Knight_Body", 1_141, 41, 3, 76),
    Character("kaykit_adventurers/Knight.glb", "Knight_LegLeft", 438, 41, 4, 76),
    Character("raylib_robot/robot.glb", "Hand.L", 554, 43, 4, 14),
    Character("bevy_fox/Fox.glb", "fox", 1_728, 24, 4, 3),
    Character("khronos_cesium/cesium_man.gltf", "Cesium_Man", 3_273, 19, 4, 1, exact=False),
    Character("khronos_cesium/rigged_simple.gltf", "Cylinder", 160, 2, 2, 1),
    Character("webxr_generic_hand/left.glb", "l_handMeshNode", 1_360, 25, 4, 0),
    Character("awkward/tube6000_300joints.glb", "Mesh_0", 6_000, 300, 4, 1),
    Character("awkward/tube100_8inf_u16w.glb", "Mesh_0", 100, 8, 8, 1),
    Character("awkward/weights_sum_not_one.glb", "Mesh_0", 100, 6, 4, 1, exact=False),
]

# Imports, and has what the add-on refuses: (file, mesh).
WITH_SHAPE_KEYS = ("awkward/morph_sparse_weights.glb", "Mesh_0")
