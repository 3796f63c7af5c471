"""Exports of moved rest positions: POSITION says where vertices are, and nothing else changes."""

import copy
from pathlib import Path

import numpy as np
import pytest
from rig_lib import ASSETS, Rig, asset_paths, export, load
from rig_make import Maker, Tube
from rig_morphs import bend, expected, fresh, primitive, shown, vectors
from test_rig_export import ACCEPTED, check_rows, check_valid, sculpted


def moved(rig: Rig, share: float = 0.2, seed: int = 1) -> np.ndarray:
    """Rest positions of which a share is moved, twins together."""
    rng = np.random.default_rng(seed)
    rest = rig.arrays["rest"].copy()
    twins = rig.arrays.get("twins", np.arange(len(rest)))
    for v in np.flatnonzero(rng.random(len(rest)) < share):
        offset = rng.normal(0, 0.01 * rig.length, 3).astype(np.float32)
        ring, at = [v], int(twins[v])
        while at != v:
            ring.append(at)
            at = int(twins[at])
        rest[ring] = rest[v] + offset
    return rest


def same(source: Path, target: Path, rig: Rig, rest: np.ndarray) -> dict:
    """Exports with the file's own weights; the report of a success."""
    report = export(source, target, *rig.rows(max(4, rig.summary["most"])), target.parent, rest)
    assert report["status"] == "ok", report
    return report


def positions(source: Path) -> set[int]:
    return {p["attributes"]["POSITION"] for m in fresh(source).json["meshes"] for p in m["primitives"]}


def check_others(source: Path, target: Path) -> None:
    """The JSON but for POSITION, and every accessor that is not one, are what they were."""
    old, new = fresh(source), fresh(target)
    was, now = copy.deepcopy(old.json), copy.deepcopy(new.json)
    for document in (was, now):
        for buffer in document["buffers"]:
            buffer.pop("uri", None)
            buffer.pop("byteLength")
        for mesh in document["meshes"]:
            for part in mesh["primitives"]:
                del part["attributes"]["POSITION"]
        for index in positions(source):
            document["accessors"][index].pop("min", None)
            document["accessors"][index].pop("max", None)
    for name in ("accessors", "bufferViews"):
        del now[name][len(was[name]) :]
    assert now == was
    for index in set(range(len(was["accessors"]))) - positions(source):
        assert np.array_equal(old.elements(index).view("u1"), new.elements(index).view("u1")), index


@pytest.mark.parametrize("name", ACCEPTED)
def test_assets(name: str, tmp_path: Path) -> None:
    source, target = ASSETS / name, tmp_path / "out" / Path(name).name
    target.parent.mkdir()
    rig = load(source, tmp_path)
    rest = moved(rig)
    weights = rig.rows(max(4, rig.summary["most"]))
    report = export(source, target, *weights, tmp_path, rest)
    assert report["status"] == "ok" and report["positions"] > 0
    again = load(target, tmp_path)
    assert np.array_equal(again.arrays["rest"], rest)
    assert np.array_equal(again.arrays["joints"], rig.arrays["joints"])
    if not report["accessors"]:  # no row had to be mended
        check_others(source, target)
    check_valid([(source, target)])


