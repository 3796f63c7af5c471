"""Every file of the asset collection loads, or is refused with one clear sentence."""

from pathlib import Path

import numpy as np
import pytest
from rig_lib import ASSETS, asset_paths, load, probe

# Files that are refused: the status, and words that tell the user what is wrong.
REFUSED = {
    "awkward/INVALID_joint_out_of_range.glb": ("bad_rig", "joint"),
    "tinygltf/issue-416.gltf": ("not_gltf", "asset.version"),  # throws bad_alloc out of tinygltf
    "tinygltf/issue-492.glb": ("unsupported", "skinned"),  # joints, but no mesh
    "variants/mh_body_4inf_draco.glb": ("unsupported", "Draco"),
    "variants/mh_body_4inf_meshopt.glb": ("unsupported", "meshopt"),
}

# Files that are mended, and how often; all others come as they are.
NOTES = {
    "awkward/INVALID_nan_inf_negative_weights.glb": {"weights_normalised": 3, "weights_invalid": 3},
    "awkward/INVALID_u8w_sum_not_255.glb": {"weights_normalised": 80},
    "awkward/morph_sparse_weights.glb": {"morph_targets": 2},
    "awkward/multi_skin_shared_mesh.glb": {"meshes_shared": 1},
    "awkward/no_inverse_bind.glb": {"binds_missing": 1},
    "awkward/weights_sum_not_one.glb": {"weights_normalised": 100},
    "awkward/zero_weight_vertices.glb": {"weights_missing": 15},
    "kaykit_adventurers/Knight.glb": {"parts_unskinned": 9},
    "khronos_animskin/Animation_Skin_04.gltf": {"binds_missing": 1},
    "khronos_animskin/Animation_Skin_05.gltf": {"parts_unskinned": 1},
    "khronos_animskin/Animation_Skin_10.gltf": {"parts_unskinned": 1},
    "khronos_cesium/cesium_man.gltf": {"weights_normalised": 210},
    "tinygltf/unassigned-skeleton.gltf": {"binds_affine": 1},
}

# vertices, joints, most influences of one vertex, from the collection's INDEX.md.
SIZES = {
    "assimp_quad/quad_skin.glb": (4, 10, 10),
    "awkward/tube100_8inf_u16w.glb": (100, 8, 8),
    "awkward/tube540_unindexed.glb": (540, 6, 4),
    "awkward/tube6000_300joints.glb": (6000, 300, 4),
    "bevy_fox/Fox.glb": (1728, 24, 4),
    "kaykit_adventurers/Knight.glb": (3716, 41, 4),
    "khronos_cesium/cesium_man.gltf": (3273, 19, 4),
    "makehuman/mh_body_12inf.glb": (13380, 163, 9),
    "makehuman/mh_body_4inf.glb": (13380, 163, 4),
    "makehuman/mh_body_sub1_8inf.glb": (53514, 163, 8),
    "raylib_robot/robot.glb": (7218, 43, 4),
    "variants/mh_body_4inf_quantized_w8.glb": (13380, 163, 4),
    "webxr_generic_hand/left.glb": (1360, 25, 4),
}


@pytest.mark.parametrize("name", asset_paths())
def test_asset(name: str, tmp_path: Path) -> None:
    path = ASSETS / name
    if name in REFUSED:
        status, word = REFUSED[name]
        answer = probe("load", path)
        assert answer["status"] == status
        assert word in answer["text"]
        assert "\n" not in answer["text"]
        return
    rig = load(path, tmp_path)
    assert rig.summary["notes"] == NOTES.get(name, {})
    if name in SIZES:
        summary = rig.summary
        assert (summary["vertices"], len(summary["bones"]), summary["most"]) == SIZES[name]
    check_arrays(rig.arrays, rig.summary)


def check_arrays(arrays: dict[str, np.ndarray], summary: dict) -> None:
    """What rig.h promises of any rig."""
    vertices, bones = summary["vertices"], len(summary["bones"])
    assert np.isfinite(summary["length"]) and summary["length"] > 0
    assert len(set(zip(arrays["bone_skins"], summary["bones"]))) == bones
    offsets, joints, weights = (arrays[name] for name in ("offsets", "joints", "weights"))
    rows = np.repeat(np.arange(vertices), np.diff(offsets.astype(np.int64)))
    assert (weights > 0).all()
    assert np.abs(np.bincount(rows, weights.astype(np.float64), vertices) - 1).max() <= 1e-7
    assert (arrays["bone_skins"][joints] == arrays["skins"][rows]).all()
    assert len(np.unique(rows * 65536 + joints)) == len(rows), "a bone twice in a row"
    falls = (np.diff(rows) == 0) & (np.diff(weights) > 0)
    assert not falls.any(), "the largest weight comes first"
    check_topology(arrays, vertices)


def check_topology(arrays: dict[str, np.ndarray], vertices: int) -> None:
    """Twins and neighbours against a slow way of finding them."""
    offsets = arrays["offsets"]
    keys = [
        (rest.tobytes(), skin, arrays["joints"][a:b].tobytes(), arrays["weights"][a:b].tobytes())
        for rest, skin, a, b in zip(arrays["rest"], arrays["skins"], offsets[:-1], offsets[1:])
    ]
    firsts: dict[tuple, int] = {}
    ring = np.array([firsts.setdefault(key, v) for v, key in enumerate(keys)])
    twins = arrays.get("twins")
    assert (twins is not None) == (len(firsts) < vertices)
    if twins is not None:
        assert (ring[twins] == ring).all()
        members: dict[int, list[int]] = {}
        for v, first in enumerate(ring):
            members.setdefault(first, []).append(v)
        for group in members.values():
            assert [int(twins[v]) for v in group] == group[1:] + group[:1]
    triangles = ring[arrays["triangles"]]
    pairs = np.concatenate([triangles[:, [i, k]] for i in range(3) for k in range(3) if i != k])
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    starts = np.searchsorted(pairs[:, 0], np.arange(vertices + 1))
    found, listed = arrays["neighbour_offsets"], arrays["neighbours"]
    assert found[0] == 0 and found[-1] == len(listed)
    for v in range(0, vertices, max(1, vertices // 2000)):
        first = ring[v]
        assert listed[found[v] : found[v + 1]].tolist() == pairs[starts[first] : starts[first + 1], 1].tolist()
