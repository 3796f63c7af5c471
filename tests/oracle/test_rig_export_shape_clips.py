"""Exports of corrective shapes to files whose clips move morph targets."""

from pathlib import Path

import numpy as np
import pytest
from rig_make import Maker, Tube
from rig_lib import Rig, export, load
from rig_morphs import TIMES, bend, expected, fresh, primitive, shown, weight_clip
from test_rig_export import check_valid
from test_rig_export_shapes import NEAR, shape_of, write

BODY = 8  # node


def tubes(*targets: int) -> Maker:
    """Skinned meshes that bend, one for each number of targets: nodes BODY, BODY + 1, ..."""
    maker, shape = Maker(), Tube()
    primitives = [primitive(maker, shape, count) for count in targets]
    maker = bend(shape.build(maker, primitives[:1]))
    for index, other in enumerate(primitives[1:], 1):
        maker.json["meshes"].append({"primitives": [other]})
        maker.json["nodes"].append({"mesh": index, "skin": 0})
        maker.json["scenes"][0]["nodes"].append(BODY + index)
    return maker


def written(maker: Maker, tmp_path: Path, suffix: str = ".glb") -> tuple[Path, Path, Rig]:
    """The file, the same with a shape on its first mesh, and its rig."""
    source, target = maker.write(tmp_path / f"in{suffix}"), tmp_path / f"out{suffix}"
    rig = load(source, tmp_path)
    write(source, target, rig, [shape_of(rig, "new", 9, last=30)])
    check_valid([(source, target)])
    return source, target, rig


def output(path: Path, channel: int) -> np.ndarray:
    """The values of a channel of the first clip."""
    gltf = fresh(path)
    animation = gltf.json["animations"][0]
    return gltf.floats(animation["samplers"][animation["channels"][channel]["sampler"]]["output"])[:, 0]


def looks(path: Path, rig: Rig, tmp_path: Path) -> np.ndarray:
    return shown(path, rig, {}, tmp_path)[0]


FLOATS = np.array([0, 0.25, 1, 0.5], "<f4")


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("kind", ["LINEAR", "STEP"])
def test_clip_stays(kind: str, suffix: str, tmp_path: Path) -> None:
    """The file's targets move as they did; the new one stays at 0 and can be turned on."""
    maker = tubes(2)
    weight_clip(maker, BODY, FLOATS, kind)
    source, target, rig = written(maker, tmp_path, suffix)
    assert output(target, 3).tolist() == [0, 0.25, 0, 1, 0.5, 0]
    assert np.abs(looks(source, rig, tmp_path) - looks(target, rig, tmp_path)).max() < 1e-9
    gltf = fresh(source)
    both = [gltf.floats(t["POSITION"]) for t in gltf.json["meshes"][0]["primitives"][0]["targets"]]
    _, vertices, offsets = shape_of(rig, "new", 9, last=30)
    got, _ = shown(target, rig, {"new": 1}, tmp_path)
    for k, time in enumerate(TIMES):
        weights = FLOATS.reshape(2, 2)[[int(time == 1), int(time == 1)]][0] if kind == "STEP" else (
            (1 - time) * FLOATS[:2] + time * FLOATS[2:])  # fmt: skip
        rest = rig.arrays["rest"] + weights[0] * both[0] + weights[1] * both[1]
        rest[vertices] += offsets
        assert np.abs(got[k] - expected(source, rig, rest)[k]).max() < NEAR * rig.length


def test_cubic(tmp_path: Path) -> None:
    """Tangents are values too: a key is three rows of weights."""
    values = np.array([0, 0, 0.25, 0.5, 1, -1, 0.5, 0, 1, 0.75, 0, 0], "<f4")
    maker = tubes(2)
    weight_clip(maker, BODY, values, "CUBICSPLINE")
    source, target, rig = written(maker, tmp_path)
    assert np.array_equal(output(target, 3).reshape(6, 3), np.c_[values.reshape(6, 2), np.zeros(6)])
    assert np.abs(looks(source, rig, tmp_path) - looks(target, rig, tmp_path)).max() < 1e-9


@pytest.mark.parametrize("dtype", ["u1", "i1", "<u2", "<i2"])
def test_normalised(dtype: str, tmp_path: Path) -> None:
    values = np.array([0, 30, 120, 77], dtype)
    maker = tubes(2)
    weight_clip(maker, BODY, values, normalized=True)
    source, target, rig = written(maker, tmp_path)
    top = np.iinfo(dtype).max
    assert np.allclose(output(target, 3) * top, [0, 30, 0, 120, 77, 0], atol=1e-9)
    assert np.abs(looks(source, rig, tmp_path) - looks(target, rig, tmp_path)).max() < 1e-9


