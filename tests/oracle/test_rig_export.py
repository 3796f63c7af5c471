"""Exports: nothing but weights changes, and what is written is valid."""

import copy
import os
from pathlib import Path

import numpy as np
import pytest
from rig_lib import ASSETS, EMPTY, Gltf, Rig, asset_paths, export, export_after, load, run_node
from rig_make import Maker, Tube, plain
from test_rig_load import NOTES, REFUSED

ACCEPTED = [name for name in asset_paths() if name not in REFUSED]
MENDED = {name for name, notes in NOTES.items() if any(note.startswith("weights") for note in notes)}


def fresh(path: Path) -> Gltf:
    """Reads past the cache: exports overwrite each other's names."""
    return Gltf.read.__wrapped__(Gltf, path)


def sculpted(rig: Rig, slot_count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Rows of random weights on three in ten vertices, the same for all twins of a ring."""
    rng = np.random.default_rng(seed)
    joints, weights = rig.rows(max(slot_count, rig.summary["most"]))
    joints, weights = joints[:, :slot_count].copy(), weights[:, :slot_count].copy()
    kept = weights.sum(1, dtype=np.float64) > 1 - 1e-7
    twins = rig.arrays.get("twins", np.arange(len(joints)))
    done = np.zeros(len(joints), bool)
    for v in range(len(joints)):
        if done[v]:
            continue
        ring, at = [v], int(twins[v])
        while at != v:
            ring.append(at)
            at = int(twins[at])
        done[ring] = True
        if kept[v] and rng.random() > 0.3:
            continue
        bones = np.flatnonzero(rig.arrays["bone_skins"] == rig.arrays["skins"][v])
        count = int(rng.integers(1, min(slot_count, len(bones)) + 1))
        row = np.sort(rng.random(count) + 0.01)[::-1]
        row = (row / row.sum()).astype(np.float32)
        row[0] = np.float32(1 - row[1:].sum(dtype=np.float64))
        joints[ring], weights[ring] = EMPTY, 0
        joints[ring, :count] = rng.permutation(bones)[:count]
        weights[ring, :count] = row
    return joints, weights


def check_rows(rig: Rig, joints: np.ndarray, weights: np.ndarray, rounding: float) -> None:
    """A reloaded rig has the rows that were asked for, within the rounding of its file."""
    bones = len(rig.summary["bones"])
    for first in range(0, len(joints), 4096):
        rows = slice(first, first + 4096)
        asked = np.zeros((len(joints[rows]), bones + 1))
        np.put_along_axis(asked, np.where(joints[rows] == EMPTY, bones, joints[rows]), weights[rows], 1)
        offsets = rig.arrays["offsets"][first : first + len(asked) + 1].astype(int)
        where = np.repeat(np.arange(len(asked)), np.diff(offsets))
        got = np.zeros((len(asked), bones + 1))
        span = slice(offsets[0], offsets[-1])
        got[where, rig.arrays["joints"][span]] = rig.arrays["weights"][span]
        assert np.abs(got - asked)[:, :bones].max() <= rounding + 1e-7


def weight_accessors(gltf: Gltf) -> set[int]:
    return {
        index
        for mesh in gltf.json["meshes"]
        for primitive in mesh["primitives"]
        for name, index in primitive["attributes"].items()
        if name.startswith(("JOINTS_", "WEIGHTS_"))
    }


def check_only_weights_differ(source: Path, target: Path) -> None:
    """All that is not weights is what it was: the JSON, every other accessor, every image."""
    old, new = fresh(source), fresh(target)
    weights = weight_accessors(old)
    was, now = copy.deepcopy(old.json), copy.deepcopy(new.json)
    for document in (was, now):
        for buffer in document["buffers"]:
            buffer.pop("uri", None)
            buffer.pop("byteLength")
        for mesh in document["meshes"]:
            for primitive in mesh["primitives"]:
                for name in list(primitive["attributes"]):
                    if name.startswith(("JOINTS_", "WEIGHTS_")):
                        del primitive["attributes"][name]
        for index in weights:
            document["accessors"][index].pop("min", None)
            document["accessors"][index].pop("max", None)
    for name in ("accessors", "bufferViews"):
        del now[name][len(was[name]) :]
    assert now == was
    others = {
        index
        for mesh in was["meshes"] for primitive in mesh["primitives"] for index in primitive["attributes"].values()
    }  # fmt: skip
    for index in set(range(len(was["accessors"]))) - (weights - others):
        assert np.array_equal(old.elements(index).view("u1"), new.elements(index).view("u1"))
    for image in old.json.get("images", []):
        if "bufferView" in image:
            view = old.json["bufferViews"][image["bufferView"]]
            start, buffer = view.get("byteOffset", 0), view["buffer"]
            part = slice(start, start + view["byteLength"])
            assert old.buffers[buffer][part] == new.buffers[buffer][part]


def check_only_weight_bytes_differ(source: Path, target: Path) -> None:
    """For a .glb written in place: every other byte of the file is what it was."""
    before, after = (np.frombuffer(path.read_bytes(), "u1") for path in (source, target))
    assert len(before) == len(after)
    gltf = fresh(source)
    allowed = np.zeros(len(before), bool)
    start = 28 + int(before[12:16].view("<u4")[0])
    for index in weight_accessors(gltf):
        for _, first, last in gltf.byte_ranges(index):
            allowed[start + first : start + last] = True
    assert not (before != after)[~allowed].any()
    assert (before != after).any()


def check_valid(pairs: list[tuple[Path, Path]]) -> None:
    """The validator finds no error in a target that it did not find in the source."""
    answers = run_node("rig_validate.mjs", [str(path) for pair in pairs for path in pair])
    for (source, target), old, new in zip(pairs, answers[::2], answers[1::2]):
        for code, count in new.items():
            assert count <= old.get(code, 0), f"{source.name} -> {target.name}: {new}, was {old}"


@pytest.mark.parametrize("name", ACCEPTED)
def test_identity(name: str, tmp_path: Path) -> None:
    """load -> export -> load is the identity, to the byte where nothing had to be mended."""
    source, target = ASSETS / name, tmp_path / "out" / Path(name).name
    target.parent.mkdir()
    rig = load(source, tmp_path)
    report = export(source, target, *rig.rows(max(4, rig.summary["most"])), tmp_path)
    assert report["status"] == "ok", report
    again = load(target, tmp_path)
    if name in MENDED:
        assert "weights_normalised" not in again.summary["notes"]
        assert "weights_missing" not in again.summary["notes"]
        assert np.array_equal(again.arrays["rest"], rig.arrays["rest"])
        check_rows(again, *rig.rows(rig.summary["most"]), report["largest_rounding"])
        return
    for path in [source, *source.parent.glob(source.stem + ".bin")]:
        assert (target.parent / path.name).read_bytes() == path.read_bytes()
    del again.summary["bytes"], rig.summary["bytes"]  # the path counts
    assert again.summary == rig.summary
    for key, array in rig.arrays.items():
        assert np.array_equal(array, again.arrays[key]), key


@pytest.mark.parametrize("name", ACCEPTED)
def test_only_weights_differ(name: str, tmp_path: Path) -> None:
    source, target = ASSETS / name, tmp_path / "out" / Path(name).name
    target.parent.mkdir()
    rig = load(source, tmp_path)
    wanted = sculpted(rig, 4)
    report = export(source, target, *wanted, tmp_path)
    assert report["status"] == "ok" and report["accessors"] > 0
    check_only_weights_differ(source, target)
    again = load(target, tmp_path)
    check_rows(again, *wanted, report["largest_rounding"])
    is_float = all(
        fresh(source).json["accessors"][index]["componentType"] == 5126 or not is_weights
        for mesh in fresh(source).json["meshes"]
        for primitive in mesh["primitives"]
        for attribute, index in primitive["attributes"].items()
        for is_weights in [attribute.startswith("WEIGHTS_")]
    )
    assert (report["largest_rounding"] == 0) == is_float
    assert ("twins" in again.arrays) == ("twins" in rig.arrays)
    if "twins" in rig.arrays:  # no crack opens
        assert np.array_equal(again.arrays["twins"], rig.arrays["twins"]) or not is_float
    old, new = fresh(source).json["accessors"], fresh(target).json["accessors"]
    has_bounds = any("min" in old[index] for index in weight_accessors(fresh(source)))
    if source.suffix == ".glb" and len(old) == len(new) and not has_bounds:
        check_only_weight_bytes_differ(source, target)


@pytest.mark.skipif(not ACCEPTED, reason="the asset collection is not there")
@pytest.mark.parametrize("slot_count", [4, 8])
def test_validator(slot_count: int, tmp_path: Path) -> None:
    pairs = []
    for index, name in enumerate(ACCEPTED):
        source, target = ASSETS / name, tmp_path / str(index) / Path(name).name
        target.parent.mkdir()
        report = export(source, target, *sculpted(load(source, tmp_path), slot_count), tmp_path)
        assert report["status"] == "ok", report
        pairs.append((source, target))
    check_valid(pairs)


def variants() -> dict[str, Maker]:
    """Files whose sets cannot simply be written over, and files that look like it and can."""
    made = {}

    def add(name: str, shape: Tube, change) -> None:
        maker = Maker()
        result = change(maker, shape)
        primitives = result if isinstance(result, list) else [result]
        made[name] = shape.build(maker, primitives)

    def one(maker: Maker, shape: Tube, **attributes: int) -> dict:
        return {"attributes": shape.attributes(maker, **attributes), "indices": maker.accessor(shape.indices)}

    def shared(maker: Maker, shape: Tube) -> list[dict]:
        return shape.twice(maker, one(maker, shape))

    def aliased(maker: Maker, shape: Tube) -> list[dict]:
        first = one(maker, shape)
        alias = {**first["attributes"], "WEIGHTS_0": maker.alias(first["attributes"]["WEIGHTS_0"])}
        moved = maker.accessor(shape.positions + np.float32(9))
        return [first, {"attributes": {**alias, "POSITION": moved}, "indices": first["indices"]}]

    def bounded(maker: Maker, shape: Tube) -> dict:
        joints, weights = shape.joints, shape.weights
        return one(
            maker, shape,
            JOINTS_0=maker.accessor(joints, min=joints.min(0).tolist(), max=joints.max(0).tolist()),
            WEIGHTS_0=maker.accessor(weights, min=weights.min(0).tolist(), max=weights.max(0).tolist()),
        )  # fmt: skip

    def narrow(maker: Maker, shape: Tube) -> dict:
        shape.joints[:] %= 250
        return one(maker, shape, JOINTS_0=maker.accessor(shape.joints.astype("u1")))

    def mixed(maker: Maker, shape: Tube) -> dict:
        none = np.zeros_like(shape.shares)
        return one(
            maker, shape,
            WEIGHTS_0=maker.accessor(shape.shares.astype("<u2") * 257, normalized=True),
            JOINTS_1=maker.accessor(none), WEIGHTS_1=maker.accessor(none, normalized=True),
        )  # fmt: skip

    def twofold(maker: Maker, shape: Tube) -> dict:
        none = maker.accessor(np.zeros_like(shape.shares))
        weights = maker.accessor(shape.shares, normalized=True)
        return one(maker, shape, WEIGHTS_0=weights, JOINTS_1=none, WEIGHTS_1=none)

    def coloured(maker: Maker, shape: Tube) -> dict:
        primitive = one(maker, shape)
        primitive["attributes"]["COLOR_0"] = primitive["attributes"]["WEIGHTS_0"]
        return primitive

    def interleaved(maker: Maker, shape: Tube) -> dict:
        columns = maker.interleaved(POSITION=shape.positions, WEIGHTS_0=shape.shares, JOINTS_0=shape.joints)
        low, high = shape.positions.min(0).tolist(), shape.positions.max(0).tolist()
        maker.json["accessors"][columns["POSITION"]] |= {"min": low, "max": high}
        return one(maker, shape, **columns)

    add("plain", Tube(), one)
    add("u8 weights", Tube(), lambda m, s: one(m, s, WEIGHTS_0=m.accessor(s.shares, normalized=True)))
    add("interleaved", Tube(), interleaved)
    add("sparse weights", Tube(), lambda m, s: one(m, s, WEIGHTS_0=m.sparse(s.weights)))
    add("sparse over nothing", Tube(), lambda m, s: one(m, s, WEIGHTS_0=m.sparse(s.weights, base=False)))
    add("joints without a view", Tube(), lambda m, s: one(m, s, JOINTS_0=m.accessor(s.joints, bufferView=None)))
    add("shared by two primitives", Tube(), shared)
    add("aliased", Tube(), aliased)
    add("bounds", Tube(), bounded)
    add("u8 joints of 300", Tube(joint_count=300), narrow)
    add("mixed types", Tube(), mixed)
    add("one accessor in two roles", Tube(), twofold)
    add("weights as colours", Tube(), coloured)
    return made


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("slot_count", [4, 8])
def test_variants(slot_count: int, suffix: str, tmp_path: Path) -> None:
    pairs = []
    for name, maker in variants().items():
        source = maker.write(tmp_path / f"{name}{suffix}")
        target = tmp_path / f"{name} out{suffix}"
        rig = load(source, tmp_path)
        wanted = sculpted(rig, slot_count)
        report = export(source, target, *wanted, tmp_path)
        assert report["status"] == "ok", (name, report)
        again = load(target, tmp_path)
        assert not {"weights_normalised", "joints_merged"} & set(again.summary["notes"]), name
        check_rows(again, *wanted, report["largest_rounding"])
        check_only_weights_differ(source, target)
        pairs.append((source, target))
        grew = len(fresh(target).json["accessors"]) - len(fresh(source).json["accessors"])
        in_place = slot_count == 4 and name in ("plain", "u8 weights", "interleaved", "bounds", "mixed types",
                                                "shared by two primitives")  # fmt: skip
        assert (grew == 0) == (in_place or name == "mixed types"), (name, grew)
        if in_place and suffix == ".glb" and name != "bounds":
            check_only_weight_bytes_differ(source, target)
    check_valid(pairs)


def test_primitives_that_part(tmp_path: Path) -> None:
    """Two primitives on one vertex buffer whose new weights differ get accessors of their own."""
    source = variants()["shared by two primitives"].write(tmp_path / "in.glb")
    rig = load(source, tmp_path)
    joints, weights = rig.rows(4)
    half = len(joints) // 2
    joints, weights = joints.copy(), weights.copy()
    joints[half:], weights[half:] = EMPTY, 0
    joints[half:, 0], weights[half:, 0] = 2, 1
    report = export(source, tmp_path / "out.glb", joints, weights, tmp_path)
    assert report["status"] == "ok"
    check_rows(load(tmp_path / "out.glb", tmp_path), joints, weights, 0)
    check_valid([(source, tmp_path / "out.glb")])


def test_over_the_source(tmp_path: Path) -> None:
    """A file may be replaced by its own export, .bin and all, and exported again after that."""
    for external in (None, "tube.bin", "buffers/my tube.bin"):
        source = plain().write(tmp_path / "tube.gltf", external)
        rig = load(source, tmp_path)
        wanted = sculpted(rig, 4)
        names = sorted(path.name for path in tmp_path.rglob("*"))
        assert export(source, source, *wanted, tmp_path)["status"] == "ok"
        check_rows(load(source, tmp_path), *wanted, 0)
        left = set(path.name for path in tmp_path.rglob("*")) - {"joints.raw", "weights.raw"}
        assert sorted(left) == sorted(set(names) - {"joints.raw", "weights.raw"})


def test_external_buffers(tmp_path: Path) -> None:
    """A .bin gets the target's name and never that of the source's own."""
    source = plain().write(tmp_path / "tube.gltf", "b.bin")
    old = (tmp_path / "b.bin").read_bytes()
    wanted = sculpted(load(source, tmp_path), 4)
    for target, buffer in [("new.gltf", "new.bin"), ("b.gltf", "b-1.bin"), ("other/b.gltf", "b.bin")]:
        path = tmp_path / target
        path.parent.mkdir(exist_ok=True)
        assert export(source, path, *wanted, tmp_path)["status"] == "ok"
        assert fresh(path).json["buffers"][0]["uri"] == buffer
        assert (path.parent / buffer).read_bytes() != old
        check_rows(load(path, tmp_path), *wanted, 0)
        check_only_weights_differ(source, path)
    assert (tmp_path / "b.bin").read_bytes() == old


def test_images_go_along(tmp_path: Path) -> None:
    """Files beside the source stay reachable from another folder; others are not overwritten."""
    maker = plain()
    maker.json["images"] = [{"uri": "maps/skin%20a.png"}, {"uri": "gone.png"}, {"uri": "data:image/png;base64,AAAA"}]
    source = maker.write(tmp_path / "tube.glb")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "skin a.png").write_bytes(b"not really an image")
    other = tmp_path / "other"
    other.mkdir()
    wanted = sculpted(load(source, tmp_path), 4)
    for _ in range(2):
        assert export(source, other / "tube.glb", *wanted, tmp_path)["status"] == "ok"
        assert (other / "maps" / "skin a.png").read_bytes() == b"not really an image"
    (other / "maps" / "skin a.png").write_bytes(b"somebody else's")
    before = (other / "tube.glb").read_bytes()
    answer = export(source, other / "tube.glb", *sculpted(load(source, tmp_path), 4, seed=8), tmp_path)
    assert answer["status"] == "file_io" and "skin a.png" in answer["text"]
    assert (other / "tube.glb").read_bytes() == before
    maker.json["images"] = [{"uri": "../secret.png"}]
    answer = export(maker.write(tmp_path / "tube.glb"), other / "tube.glb", *wanted, tmp_path)
    assert answer["status"] == "unsupported" and "secret.png" in answer["text"]


def test_refusals(tmp_path: Path) -> None:
    source = plain().write(tmp_path / "tube.glb")
    rig = load(source, tmp_path)
    rows = rig.rows(4)
    answer = export(source, tmp_path / "tube.gltf", *rows, tmp_path)
    assert answer["status"] == "unsupported" and ".glb" in answer["text"]
    answer = export(source, tmp_path / "nowhere" / "tube.glb", *rows, tmp_path)
    assert answer["status"] == "file_io"
    negative = rows[1].copy()
    negative[3, :2] = [1.25, -0.25]
    answer = export(source, tmp_path / "out.glb", rows[0], negative, tmp_path)
    assert answer["status"] == "unsupported" and "negative" in answer["text"]
    assert not (tmp_path / "out.glb").exists()


def test_failure_leaves_the_old_file(tmp_path: Path) -> None:
    """A target that cannot be replaced: nothing else changes and no temporary file stays."""
    source = plain().write(tmp_path / "tube.gltf", "tube.bin")
    other = tmp_path / "other"
    (other / "tube.gltf").mkdir(parents=True)  # a folder is in the way
    (other / "tube.bin").write_bytes(b"old")
    answer = export(source, other / "tube.gltf", *sculpted(load(source, tmp_path), 4), tmp_path)
    assert answer["status"] == "file_io"
    assert sorted(path.name for path in other.iterdir()) == ["tube.bin", "tube.gltf"]
    assert (other / "tube.bin").read_bytes() == b"old"


def test_padding_and_unknown_chunks(tmp_path: Path) -> None:
    """Chunks that skind does not know are carried along when the file is put together anew."""
    data = bytearray(variants()["sparse weights"].glb())
    extra = (8).to_bytes(4, "little") + b"TEST" + b"8 bytes!"
    data += extra
    data[8:12] = len(data).to_bytes(4, "little")
    source = tmp_path / "in.glb"
    source.write_bytes(data)
    wanted = sculpted(load(source, tmp_path), 4)
    assert export(source, tmp_path / "out.glb", *wanted, tmp_path)["status"] == "ok"
    written = (tmp_path / "out.glb").read_bytes()
    assert written.endswith(extra)
    assert int.from_bytes(written[8:12], "little") == len(written)
    check_rows(load(tmp_path / "out.glb", tmp_path), *wanted, 0)


@pytest.mark.parametrize("external", [None, "tube.bin"])
def test_source_that_goes_away(external: str | None, tmp_path: Path) -> None:
    """Renamed, replaced or unlinked, the file that was loaded is still there to export from."""
    source = plain().write(tmp_path / "tube.gltf", external)
    wanted = sculpted(load(source, tmp_path), 4)
    for name in ("moved", "unlinked", "replaced"):
        plain().write(source, external)

        def change() -> None:
            for path in (source, *([tmp_path / external] if external else [])):
                if name == "moved":
                    path.rename(tmp_path / ("old " + path.name))
                else:
                    path.unlink()
                    if name == "replaced":
                        path.write_bytes(b"something else")

        report = export_after(source, tmp_path / "out.gltf", wanted, tmp_path, change)
        assert report["status"] == "ok", (name, report)
        check_rows(load(tmp_path / "out.gltf", tmp_path), *wanted, 0)


def test_source_that_is_written_to(tmp_path: Path) -> None:
    """A file that was changed in place is no longer the one that was loaded."""
    def flip(path: Path) -> None:
        with path.open("r+b") as file:
            file.seek(-1, 2)
            last = file.read(1)
            file.seek(-1, 2)
            file.write(bytes([last[0] ^ 1]))

    def grow(path: Path) -> None:
        with path.open("ab") as file:
            file.write(b" ")

    def cut(path: Path) -> None:
        os.truncate(path, path.stat().st_size - 1)

    for external in (None, "tube.bin"):
        for change in (flip, grow, cut):
            source = plain().write(tmp_path / "tube.gltf", external)
            wanted = sculpted(load(source, tmp_path), 4)
            victim = tmp_path / external if external else source
            answer = export_after(source, tmp_path / "out.gltf", wanted, tmp_path, lambda: change(victim))
            assert answer["status"] == "source_changed", (external, change.__name__, answer)
            assert victim.name in answer["text"]
            assert not (tmp_path / "out.gltf").exists()


def test_validator_agrees_on_sums(tmp_path: Path) -> None:
    """Rows that the validator takes stay as they are; those that it rejects are mended and said."""
    pairs, verdicts = [], []
    for count in (1, 2, 3, 4):
        for off in (1e-7, 1.8e-7, 3e-7, 4.8e-7, 5.4e-7, 7e-7, 7.8e-7, 1e-6):
            maker, shape = Maker(), Tube()
            shape.joints[:], shape.weights[:] = [1, 2, 3, 4], 0
            shape.joints[:, count:] = 0
            shape.weights[:, :count] = 1 / count
            shape.weights[:, 0] = 1 - (count - 1) * np.float64(np.float32(1 / count)) + off
            primitive = {"attributes": shape.attributes(maker), "indices": maker.accessor(shape.indices)}
            source = shape.build(maker, [primitive]).write(tmp_path / f"{count} {off}.glb")
            target = tmp_path / f"{count} {off} out.glb"
            rig = load(source, tmp_path)
            report = export(source, target, *rig.rows(4), tmp_path)
            is_kept = source.read_bytes() == target.read_bytes()
            assert is_kept == (report["accessors"] == 0) == ("weights_normalised" not in rig.summary["notes"])
            pairs += [str(source), str(target)]
            verdicts.append(is_kept)
    answers = run_node("rig_validate.mjs", pairs)
    assert [not answer for answer in answers[::2]] == verdicts
    assert not any(answers[1::2])
    assert True in verdicts and False in verdicts
