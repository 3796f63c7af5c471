"""The project's own character: as many vertices and bones as asked for, one closed skin, the same
bytes each time. Read back with a reader of this file's own."""

from __future__ import annotations

import json
import os
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from daemons import BIN

MIDDLE = 60_000 if os.environ.get("SKIND_QUICK") else 300_000
DTYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def generate(path: Path, vertices: int, bones: int | None = None) -> subprocess.CompletedProcess:
    options = ["--vertices", str(vertices)] + ([] if bones is None else ["--bones", str(bones)])
    return subprocess.run([BIN / "skinctl", "generate", *options, str(path)], text=True,
                          capture_output=True, timeout=300)


class Character:
    """A .glb whose accessors are all plain."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        assert data[:4] == b"glTF" and struct.unpack_from("<I", data, 8)[0] == len(data)
        size = struct.unpack_from("<I", data, 12)[0]
        self.document = json.loads(data[20:20 + size])
        self.blob = data[28 + size:]
        primitive = self.document["meshes"][0]["primitives"][0]
        self.positions = self.read(primitive["attributes"]["POSITION"])
        self.normals = self.read(primitive["attributes"]["NORMAL"])
        self.joints = self.read(primitive["attributes"]["JOINTS_0"])
        self.weights = self.read(primitive["attributes"]["WEIGHTS_0"])
        self.triangles = self.read(primitive["indices"]).reshape(-1, 3).astype(np.int64)
        self.skin = self.document["skins"][0]
        self.names = [self.document["nodes"][node]["name"] for node in self.skin["joints"]]

    def read(self, index: int) -> np.ndarray:
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        assert "byteStride" not in view or accessor["type"] != "SCALAR"
        width, dtype = WIDTHS[accessor["type"]], np.dtype(DTYPES[accessor["componentType"]])
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", width * dtype.itemsize)
        raw = np.frombuffer(self.blob, np.uint8, accessor["count"] * stride, start)
        return raw.reshape(-1, stride)[:, :width * dtype.itemsize].copy().view(dtype)


@pytest.mark.parametrize("vertices, bones", [(1000, 53), (1001, 20), (5000, 53), (5003, 100),
                                             (20_000, 250), (MIDDLE, 53)])
def test_the_skin_is_one_closed_surface_with_smooth_weights(folder, vertices, bones) -> None:
    path = folder / "body.glb"
    assert generate(path, vertices, bones).returncode == 0
    body = Character(path)
    assert len(body.positions) == vertices and len(body.skin["joints"]) == bones
    assert len(set(body.names)) == bones
    # Closed and wound alike: each directed edge once, and its reverse once; genus 0.
    edges = np.concatenate([body.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    forth = np.sort(edges[:, 0] * vertices + edges[:, 1])
    back = np.sort(edges[:, 1] * vertices + edges[:, 0])
    assert (np.diff(forth) > 0).all()
    np.testing.assert_array_equal(forth, back)
    assert vertices - len(edges) // 2 + len(body.triangles) == 2
    assert len(np.unique(body.positions, axis=0)) == vertices
    corners = body.positions[body.triangles].astype(np.float64)
    volume = np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert 0.04 < volume < 0.12  # cubic metres, and outside is out
    low, high = body.positions.min(0), body.positions.max(0)
    assert low[1] == pytest.approx(0, abs=0.02) and high[1] == pytest.approx(1.75, abs=0.1)
    # Weights as float32 sum to one within what the validator takes.
    assert (body.weights >= 0).all() and (body.joints < bones).all()
    np.testing.assert_allclose(body.weights.sum(1, dtype=np.float64), 1, atol=1e-7)
    assert np.abs(np.linalg.norm(body.normals, axis=1) - 1).max() < 1e-4
    rests = np.array([body.document["nodes"][node].get("rotation", [0, 0, 0, 1])
                      for node in body.skin["joints"]])
    np.testing.assert_allclose(np.linalg.norm(rests, axis=1), 1, atol=1e-6)


def test_weights_do_not_bleed_between_limbs(folder) -> None:
    path = folder / "body.glb"
    assert generate(path, 20_000).returncode == 0
    body = Character(path)
    side = np.array([name[-1] if name.endswith((".L", ".R")) else "" for name in body.names])
    used = np.where(body.weights > 0, side[body.joints], "")
    left, right = (used == "L").any(1), (used == "R").any(1)
    # Left is +x; only the middle of the body may hang on both sides.
    assert (body.positions[left & ~right, 0] > -0.12).all()
    assert (np.abs(body.positions[left & right, 0]) < 0.12).all()
    fingers = np.array(["thumb", "index", "middle", "ring", "pinky"])
    finger = np.array([next((i for i, part in enumerate(fingers) if part in name), -1)
                       for name in body.names])
    tips = np.array(["03" in name or "3" in name for name in body.names]) & (finger >= 0)
    assert tips.any()
    for row, weight in zip(body.joints, body.weights):
        held = set(finger[row[weight > 0]]) - {-1}
        if tips[row[weight.argmax()]]:
            assert len(held) == 1


@pytest.mark.parametrize("bones", [20, 53, 250])
def test_the_clips_bend_every_joint(folder, bones) -> None:
    path = folder / "body.glb"
    assert generate(path, 2000, bones).returncode == 0
    body = Character(path)
    clips = {clip["name"]: clip for clip in body.document["animations"]}
    assert {"walk", "bend", "reach", "range_of_motion"} <= set(clips)
    largest = dict.fromkeys(body.skin["joints"], 0.0)
    for clip in clips.values():
        for channel in clip["channels"]:
            if channel["target"]["path"] != "rotation":
                continue
            keys = body.read(clip["samplers"][channel["sampler"]]["output"]).astype(np.float64)
            np.testing.assert_allclose(np.linalg.norm(keys, axis=1), 1, atol=1e-5)
            turn = 2 * np.degrees(np.arccos(np.clip(np.abs(keys @ keys[0]), 0, 1)))
            node = channel["target"]["node"]
            largest[node] = max(largest[node], turn.max())
    bent = np.array([largest[node] for node in body.skin["joints"]])
    assert (bent > 24.9).all(), dict(zip(body.names, bent.round()))
    for channel in clips["walk"]["channels"]:
        keys = body.read(clips["walk"]["samplers"][channel["sampler"]]["output"])
        np.testing.assert_array_equal(keys[0], keys[-1])  # a cycle


def test_the_same_bytes_for_the_same_arguments(folder) -> None:
    for name in ("a", "b"):
        assert generate(folder / f"{name}.glb", 7777, 60).returncode == 0
    assert (folder / "a.glb").read_bytes() == (folder / "b.glb").read_bytes()


@pytest.mark.parametrize("vertices, bones", [(999, 53), (5_000_001, 53), (1000, 19), (1000, 251)])
def test_limits_are_refused_with_the_range(folder, vertices, bones) -> None:
    done = generate(folder / "body.glb", vertices, bones)
    assert done.returncode != 0 and not (folder / "body.glb").exists()
    assert "to" in done.stderr and done.stderr.count("\n") == 1


def test_a_folder_that_is_not_there(folder) -> None:
    done = generate(folder / "nowhere" / "body.glb", 1000)
    assert done.returncode == 1 and "nowhere" in done.stderr
    assert list(folder.iterdir()) == []


def test_the_daemon_takes_it_without_mending(daemon, folder) -> None:
    assert generate(folder / "body.glb", 5000).returncode == 0
    with daemon.link() as link:
        made = link.call("session.create", {"file": str(folder / "body.glb")})
        assert made["notes"] == [] and made["vertices"] == 5000 and made["clips"] == 4