def variants() -> dict[str, tuple[Maker, bool]]:
    """Files by what is awkward about POSITION, and whether it can be written in place."""
    made: dict[str, tuple[Maker, bool]] = {}

    def add(name: str, in_place: bool, change) -> None:
        maker, shape = Maker(), Tube()
        result = change(maker, shape)
        made[name] = (bend(shape.build(maker, result if isinstance(result, list) else [result])), in_place)

    def interleaved(maker: Maker, shape: Tube) -> dict:
        columns = maker.interleaved(POSITION=shape.positions, WEIGHTS_0=shape.weights, JOINTS_0=shape.joints)
        low, high = shape.positions.min(0).tolist(), shape.positions.max(0).tolist()
        maker.json["accessors"][columns["POSITION"]] |= {"min": low, "max": high}
        return primitive(maker, shape, **columns)

    def integers(dtype: str, normalized: bool):
        def change(maker: Maker, shape: Tube) -> dict:
            maker.json |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
            top = np.iinfo(dtype).max if normalized else 8
            whole = np.round(shape.positions / 8 * top).astype(dtype)
            row = 4 * whole.dtype.itemsize
            padded = np.zeros((len(whole), row // whole.dtype.itemsize), dtype)
            padded[:, :3] = whole
            extra = {"normalized": True} if normalized else {}
            view = maker.view(padded.tobytes(), byteStride=row)
            return primitive(maker, shape, POSITION=vectors(maker, whole, bufferView=view, **extra))
        return change

    def sparse(maker: Maker, shape: Tube) -> dict:
        index = maker.sparse(shape.positions)
        low, high = shape.positions.min(0).tolist(), shape.positions.max(0).tolist()
        maker.json["accessors"][index] |= {"min": low, "max": high}
        return primitive(maker, shape, POSITION=index)

    def shared(maker: Maker, shape: Tube) -> list[dict]:
        return shape.twice(maker, primitive(maker, shape))

    def aliased(maker: Maker, shape: Tube) -> list[dict]:
        first = primitive(maker, shape)
        return [first, primitive(maker, shape, POSITION=maker.alias(first["attributes"]["POSITION"]))]

    def unskinned(maker: Maker, shape: Tube) -> list[dict]:
        first = primitive(maker, shape)
        return [first, {"attributes": {"POSITION": first["attributes"]["POSITION"]}, "indices": first["indices"]}]

    def own_target(maker: Maker, shape: Tube) -> dict:
        made = primitive(maker, shape)
        return made | {"targets": [{"POSITION": made["attributes"]["POSITION"]}]}

    add("plain", True, primitive)
    add("interleaved", True, interleaved)
    add("i16", False, integers("<i2", False))
    add("i16 normalised", False, integers("<i2", True))
    add("u8", False, integers("u1", False))
    add("i8 normalised", False, integers("i1", True))
    add("sparse", False, sparse)
    add("without a view", False, lambda m, s: primitive(m, s, POSITION=m.accessor(
        s.positions, bufferView=None, min=[0, 0, 0], max=[0, 0, 0])))  # fmt: skip
    add("shared by two primitives", True, shared)
    add("aliased", False, aliased)
    add("shared with a primitive that has no skin", False, unskinned)
    add("its own morph target", False, own_target)
    return made


@pytest.mark.parametrize("suffix", [".glb", ".gltf", "+bin"])
def test_variants(suffix: str, tmp_path: Path) -> None:
    pairs = []
    for name, (maker, in_place) in variants().items():
        ending = ".gltf" if suffix == "+bin" else suffix
        source = maker.write(tmp_path / f"{name}{ending}", f"{name}.bin" if suffix == "+bin" else None)
        target = tmp_path / f"{name} out{ending}"
        rig = load(source, tmp_path)
        rest = moved(rig)
        if "shared by" in name:
            half = len(rest) // 2
            rest[half:] = rest[:half]
        report = same(source, target, rig, rest)
        assert report["positions"] == len(rig.summary["parts"]) and report["accessors"] == 0, name
        again = load(target, tmp_path)
        assert np.array_equal(again.arrays["rest"], rest), name
        check_others(source, target)
        old, new = fresh(source), fresh(target)
        grew = len(new.json["accessors"]) - len(old.json["accessors"])
        assert (grew == 0) == in_place, (name, grew)
        if not in_place:  # what others stand on is as it was
            for index in positions(source):
                assert np.array_equal(old.elements(index), new.elements(index)), name
        if in_place and suffix == ".glb":
            assert abs(target.stat().st_size - source.stat().st_size) < 200  # bounds
        got, _ = shown(target, rig, None, tmp_path)
        assert np.abs(got - expected(source, rig, rest)).max() < 1e-5 * rig.length, name
        pairs.append((source, target))
    check_valid(pairs)


def test_only_moved_bytes_differ(tmp_path: Path) -> None:
    """One vertex inside the bounds moves: twelve bytes of the file are others, at most."""
    source = variants()["interleaved"][0].write(tmp_path / "in.glb")
    rig = load(source, tmp_path)
    rest = rig.arrays["rest"].copy()
    rest[7] *= np.float32(0.75)
    same(source, tmp_path / "out.glb", rig, rest)
    before, after = (np.frombuffer((tmp_path / f"{n}.glb").read_bytes(), "u1") for n in ("in", "out"))
    assert len(before) == len(after)
    different = np.flatnonzero(before != after)
    assert 0 < len(different) <= 12 and np.ptp(different) < 12


def test_primitives_that_part(tmp_path: Path) -> None:
    """Two primitives on one vertex buffer of which one moves: the other keeps what it had."""
    source = variants()["shared by two primitives"][0].write(tmp_path / "in.glb")
    rig = load(source, tmp_path)
    rest = rig.arrays["rest"].copy()
    half = len(rest) // 2
    rest[half:] += np.float32(0.25)
    report = same(source, tmp_path / "out.glb", rig, rest)
    assert report["positions"] == 1
    assert np.array_equal(load(tmp_path / "out.glb", tmp_path).arrays["rest"], rest)
    check_valid([(source, tmp_path / "out.glb")])


@pytest.mark.parametrize("name", [name for name in asset_paths() if "tube100" in name or "quantized" in name] + [""])
def test_nothing_moved(name: str, tmp_path: Path) -> None:
    """Positions that are the file's, or shapes without a vertex, are no change."""
    source = ASSETS / name if name else variants()["sparse"][0].write(tmp_path / "tube.glb")
    target = tmp_path / "out.glb"
    rig = load(source, tmp_path)
    rows = rig.rows(max(4, rig.summary["most"]))
    empty = ("empty", np.zeros(0), np.zeros((0, 3)))
    for rest, shapes in ((None, []), (rig.arrays["rest"], []), (rig.arrays["rest"], [empty])):
        report = export(source, target, *rows, tmp_path, rest, shapes)
        assert report["status"] == "ok" and report["positions"] == report["targets"] == 0
        assert target.read_bytes() == source.read_bytes()


def test_with_weights(tmp_path: Path) -> None:
    """Rows and positions go into one file together, in place and into new accessors."""
    for name, (maker, _) in variants().items():
        source, target = maker.write(tmp_path / f"{name}.glb"), tmp_path / "out.glb"
        rig = load(source, tmp_path)
        wanted, rest = sculpted(rig, 8), moved(rig, seed=4)
        report = export(source, target, *wanted, tmp_path, rest)
        assert report["status"] == "ok", (name, report)
        again = load(target, tmp_path)
        assert np.array_equal(again.arrays["rest"], rest), name
        check_rows(again, *wanted, 0)
        check_valid([(source, target)])


def test_over_the_source(tmp_path: Path) -> None:
    source = bend(variants()["sparse"][0]).write(tmp_path / "tube.gltf", "tube.bin")
    for seed in (1, 2):
        rig = load(source, tmp_path)
        rest = moved(rig, seed=seed)
        same(source, source, rig, rest)
        assert np.array_equal(load(source, tmp_path).arrays["rest"], rest)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_refuses_what_is_not_finite(value: float, tmp_path: Path) -> None:
    source = variants()["plain"][0].write(tmp_path / "tube.glb")
    rig = load(source, tmp_path)
    rest = rig.arrays["rest"].copy()
    rest[11, 2] = value
    answer = export(source, tmp_path / "out.glb", *rig.rows(4), tmp_path, rest)
    assert answer["status"] == "not_finite" and "vertex 11 " in answer["text"]
    assert not (tmp_path / "out.glb").exists()
