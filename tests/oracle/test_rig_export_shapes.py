"""Exports of corrective shapes: morph targets behind those that a file has."""

import json
from pathlib import Path

import numpy as np
import pytest
from rig_lib import ASSETS, Gltf, Rig, Shape, export, load
from rig_make import Maker, Tube
from rig_morphs import bend, expected, fresh, primitive, shown, vectors
from test_rig_export import ACCEPTED, check_rows, check_valid, sculpted

NEAR = 1e-5  # of L


def shape_of(rig: Rig, name: str, count: int, seed: int = 2, first: int = 0, last: int | None = None) -> Shape:
    """Random offsets of `count` vertices in [first, last), in no order."""
    rng = np.random.default_rng(seed)
    vertices = first + rng.permutation((last or len(rig.arrays["rest"])) - first)[:count]
    return name, vertices, rng.normal(0, 0.02 * rig.length, (len(vertices), 3)).astype("<f4")


def shaped(rest: np.ndarray, *shapes: tuple[Shape, float]) -> np.ndarray:
    """Rest positions with shapes added, each so strong."""
    result = rest.astype(np.float64)
    for (_, vertices, offsets), strength in shapes:
        result[vertices] += strength * offsets.astype(np.float64)
    return result


def write(source: Path, target: Path, rig: Rig, shapes: list[Shape], rest: np.ndarray | None = None) -> dict:
    """Exports with the file's own weights; the report of a success."""
    report = export(source, target, *rig.rows(max(4, rig.summary["most"])), target.parent, rest, shapes)
    assert report["status"] == "ok", report
    return report


def tube(*targets: int, normals: bool = False, **mesh: object) -> Maker:
    """A tube that bends, a primitive for each number of targets."""
    maker, shape = Maker(), Tube()
    return bend(shape.build(maker, [primitive(maker, shape, count, normals) for count in targets], **mesh))


def mesh_of(path: Path, mesh: int = 0) -> dict:
    return fresh(path).json["meshes"][mesh]


@pytest.mark.parametrize("count", [1, 4, 15, 16, 30])
@pytest.mark.parametrize("suffix", [".glb", ".gltf", "+bin"])
def test_posed(suffix: str, count: int, tmp_path: Path) -> None:
    """What three.js shows at any strength is NumPy's rest + offset, posed."""
    ending = ".gltf" if suffix == "+bin" else suffix
    source = tube(0).write(tmp_path / f"in{ending}", "in.bin" if suffix == "+bin" else None)
    rig, target = load(source, tmp_path), tmp_path / f"out{ending}"
    shape = shape_of(rig, "elbow bent", count)
    assert write(source, target, rig, [shape])["targets"] == 1
    for strength in (0, 0.5, 1):
        got, names = shown(target, rig, {"elbow bent": strength}, tmp_path)
        wanted = expected(source, rig, shaped(rig.arrays["rest"], (shape, strength)))
        assert np.abs(got - wanted).max() < NEAR * rig.length
    assert names == ["elbow bent"]
    index = mesh_of(target)["primitives"][0]["targets"][0]["POSITION"]
    assert ("sparse" in fresh(target).json["accessors"][index]) == (count <= 15)
    assert "weights" not in mesh_of(target)
    assert np.array_equal(load(target, tmp_path).arrays["rest"], rig.arrays["rest"])
    check_valid([(source, target)])


def test_several_and_rest(tmp_path: Path) -> None:
    """Shapes add up, and start from a rest position that moved."""
    source, target = tube(0).write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    one, two = shape_of(rig, "one", 20), shape_of(rig, "zwei \u00e4 \"2\"", 5, seed=9)
    rest = rig.arrays["rest"] + np.float32(0.125)
    write(source, target, rig, [one, two], rest)
    got, names = shown(target, rig, {one[0]: 1, two[0]: 0.25}, tmp_path)
    assert names == [one[0], two[0]]
    assert np.abs(got - expected(source, rig, shaped(rest, (one, 1), (two, 0.25)))).max() < NEAR * rig.length
    check_valid([(source, target)])


