"""Posed positions against three.js, and against NumPy for what three.js does not do."""

from pathlib import Path

import numpy as np
import pytest
import rig_numpy
from rig_lib import ASSETS, Gltf, asset_paths, load, posed, run_node
from test_rig_load import REFUSED

TOLERANCE = 1e-5  # of L

# What three.js does otherwise, from its source (r187); NumPy alone is the judge there.
THREE_DIFFERS = {
    "assimp_quad/quad_skin.glb": "reads JOINTS_0 only",
    "assimp_quad/simple_skin.gltf": "leaves rotation keys of length 0.9998 as they are",
    "awkward/tube100_8inf_u16w.glb": "reads JOINTS_0 only",
    "makehuman/mh_body_12inf.glb": "reads JOINTS_0 only",
    "makehuman/mh_body_sub1_8inf.glb": "reads JOINTS_0 only",
    "awkward/INVALID_u8w_sum_not_255.glb": "normalises in u8, with rounding",
    "tinygltf/unassigned-skeleton.gltf": "never ends: takes no byteStride on animation data",
    "awkward/INVALID_nan_inf_negative_weights.glb": "keeps NaN and negative weights",
}

ACCEPTED = [name for name in asset_paths() if name not in REFUSED]


def animated() -> list[str]:
    return [name for name in ACCEPTED if Gltf.read(ASSETS / name).json.get("animations")]


def moments(name: str) -> list[tuple[int, float]]:
    """Clips and times: the ends, keys, between keys, and beyond; a share of many clips."""
    gltf = Gltf.read(ASSETS / name)
    chosen = []
    animations = gltf.json["animations"]
    for clip in range(0, len(animations), max(1, len(animations) // 8)):
        keys = np.unique(
            np.concatenate([gltf.floats(s["input"])[:, 0] for s in animations[clip]["samplers"]])
        )
        end = float(keys[-1])
        middle = float(keys[len(keys) // 2])
        chosen += [(clip, t) for t in (0.0, float(keys[0]), middle, 0.137 * end, 0.61803 * end, end)]
    return chosen


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """three.js's positions [poses][V][3] by asset, all in one run."""
    folder = tmp_path_factory.mktemp("three")
    jobs = []
    names = [name for name in animated() if name not in THREE_DIFFERS]
    for index, name in enumerate(names):
        rig = load(ASSETS / name, folder)
        parts = [[part["mesh"], part["primitive"]] for part in rig.summary["parts"]]
        out = str(folder / f"{index}.bin")
        jobs.append({"file": str(ASSETS / name), "out": out, "poses": moments(name), "parts": parts})
    answers = run_node("rig_three.mjs", jobs)
    result = {}
    for name, job, answer in zip(names, jobs, answers):
        assert "error" not in answer, f"{name}: {answer}"
        result[name] = np.fromfile(job["out"], "<f8").reshape(len(job["poses"]), -1, 3)
    return result


@pytest.mark.parametrize("name", [name for name in animated() if name not in THREE_DIFFERS])
def test_against_three(name: str, three: dict[str, np.ndarray], tmp_path: Path) -> None:
    rig = load(ASSETS / name, tmp_path)
    ours = posed(ASSETS / name, moments(name), rig.summary["vertices"], tmp_path)
    worst = np.abs(ours - three[name]).max()
    assert worst <= TOLERANCE * rig.length, f"{worst / rig.length:.2e} of L"


def roots(rig) -> list[int]:
    """The joint number of each skin's root bone; no asset has a joint twice."""
    skins, parents = rig.arrays["bone_skins"], rig.arrays["parents"]
    return [int(np.flatnonzero((skins == s) & (parents < 0))[0] - np.argmax(skins == s))
            for s in range(rig.summary["skins"])]  # fmt: skip


@pytest.mark.parametrize("name", animated())
def test_against_numpy(name: str, tmp_path: Path) -> None:
    rig = load(ASSETS / name, tmp_path)
    poses = moments(name)[1::4][:6]
    ours = posed(ASSETS / name, poses, rig.summary["vertices"], tmp_path)
    for mine, (clip, time) in zip(ours, poses):
        expected = rig_numpy.posed(ASSETS / name, rig.summary["parts"], roots(rig), clip, time)
        worst = np.abs(mine - expected).max()
        assert worst <= TOLERANCE * rig.length, f"clip {clip} at {time}: {worst / rig.length:.2e} of L"


@pytest.mark.parametrize("name", ACCEPTED)
def test_rest_pose_and_length(name: str, tmp_path: Path) -> None:
    """L is the diagonal of the box around the mesh in the file's own pose."""
    rig = load(ASSETS / name, tmp_path)
    expected = rig_numpy.posed(ASSETS / name, rig.summary["parts"], roots(rig), None, 0)
    diagonal = np.linalg.norm(np.ptp(expected, axis=0))
    assert rig.length == pytest.approx(diagonal, rel=1e-5)
