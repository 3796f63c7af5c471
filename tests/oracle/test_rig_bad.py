"""Files that are wrong: each is refused with its status and one sentence, and none does harm."""

import json
import os
import struct
from pathlib import Path
from typing import Callable

import numpy as np
import pytest
from rig_lib import QUICK, check, load
from rig_make import Maker, Tube, plain


def one(document: dict, kind: str) -> dict:
    """The accessor of an attribute of the one primitive."""
    primitive = document["meshes"][0]["primitives"][0]
    index = primitive["indices"] if kind == "indices" else primitive["attributes"][kind]
    return document["accessors"][index]


def view_of(document: dict, kind: str) -> dict:
    return document["bufferViews"][one(document, kind)["bufferView"]]


def animate(document: dict, maker: Maker, times: list[float], count: int, **channel: object) -> None:
    values = np.tile(np.array([0, 0, 0, 1], "<f4"), (count, 1))
    sampler = {"input": maker.accessor(np.array(times, "<f4")), "output": maker.accessor(values)}
    target = {"node": channel.pop("node", 1), "path": "rotation"}
    document["animations"] = [{"samplers": [sampler], "channels": [{"sampler": 0, "target": target} | channel]}]


# Name: (status, words of the sentence, what to do to the document of a plain tube).
Change = Callable[[dict, Maker], object]
WRONG: dict[str, tuple[str, str, Change]] = {
    "view beyond the buffer": ("bad_rig", "beyond", lambda d, m: view_of(d, "POSITION").update(byteLength=1 << 40)),
    "view far beyond": ("bad_rig", "beyond", lambda d, m: view_of(d, "POSITION").update(byteOffset=(1 << 63) - 1)),
    "view wraps around": ("bad_rig", "beyond", lambda d, m: view_of(d, "POSITION").update(byteOffset=(1 << 64) - 8)),
    "accessor offset wraps": ("bad_rig", "beyond", lambda d, m: one(d, "POSITION").update(byteOffset=(1 << 64) - 4)),
    "one element too many": ("bad_rig", "elements|beyond", lambda d, m: one(d, "WEIGHTS_0").update(count=31)),
    "too many everywhere": ("bad_rig", "beyond", lambda d, m: [
        one(d, k).update(count=31) for k in ("POSITION", "JOINTS_0", "WEIGHTS_0")]),
    "count near 2^64": ("too_large", "vertices", lambda d, m: one(d, "POSITION").update(count=(1 << 64) - 1)),
    "2^31 indices": ("too_large", "triangles", lambda d, m: one(d, "indices").update(count=1 << 31)),
    "vertices out of nothing": ("too_large", "vertices", lambda d, m: (
        one(d, "POSITION").update(count=1 << 40), one(d, "POSITION").pop("bufferView"))),
    "indices that are negative": ("bad_rig|not_gltf", "", lambda d, m: one(d, "indices").update(count=-3)),
    "stride shorter than an element": ("bad_rig", "beyond", lambda d, m: view_of(d, "WEIGHTS_0").update(byteStride=12)),
    "stride of 256": ("not_gltf", "byteStride", lambda d, m: view_of(d, "WEIGHTS_0").update(byteStride=256)),
    "view that is not there": ("bad_rig", "buffer view", lambda d, m: one(d, "WEIGHTS_0").update(bufferView=99)),
    "view -2": ("bad_rig", "buffer view", lambda d, m: one(d, "WEIGHTS_0").update(bufferView=-2)),
    "buffer that is not there": ("bad_rig", "buffer 7", lambda d, m: view_of(d, "WEIGHTS_0").update(buffer=7)),
    "accessor that is not there": ("bad_rig|unsupported", "", lambda d, m: (
        d["meshes"][0]["primitives"][0]["attributes"].update(POSITION=99))),
    "weights of another length": ("bad_rig", "30 vertices", lambda d, m: one(d, "WEIGHTS_0").update(count=29)),
    "joints as floats": ("bad_rig", "JOINTS", lambda d, m: (
        d["meshes"][0]["primitives"][0]["attributes"].update(
            JOINTS_0=d["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]))),
    "weights as vec3": ("bad_rig", "type", lambda d, m: one(d, "WEIGHTS_0").update(type="VEC3")),
    "weights without joints": ("bad_rig", "pairs", lambda d, m: (
        d["meshes"][0]["primitives"][0]["attributes"].pop("JOINTS_0"))),
    "seventeen sets": ("too_large", "64", lambda d, m: d["meshes"][0]["primitives"][0]["attributes"].update(
        {f"{kind}_{n}": d["meshes"][0]["primitives"][0]["attributes"][f"{kind}_0"]
         for kind in ("JOINTS", "WEIGHTS") for n in range(17)})),
    "index beyond the vertices": ("bad_rig", "name vertex", lambda d, m: one(d, "indices").update(
        bufferView=m.view(np.full(len(Tube().indices), 30, "<u2").tobytes()))),
    "positions that are not finite": ("bad_rig", "finite", lambda d, m: one(d, "POSITION").update(
        bufferView=m.view(np.full((30, 3), np.nan, "<f4").tobytes()))),
    "binds that are not finite": ("bad_rig", "finite", lambda d, m: (
        d["accessors"][d["skins"][0]["inverseBindMatrices"]].update(
            bufferView=m.view(np.full((8, 16), np.inf, "<f4").tobytes())))),
    "too few binds": ("bad_rig", "8 joints", lambda d, m: (
        d["accessors"][d["skins"][0]["inverseBindMatrices"]].update(count=7))),
    "sparse index beyond": ("bad_rig", "sparse index", lambda d, m: one(d, "WEIGHTS_0").update(sparse={
        "count": 1, "indices": {"bufferView": m.view(b"\x1e\0\0\0"), "componentType": 5125},
        "values": {"bufferView": m.view(bytes(16))}})),
    "sparse count below 0": ("bad_rig", "sparse", lambda d, m: one(d, "WEIGHTS_0").update(sparse={
        "count": -1, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}})),
    "joint that is no node": ("bad_rig", "joint 0", lambda d, m: d["skins"][0]["joints"].__setitem__(0, 99)),
    "no joints": ("bad_rig", "no joints", lambda d, m: d["skins"][0].update(joints=[])),
    "5000 joints": ("too_large", "4096", lambda d, m: d["skins"][0].update(joints=[0] * 5000)),
    "skin that is not there": ("bad_rig", "skin 3", lambda d, m: d["nodes"][-1].update(skin=3)),
    "mesh that is not there": ("bad_rig", "mesh 3", lambda d, m: d["nodes"][-1].update(mesh=3)),
    "node cycle": ("bad_rig", "ancestors", lambda d, m: d["nodes"][7].update(children=[0])),
    "two parents": ("bad_rig", "two nodes", lambda d, m: d["nodes"][-1].update(children=[3])),
    "child that is not there": ("bad_rig", "child", lambda d, m: d["nodes"][-1].update(children=[-1])),
    "rotation of three": ("bad_rig", "node 2", lambda d, m: d["nodes"][2].update(rotation=[0, 0, 1])),
    "transforms without end": ("bad_rig", "grow", lambda d, m: [
        n.update(scale=[1e100] * 3) for n in d["nodes"]]),
    "keys of other length": ("bad_rig", "do not fit", lambda d, m: animate(d, m, [0, 1], 3)),
    "no keys": ("bad_rig", "do not fit", lambda d, m: (
        animate(d, m, [0], 1), [a.update(count=0) for a in d["accessors"][-2:]])),
    "times that fall": ("bad_rig", "rise", lambda d, m: animate(d, m, [1, 0], 2)),
    "times that are not finite": ("bad_rig", "rise", lambda d, m: animate(d, m, [0, np.nan], 2)),
    "sampler that is not there": ("bad_rig", "sampler 5", lambda d, m: animate(d, m, [0, 1], 2, sampler=5)),
    "animated node that is not there": ("bad_rig", "node 77", lambda d, m: animate(d, m, [0, 1], 2, node=77)),
    "no skin": ("unsupported", "skin", lambda d, m: d.pop("skins")),
    "no skinned mesh": ("unsupported", "skinned", lambda d, m: d["nodes"][-1].pop("skin")),
    "glTF 1.0": ("unsupported", "2.0", lambda d, m: d["asset"].update(version="1.0")),
    "no version": ("not_gltf", "version", lambda d, m: d["asset"].clear()),
    "a number too large": ("not_gltf", "", lambda d, m: d["nodes"][0].update(translation=[float("1e308"), "x", 0])),
    "primitive without attributes": ("bad_rig", "attributes", lambda d, m: (
        d["meshes"][0]["primitives"].append({"mode": 4}))),
    "draco": ("unsupported", "Draco", lambda d, m: d.update(extensionsUsed=["KHR_draco_mesh_compression"])),
}  # fmt: skip


def sentence_is_clear(text: str) -> bool:
    return 15 < len(text) < 400 and "\n" not in text


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_wrong_documents(suffix: str, tmp_path: Path) -> None:
    paths = []
    for index, (_, _, change) in enumerate(WRONG.values()):
        maker = plain()
        change(maker.json, maker)
        paths.append(maker.write(tmp_path / f"{index}{suffix}"))
    for (name, (status, words, _)), answer in zip(WRONG.items(), check(paths)):
        if name in ("a number too large",):
            continue  # tinygltf takes a number that is none for one that is missing
        assert answer["status"] in status.split("|"), (name, answer)
        assert any(word in answer["text"] for word in words.split("|")), (name, answer)
        assert sentence_is_clear(answer["text"]), (name, answer)


def containers() -> dict[str, tuple[str, bytes]]:
    """Files that are wrong as a whole."""
    good = plain().glb()
    (size,) = struct.unpack_from("<I", good, 12)
    text = good[20 : 20 + size]

    def with_u32(offset: int, value: int) -> bytes:
        return good[:offset] + struct.pack("<I", value) + good[offset + 4 :]

    deep = b'{"asset":{"version":"2.0"},"extras":' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    return {
        "empty.glb": ("not_gltf", b""),
        "four bytes.glb": ("not_gltf", b"glTF"),
        "text.gltf": ("not_gltf", b"hello"),
        "array.gltf": ("not_gltf", b"[]"),
        "half.gltf": ("not_gltf", text[: size // 2]),
        "deep.gltf": ("not_gltf", deep),
        "deep skin.gltf": ("not_gltf", b'{"asset":{"version":"2.0"},"skins":' + b"[" * 5000),
        "infinite.gltf": ("not_gltf", b'{"asset":{"version":"2.0"},"nodes":[{"scale":[1e999,1,1]}]}'),
        "control.gltf": ("not_gltf", b'{"asset":{"version":"2.0\x01"}}'),
        "bad utf-8.gltf": ("not_gltf", b'{"asset":{"version":"2.0"},"nodes":[{"name":"\xff\xfe"}]}'),
        "version 1.glb": ("not_gltf", with_u32(4, 1)),
        "longer than it is.glb": ("not_gltf", with_u32(8, len(good) + 4)),
        "json longer.glb": ("not_gltf", with_u32(12, len(good))),
        "json huge.glb": ("not_gltf", with_u32(12, 0xFFFFFFFF)),
        "json of another kind.glb": ("not_gltf", with_u32(16, 0x12345678)),
        "bin longer.glb": ("not_gltf", with_u32(20 + size, 0xFFFFFFF0)),
        "bin of another kind.glb": ("not_gltf", with_u32(24 + size, 0x12345678)),
        "short header.glb": ("not_gltf", with_u32(8, 16)),
    }


def test_wrong_containers(tmp_path: Path) -> None:
    cases = containers()
    for name, (_, content) in cases.items():
        (tmp_path / name).write_bytes(content)
    for (name, (status, _)), answer in zip(cases.items(), check([tmp_path / name for name in cases])):
        assert answer["status"] == status, (name, answer)
        assert sentence_is_clear(answer["text"]), (name, answer)


def test_wrong_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.glb")
    (tmp_path / "folder.glb").mkdir()
    (tmp_path / "outside.bin").write_bytes(bytes(100_000))
    (tmp_path / "in").mkdir()
    cases = {}
    uris = {
        "../outside.bin": "unsupported", "%2e%2e/outside.bin": "unsupported", "a/../../outside.bin": "unsupported",
        "/etc/passwd": "unsupported", "http://example.org/a.bin": "unsupported", "file:///etc/passwd": "unsupported",
        "missing.bin": "no_file", "a%00b.bin": "unsupported", "": "unsupported",
        "data:application/octet-stream,abc": "unsupported", "data:;base64,####": "not_gltf",
        "data:;base64,AAAA": "bad_rig",
    }  # fmt: skip
    for index, (uri, status) in enumerate(uris.items()):
        document = json.loads(plain().write(tmp_path / "in" / "tube.gltf").read_text())
        document["buffers"][0]["uri"] = uri
        path = tmp_path / "in" / f"{index}.gltf"
        path.write_text(json.dumps(document))
        cases[path] = status
    many = json.loads(plain().write(tmp_path / "in" / "tube.gltf").read_text())
    many["buffers"] *= 65
    (tmp_path / "in" / "many.gltf").write_text(json.dumps(many))
    cases |= {
        tmp_path / "pipe.glb": "not_gltf", tmp_path / "folder.glb": "not_gltf",
        tmp_path / "gone.glb": "no_file", tmp_path / "no" / "folder.glb": "no_file",
        tmp_path / "in" / "many.gltf": "too_large",
    }  # fmt: skip
    for (path, status), answer in zip(cases.items(), check(list(cases))):
        assert answer["status"] == status, (path.name, answer)
        assert sentence_is_clear(answer["text"]), (path.name, answer)


def test_every_truncation(tmp_path: Path) -> None:
    """A .glb that is cut anywhere is refused."""
    good = plain().glb()
    paths = []
    for length in range(0, len(good), 211 if QUICK else 23):
        paths.append(tmp_path / f"{length}.glb")
        paths[-1].write_bytes(good[:length])
    for path, answer in zip(paths, check(paths)):
        assert answer["status"] == "not_gltf", (path.name, answer)


@pytest.mark.parametrize("seed", range(2 if QUICK else 8))
def test_random_damage(seed: int, tmp_path: Path) -> None:
    """Whatever is changed, the file loads or is refused; a crash would fail the probe."""
    rng = np.random.default_rng(seed)
    maker = plain()
    animate(maker.json, maker, [0, 0.5, 1], 3)
    paths = []
    for index in range(150):
        suffix = (".glb", ".gltf")[index % 2]
        path = maker.write(tmp_path / f"{index}{suffix}")
        data = bytearray(path.read_bytes())
        (size,) = struct.unpack_from("<I", data, 12)
        end = 20 + size if suffix == ".glb" and index % 4 == 0 else len(data)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(12, end))
            if rng.random() < 0.5 and chr(data[at]).isdigit():
                data[at] = ord(rng.choice(list("0123456789-e")))
            else:
                data[at] = int(rng.integers(0, 256))
        path.write_bytes(data)
        paths.append(path)
    answers = check(paths)
    assert all(answer["status"] != "other" for answer in answers), answers
    assert all(answer["status"] == "ok" or sentence_is_clear(answer["text"]) for answer in answers)


def test_topologies(tmp_path: Path) -> None:
    """Strips, fans, unindexed and quantised primitives, and modes without triangles."""
    shape = Tube()
    strip = np.array([0, 1, 6, 7, 12, 13], "<u1")
    expected = {(0, 1, 6), (1, 6, 7), (6, 7, 12), (7, 12, 13)}
    cases = {
        "strip": ({"mode": 5, "indices": strip}, expected),
        "fan": ({"mode": 6, "indices": np.array([0, 1, 2, 3], "<u4")}, {(0, 1, 2), (0, 2, 3)}),
        "unindexed": ({}, {(i, i + 1, i + 2) for i in range(0, 30, 3)}),
        "strip unindexed": ({"mode": 5}, {(i, i + 1, i + 2) for i in range(28)}),
        "points": ({"mode": 0}, set()),
        "lines": ({"mode": 1, "indices": strip}, set()),
        "degenerate": ({"indices": np.array([0, 1, 1, 2, 3, 4], "<u2")}, {(2, 3, 4)}),
        "one corner too many": ({"indices": np.array([0, 1, 2, 3], "<u2")}, {(0, 1, 2)}),
    }
    for name, (extra, triangles) in cases.items():
        maker = Maker()
        primitive = {"attributes": shape.attributes(maker)} | extra
        if "indices" in extra:
            primitive["indices"] = maker.accessor(extra["indices"])
        rig = load(shape.build(maker, [primitive]).write(tmp_path / "t.glb"), tmp_path)
        found = [tuple(sorted(map(int, triangle))) for triangle in rig.arrays["triangles"]]
        assert sorted(found) == sorted(triangles), name
        assert rig.summary["notes"].get("triangles_dropped", 0) == (name == "degenerate"), name


@pytest.mark.parametrize("dtype", ["i1", "u1", "<i2", "<u2"])
@pytest.mark.parametrize("normalized", [False, True])
def test_quantised_positions(dtype: str, normalized: bool, tmp_path: Path) -> None:
    maker, shape = Maker(), Tube()
    stored = np.clip(shape.positions * 20 + 21, 0, 120).round().astype(dtype)
    position = maker.accessor(np.c_[stored, np.zeros(30, dtype)], type="VEC3", normalized=normalized,
                              bufferView=maker.view(np.c_[stored, stored[:, :1]].tobytes(), byteStride=4 * stored.itemsize))  # fmt: skip
    primitive = {"attributes": shape.attributes(maker, POSITION=position), "indices": maker.accessor(shape.indices)}
    rig = load(shape.build(maker, [primitive]).write(tmp_path / "q.glb"), tmp_path)
    scale = np.iinfo(dtype).max if normalized else 1
    assert np.allclose(rig.arrays["rest"], stored / scale, rtol=1e-6, atol=0)


def test_names(tmp_path: Path) -> None:
    """Names are there, unique and of a bearable length."""
    maker = plain()
    nodes = maker.json["nodes"]
    nodes[0].pop("name")
    nodes[1]["name"] = nodes[2]["name"] = "arm"
    nodes[3]["name"] = "ü" * 300
    animate(maker.json, maker, [0, 1], 2)
    maker.json["animations"] *= 3
    rig = load(maker.write(tmp_path / "n.glb"), tmp_path)
    bones = rig.summary["bones"]
    assert bones[:3] == ["joint0", "arm", "arm_2"]
    assert bones[3] == "ü" * 128
    assert [clip["name"] for clip in rig.summary["clips"]] == ["clip0", "clip1", "clip2"]


def test_duplicate_joints(tmp_path: Path) -> None:
    """A joint that stands twice with one bind matrix is one bone; its weights are added up."""
    maker, shape = Maker(), Tube()
    shape.joints[:] = [1, 2, 3, 0]
    primitive = {"attributes": shape.attributes(maker), "indices": maker.accessor(shape.indices)}
    shape.build(maker, [primitive])
    skin = maker.json["skins"][0]
    binds = maker.json["accessors"][skin["inverseBindMatrices"]]
    whole = np.tile(np.eye(4, dtype="<f4"), (8, 1, 1)).reshape(8, 16)
    binds["bufferView"] = maker.view(whole.tobytes())
    skin["joints"] = [0, 1, 1, 3, 4, 5, 6, 7]
    rig = load(maker.write(tmp_path / "d.glb"), tmp_path)
    assert rig.summary["notes"] == {"joints_duplicate": 1, "joints_merged": 30}
    assert len(rig.summary["bones"]) == 7
    rows = np.split(rig.arrays["joints"], rig.arrays["offsets"][1:-1])
    assert all(sorted(row) == [0, 1, 2] for row in rows)  # joint 3 is bone 2