@pytest.mark.parametrize("normals", [False, True])
@pytest.mark.parametrize(
    "names, weights",
    [(None, None), (None, [0.5, 0.25]), ([], [0.5]), (["smile"], [0.5, 0.25, 1]), (["smile", "frown"], [0.5, 0.25]),
     (["smile", "frown", "too many"], None), (["wink", 7], [0.5, 0.25])],
)  # fmt: skip
def test_existing_targets(normals: bool, names: list | None, weights: list | None, tmp_path: Path) -> None:
    """Targets of the file keep their place, elements, weights and names, and look as they did."""
    mesh: dict = {} if names is None else {"extras": {"made by": "hand", "targetNames": names}}
    mesh |= {} if weights is None else {"weights": weights}
    source, target = tube(2, normals=normals, **mesh).write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    shape = shape_of(rig, "wink", 8)
    write(source, target, rig, [shape])
    old, new = mesh_of(source), mesh_of(target)
    assert new["primitives"][0]["targets"][:2] == old["primitives"][0]["targets"]
    assert [set(t) for t in new["primitives"][0]["targets"]] == [set(old["primitives"][0]["targets"][0])] * 3
    if weights is None:
        assert "weights" not in new
    else:
        assert new["weights"] == ((weights + [0])[:2] if len(weights) < 2 else weights[:2]) + [0]
    kept = (names or [])[:2]
    given = new["extras"]["targetNames"]
    assert given[: len(kept)] == kept and len(given) == len(set(given)) == 3
    assert given[2] == ("wink" if "wink" not in kept else "wink_2")
    assert new["extras"].get("made by") == mesh.get("extras", {}).get("made by")
    gltf = fresh(target)
    elements = [gltf.floats(t["POSITION"]) for t in old["primitives"][0]["targets"]]
    rest = rig.arrays["rest"] + 1.0 * elements[0] - 0.5 * elements[1]
    got, _ = shown(target, rig, {given[0]: 1, given[1]: -0.5, given[2]: 0.5}, tmp_path)
    wanted = expected(source, rig, shaped(rest, (shape, 0.5)))
    assert np.abs(got - wanted).max() < NEAR * rig.length
    check_valid([(source, target)])


def test_names_from_accessors(tmp_path: Path) -> None:
    """Targets without names were shown under those of their accessors, or by number."""
    maker = tube(2)
    first = maker.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    maker.json["accessors"][first]["name"] = "from FBX"
    source, target = maker.write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    write(source, target, rig, [shape_of(rig, "new", 3)])
    assert mesh_of(target)["extras"] == {"targetNames": ["from FBX", "target_1", "new"]}


@pytest.mark.parametrize("extras", [{}, {"note": "kept"}, 5, [1, 2], {"targetNames": "none"}])
def test_extras(extras: object, tmp_path: Path) -> None:
    """Whatever stands in extras stays; without a place for them there are no names."""
    source, target = tube(0, extras=extras).write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    write(source, target, rig, [shape_of(rig, "new", 3)])
    names = {"targetNames": ["new"]}
    has_place = isinstance(extras, dict) and "targetNames" not in extras
    assert mesh_of(target)["extras"] == (extras | names if has_place else extras)
    check_valid([(source, target)])