def test_sparse_output(tmp_path: Path) -> None:
    maker = tubes(2)
    weight_clip(maker, BODY, FLOATS)
    maker.json["animations"][0]["samplers"][1]["output"] = maker.sparse(FLOATS)
    _, target, _ = written(maker, tmp_path)
    assert output(target, 3).tolist() == [0, 0.25, 0, 1, 0.5, 0]


def test_sampler_of_two_meshes(tmp_path: Path) -> None:
    """A sampler that also moves a mesh that stays is doubled; channels that agree share the copy."""
    maker = tubes(2, 2)
    sampler = weight_clip(maker, BODY, FLOATS)
    maker.json["nodes"].append({"mesh": 0, "skin": 0})
    animation = maker.json["animations"][0]
    for node in (BODY + 1, BODY + 2):
        animation["channels"].append({"sampler": sampler, "target": {"node": node, "path": "weights"}})
    maker.json["scenes"][0]["nodes"].append(BODY + 2)
    source, target, rig = written(maker, tmp_path)
    channels = fresh(target).json["animations"][0]["channels"]
    assert [channel["sampler"] for channel in channels] == [0, 0, 0, 2, 1, 2]
    assert output(target, 3).tolist() == output(target, 5).tolist() == [0, 0.25, 0, 1, 0.5, 0]
    assert output(target, 4).tolist() == FLOATS.tolist()
    assert np.abs(looks(source, rig, tmp_path) - looks(target, rig, tmp_path)).max() < 1e-9


def test_sampler_of_two_nodes(tmp_path: Path) -> None:
    """Two channels that need the same keep one sampler."""
    maker = tubes(2)
    sampler = weight_clip(maker, BODY, FLOATS)
    maker.json["nodes"].append({"mesh": 0, "skin": 0})
    channel = {"sampler": sampler, "target": {"node": BODY + 1, "path": "weights"}}
    maker.json["animations"][0]["channels"].append(channel)
    maker.json["scenes"][0]["nodes"].append(BODY + 1)
    source, target, _ = written(maker, tmp_path)
    old, new = (fresh(path).json["animations"][0] for path in (source, target))
    assert len(new["samplers"]) == 2 and new["channels"] == old["channels"]
    assert new["samplers"][0] == old["samplers"][0]


def test_clips_of_other_meshes_stay(tmp_path: Path) -> None:
    maker = tubes(0, 2)
    weight_clip(maker, BODY + 1, FLOATS)
    source, target, _ = written(maker, tmp_path)
    assert fresh(source).json["animations"] == fresh(target).json["animations"]


@pytest.mark.parametrize(
    "pointer, is_widened",
    [("/nodes/8/weights", True), ("/meshes/0/weights", True), ("/nodes/8/weights/1", False), ("/nodes/9/weights", False),
     ("/meshes/99/weights", False)],
)  # fmt: skip
def test_pointers(pointer: str, is_widened: bool, tmp_path: Path) -> None:
    """KHR_animation_pointer names weights in another way."""
    maker = tubes(2, 2)
    weight_clip(maker, BODY, FLOATS)
    maker.json["extensionsUsed"] = ["KHR_animation_pointer"]
    maker.json["animations"][0]["channels"][3]["target"] = {
        "path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}
    }  # fmt: skip
    source, target = maker.write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    write(source, target, rig, [shape_of(rig, "new", 9, last=30)])
    assert output(target, 3).tolist() == ([0, 0.25, 0, 1, 0.5, 0] if is_widened else FLOATS.tolist())


def test_refusals(tmp_path: Path) -> None:
    """Weights that do not fit before would mean something else after; nothing is written."""
    def answer(maker: Maker) -> dict:
        source = maker.write(tmp_path / "in.glb")
        rig = load(source, tmp_path)
        shape = shape_of(rig, "new", 9, last=30)
        result = export(source, tmp_path / "out.glb", *rig.rows(4), tmp_path, None, [shape])
        assert not (tmp_path / "out.glb").exists()
        assert export(source, tmp_path / "ok.glb", *rig.rows(4), tmp_path)["status"] == "ok"
        return result

    for targets, values, kind in [(2, FLOATS[:3], "LINEAR"), (2, FLOATS, "CUBICSPLINE"), (0, FLOATS, "LINEAR")]:
        maker = tubes(targets)
        weight_clip(maker, BODY, values, kind)
        result = answer(maker)
        assert result["status"] == "unsupported" and f"the {targets} morph targets of mesh 0" in result["text"]
    maker = tubes(2)
    weight_clip(maker, BODY, FLOATS)
    maker.json["accessors"][-1]["byteOffset"] = 8
    result = answer(maker)
    assert result["status"] == "bad_rig" and "beyond its buffer" in result["text"]