def test_targets_without_positions(tmp_path: Path) -> None:
    """Targets of the file that move normals alone do not become something else in three.js."""
    maker = tube(1, normals=True)
    del maker.json["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    source, target = maker.write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    shape = shape_of(rig, "new", 9)
    write(source, target, rig, [shape])
    got, _ = shown(target, rig, {"target_0": 1, "new": 1}, tmp_path)
    assert np.abs(got - expected(source, rig, shaped(rig.arrays["rest"], (shape, 1)))).max() < NEAR * rig.length
    check_valid([(source, target)])


def test_primitives_of_a_mesh(tmp_path: Path) -> None:
    """A shape on one primitive is a target of zeros on the others, skinned or not."""
    maker, shape = Maker(), Tube()
    bare = {"attributes": {"POSITION": vectors(maker, shape.positions)}}
    maker = bend(shape.build(maker, [primitive(maker, shape), primitive(maker, shape), bare]))
    source, target = maker.write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    first, second = shape_of(rig, "a", 6, last=30), shape_of(rig, "b", 25, first=20, last=60)
    assert write(source, target, rig, [first, second])["targets"] == 2
    gltf, mesh = fresh(target), mesh_of(target)
    assert [len(p["targets"]) for p in mesh["primitives"]] == [2, 2, 2]
    for part, target_index, is_zero in [(0, 0, False), (1, 0, True), (1, 1, False), (2, 0, True), (2, 1, True)]:
        accessor = mesh["primitives"][part]["targets"][target_index]["POSITION"]
        assert gltf.elements(accessor).any() != is_zero
        assert not is_zero or "bufferView" not in gltf.json["accessors"][accessor]
    got, _ = shown(target, rig, {"a": 1, "b": 0.5}, tmp_path)
    wanted = expected(source, rig, shaped(rig.arrays["rest"], (first, 1), (second, 0.5)))
    assert np.abs(got - wanted).max() < NEAR * rig.length
    check_valid([(source, target)])


@pytest.mark.parametrize("is_same", [True, False])
def test_shared_vertex_buffer(is_same: bool, tmp_path: Path) -> None:
    """Primitives on one POSITION share the targets' accessors too, as long as they agree."""
    maker, shape = Maker(), Tube()
    first = primitive(maker, shape)
    second = {"attributes": first["attributes"], "indices": maker.accessor(shape.indices[:30])}
    maker = bend(shape.build(maker, [first, second]))
    source, target = maker.write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    name, vertices, offsets = shape_of(rig, "a", 20, last=30)
    both = (name, np.r_[vertices, vertices + 30], np.r_[offsets, offsets if is_same else 2 * offsets])
    write(source, target, rig, [both])
    one, two = (p["targets"][0]["POSITION"] for p in mesh_of(target)["primitives"])
    assert (one == two) == is_same
    got, _ = shown(target, rig, {"a": 1}, tmp_path)
    assert np.abs(got - expected(source, rig, shaped(rig.arrays["rest"], (both, 1)))).max() < NEAR * rig.length
    check_valid([(source, target)])


def test_two_meshes_and_their_nodes(tmp_path: Path) -> None:
    """Only the mesh that has the vertices changes, and each node that lists weights for it."""
    maker, shape = Maker(), Tube()
    primitives = [primitive(maker, shape, 1), primitive(maker, shape, 1)]
    maker = bend(shape.build(maker, primitives[:1]))
    maker.json["meshes"].append({"primitives": primitives[1:], "weights": [0.5]})
    body = maker.json["nodes"][8]
    body["weights"] = [0.75]
    maker.json["nodes"] += [body | {"weights": [0.25]}, {"name": "no weights", "mesh": 0, "skin": 0},
                            {"name": "other", "mesh": 1, "skin": 0, "weights": [0.125]}]  # fmt: skip
    maker.json["scenes"][0]["nodes"] += [9, 10, 11]
    source, target = maker.write(tmp_path / "in.glb"), tmp_path / "out.glb"
    rig = load(source, tmp_path)
    assert len(rig.arrays["rest"]) == 60
    assert write(source, target, rig, [shape_of(rig, "a", 5, last=30)])["targets"] == 1
    old, new = fresh(source).json, fresh(target).json
    assert [node.get("weights") for node in new["nodes"][8:]] == [[0.75, 0], [0.25, 0], None, [0.125]]
    assert new["meshes"][1] == old["meshes"][1]
    assert new["nodes"][:8] == old["nodes"][:8]
    assert len(new["meshes"][0]["primitives"][0]["targets"]) == 2
    check_valid([(source, target)])


@pytest.mark.parametrize("name", ACCEPTED)
def test_assets(name: str, tmp_path: Path) -> None:
    """Weights, rest positions and shapes in one file, of any real one; shapes over the source again."""
    source, target = ASSETS / name, tmp_path / "out" / Path(name).name
    target.parent.mkdir()
    rig = load(source, tmp_path)
    rows = sculpted(rig, 4)
    rest = rig.arrays["rest"] + np.float32(0.01 * rig.length)
    shape = shape_of(rig, "a pose", max(1, len(rest) // 10))
    report = export(source, target, *rows, tmp_path, rest, [shape])
    assert report["status"] == "ok" and report["targets"] >= 1
    again = load(target, tmp_path)
    assert np.array_equal(again.arrays["rest"], rest)
    check_rows(again, *rows, report["largest_rounding"])
    check_offsets(fresh(target), rig, shape, "a pose")
    assert export(target, target, *rows, tmp_path, None, [shape])["status"] == "ok"
    check_offsets(fresh(target), rig, shape, "a pose")
    check_valid([(source, target)])


def check_offsets(gltf: Gltf, rig: Rig, shape: Shape, name: str) -> None:
    """The targets of that name hold the shape and nothing else."""
    wanted = np.zeros((rig.summary["vertices"], 3), "<f4")
    wanted[shape[1]] = shape[2]
    for part in rig.summary["parts"]:
        mesh = gltf.json["meshes"][part["mesh"]]
        rows = wanted[part["first"] : part["first"] + part["count"]]
        names = mesh.get("extras", {}).get("targetNames", [])
        if name in names:
            target = mesh["primitives"][part["primitive"]]["targets"][names.index(name)]
            assert np.array_equal(gltf.elements(target["POSITION"]), rows)
        else:
            assert not rows.any()


def refused(maker: Maker, shape: Shape, tmp_path: Path) -> dict:
    source = maker.write(tmp_path / "in.glb")
    answer = export(source, tmp_path / "out.glb", *load(source, tmp_path).rows(4), tmp_path, None, [shape])
    assert not (tmp_path / "out.glb").exists()
    return answer


def test_refusals(tmp_path: Path) -> None:
    one = ("a", [3], np.ones((1, 3)))
    answer = refused(tube(1, 2), one, tmp_path)
    assert answer["status"] == "unsupported" and "1 morph targets on primitive 0 and 2" in answer["text"]
    maker = tube(0, 0)
    del maker.json["meshes"][0]["primitives"][1]["attributes"]["POSITION"]
    answer = refused(maker, one, tmp_path)
    assert answer["status"] == "unsupported" and "primitive 1 has no POSITION" in answer["text"]
    for targets in ({"POSITION": 0}, [0]):
        maker = tube(0)
        maker.json["meshes"][0]["primitives"][0]["targets"] = targets
        answer = refused(maker, one, tmp_path)
        assert answer["status"] == "unsupported" and "no list of objects" in answer["text"]
    answer = refused(tube(0), ("a", [30], np.ones((1, 3))), tmp_path)
    assert answer["status"] == "bad_index" and "vertex 30 of 30" in answer["text"]
    for value in (np.nan, -np.inf):
        answer = refused(tube(0), ("a", [3, 4], [[0, 0, 0], [0, value, 0]]), tmp_path)
        assert answer["status"] == "not_finite" and "vertex 4 " in answer["text"]


def test_refuses_a_file_without_a_buffer(tmp_path: Path) -> None:
    """Elements that are all zero need no buffer; there is none to put numbers into."""
    zeros = {"componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0]}
    document = {
        "asset": {"version": "2.0"},
        "accessors": [zeros, {"componentType": 5121, "count": 3, "type": "VEC4"},
                      {"componentType": 5126, "count": 3, "type": "VEC4"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}}]}],
        "nodes": [{"mesh": 0, "skin": 0}, {}], "skins": [{"joints": [1]}],
    }  # fmt: skip
    source = tmp_path / "in.gltf"
    source.write_text(json.dumps(document))
    answer = export(source, tmp_path / "out.gltf", np.zeros((3, 4)), np.eye(4)[[0, 0, 0]], tmp_path, None,
                    [("a", [1], np.ones((1, 3)))])  # fmt: skip
    assert answer["status"] == "unsupported" and "no buffer" in answer["text"]
    assert not (tmp_path / "out.gltf").exists()
