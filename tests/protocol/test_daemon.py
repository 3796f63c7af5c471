"""Every message there is, to and from the real daemon, in frames and in lines, held against its
schema. A message that this does not send or get fails it."""

from __future__ import annotations

import base64
import json
import os
import re
import resource
import time
from pathlib import Path

import numpy as np
import pytest
import schemas
from core import Link, SkindError

IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
ROWS = 4  # of two vertices each, along y; the lower half hangs on bone 0


def rest_positions() -> np.ndarray:
    return np.array([[x, y, 0] for y in range(ROWS) for x in (0, 1)], np.float32)


def write_ribbon(path: Path) -> None:
    """A glTF file: a ribbon, two bones, and a clip that bends it."""
    half = np.sqrt(0.5)
    accessors, views, data = [], [], b""

    def add(array: np.ndarray, kind: str, component: int, **more) -> int:
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": component,
                          "count": len(array), "type": kind, **more})
        data += array.tobytes() + bytes(-array.nbytes % 4)
        return len(accessors) - 1

    rest = rest_positions()
    joints = np.zeros((len(rest), 4), np.uint16)
    joints[len(rest) // 2:, 0] = 1
    weights = np.zeros((len(rest), 4), np.float32)
    weights[:, 0] = 1
    corners = [[2 * r + a, 2 * r + b, 2 * r + c] for r in range(ROWS - 1)
               for a, b, c in ((0, 1, 2), (2, 1, 3))]
    binds = np.tile(np.eye(4, dtype=np.float32).reshape(16), (2, 1))
    binds[1, 13] = -1.5  # column by column: bone 1 stands at y = 1.5
    attributes = {
        "POSITION": add(rest, "VEC3", 5126, min=rest.min(0).tolist(), max=rest.max(0).tolist()),
        "JOINTS_0": add(joints, "VEC4", 5123), "WEIGHTS_0": add(weights, "VEC4", 5126)}
    primitive = {"attributes": attributes,
                 "indices": add(np.array(corners, np.uint16).reshape(-1), "SCALAR", 5123)}
    sampler = {"input": add(np.array([0, 1], np.float32), "SCALAR", 5126, min=[0], max=[1]),
               "output": add(np.array([[0, 0, 0, 1], [0, 0, half, half]], np.float32), "VEC4", 5126)}
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "skin": 0}, {"name": "lower", "children": [2]},
                  {"name": "upper", "translation": [0, 1.5, 0]}],
        "meshes": [{"name": "ribbon", "primitives": [primitive]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": add(binds, "MAT4", 5126)}],
        "animations": [{"name": "bend", "samplers": [sampler], "channels": [
            {"sampler": 0, "target": {"node": 2, "path": "rotation"}}]}],
        "accessors": accessors, "bufferViews": views,
    }
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document["buffers"] = [{"byteLength": len(data), "uri": uri}]
    path.write_text(json.dumps(document))


def rig_arrays() -> dict:
    count = 2 * ROWS
    return {
        "positions": rest_positions(),
        "triangles": np.array([[0, 1, 2], [2, 1, 3]], np.uint32),
        "bones": {"names": ["lower", "upper"], "parents": np.array([-1, 0], np.int32),
                  "binds": np.array([IDENTITY, IDENTITY], np.float64)},
        "influence_offsets": np.arange(count + 1, dtype=np.uint32),
        "influence_joints": np.zeros(count, np.uint16),
        "influence_weights": np.ones(count, np.float32),
    }


def f32(values) -> np.ndarray:
    return np.asarray(values, np.float32)


def sculpt_two_poses(artist: Link) -> list[str]:
    """Pins, guards, shapes, refit, edits. Returns the causes of what changed."""
    def call(method, arrays=None, **params):
        return artist.call(method, {"session": "r", **params}, arrays or {})

    vertices = np.arange(2, 6, dtype=np.uint32)
    assert call("pins.list")["pins"] == []  # weights.set took them away
    shown = f32(call("pose.evaluate", {"vertices": vertices}, pose="bent")["positions"])
    call("stroke.apply", {"vertices": vertices, "positions": shown + np.float32(0.05)}, pose="bent")
    (pins,) = call("pins.list")["pins"]
    assert pins == {"pose": "bent", "vertices": 4, "weight": 1, "current": True}
    pinned = call("pins.get", pose="bent")
    assert list(pinned["vertices"]) == [2, 3, 4, 5] and set(pinned["weights"]) == {1}
    call("pose.set", pose="less", clip="bend", time=0.25)
    guarded = call("guard.set", clips=["bend"], poses=["less"], count=2)
    assert len(guarded["poses"]) == 2 and guarded == call("guard.get")
    shown = f32(call("pose.evaluate", {"vertices": vertices}, pose="less")["positions"])
    stroke = call("stroke.apply", {"vertices": vertices, "positions": shown + np.float32(0.05),
                                   "mask": f32([1, 1, 1, 0.5])},
                  pose="less", pin="move", slots="evidence", guard=0.1, smooth=0.1, mix=0.5,
                  residual="rest", stiffness=0.001)
    assert stroke["stiffness"] == pytest.approx(0.001) and stroke["poses"] == 2
    assert stroke["rest_moved"] == 4 and len(stroke["residuals"]) == 4
    assert not np.array_equal(call("mesh.get")["rest"], rest_positions())
    stroke = call("stroke.apply", {"vertices": vertices, "positions": shown + np.float32(0.1)},
                  pose="less", residual="shape", pin="none")
    assert stroke["shaped"] == 4
    assert max(stroke["residuals"]) < 1e-5  # the shape takes what weights cannot reach
    shapes = call("shapes.list")
    assert shapes["shapes"] == [{"pose": "less", "vertices": 4, "current": True}]
    assert shapes["rest_moved"] == 4
    assert np.asarray(call("shapes.get", pose="less")["offsets"]).shape == (4, 3)
    assert call("pins.weigh", {"vertices": vertices[:1]}, pose="bent", weight=2)["undo_steps"] == 6
    assert set(call("pins.get", pose="bent")["weights"]) == {1, 2}
    assert len(call("pins.solve", pose="bent", stream=False)["residuals"]) == 4
    call("pins.clear", pose="less")
    assert [pins["pose"] for pins in call("pins.list")["pins"]] == ["bent"]
    mirrored = call("weights.mirror", axis="x", origin=0.5, **{"from": "-"})
    assert mirrored["unmatched"] == 0
    assert mirrored["unpaired_bones"] == ["lower", "upper"]  # they stand beside the plane
    pruned = call("weights.prune", {"vertices": vertices[:2]}, below=0.5)
    assert pruned["removed"] == 2 and pruned["vertices"] == 2
    assert call("weights.reduce", influences=1, by="size")["vertices"] == 2
    assert np.asarray(call("weights.get")["weights"]).max(axis=1) == pytest.approx(1)
    posed = [f32(call("pose.evaluate", pose=pose)["positions"]) for pose in ("bent", "less")]
    refit = call("session.refit", {"positions": np.concatenate(posed)}, poses=["bent", "less"],
                 rounds=1)
    assert refit["vertices"] == 2 * ROWS and refit["poses"] == 2
    return ["stroke", "stroke", "stroke", "pins", "stroke", "pins", "mirror", "prune", "reduce",
            "refit"]


def wait_for(link: Link, method: str) -> None:
    deadline = time.monotonic() + 20
    while not any(message.method == method for message in link.notifications):
        assert time.monotonic() < deadline, method
        link.pump(0.05)


def keep_and_share(artist: Link, watcher: Link, folder: Path) -> None:
    """Files of sessions, claims, a repeated request, a disk that is full for a while."""
    def call(method, arrays=None, session="k", **params):
        return artist.call(method, {"session": session, **params}, arrays or {})

    artist.call("session.create", {"name": "k", "fill": "none", "durability": "second",
                                   "history_bytes": 1 << 20}, rig_arrays())
    for link in (artist, watcher):
        link.call("session.attach", {"session": "k"})
    claimed = call("session.claim", {"vertices": np.array([1, 2], np.uint32)}, bones=["upper"])
    assert claimed == {"session": "k", "vertices": 2}
    wait_for(watcher, "session.claims")
    assert call("session.set", durability="full")["durability"] == "full"
    rows = {"vertices": np.array([1], np.uint32), "weights": f32([[1, 0, 0, 0]])}
    first = call("weights.set", rows, sequence=1)
    assert call("weights.set", rows, sequence=1) == {**first, "repeated": True}
    assert call("history.undo", own=True, sequence=2)["undo_steps"] == 0
    pid = artist.hello["server"]["pid"]
    limits = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (4096, limits[1]))
    call("weights.set", rows)
    wait_for(watcher, "journal.suspended")
    resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)
    wait_for(watcher, "journal.resumed")
    assert call("session.verify")["ok"]
    path = str(folder / "k.skind")
    assert call("session.save", path=path)["revision"] == 3
    assert artist.call("session.verify", {"path": path})["ok"]
    assert artist.call("session.open", {"path": path, "name": "opened"})["revision"] == 3
    assert call("session.fork", name="fork")["undo_steps"] == 1
    call("session.delete", session="fork")
    call("session.close", session="opened")
    assert artist.call("session.open", {"closed": "opened"})["session"] == "opened"
    for name in ("opened", "k"):
        call("session.delete", session=name)
    watcher.call("ping")
    watcher.notifications.clear()
    artist.notifications.clear()


def use_everything(path: Path, folder: Path, lines: bool) -> None:
    """One session through its whole life; each method at least once."""
    def connect(name):
        return Link.connect(path, name=name, lines=lines, timeout=30, watch=schemas.watch())

    with connect("artist") as artist, connect("watcher") as watcher:
        created = artist.call("session.create", {"file": str(folder / "ribbon.gltf"), "name": "r"})
        assert created["vertices"] == 2 * ROWS
        assert [s["session"] for s in artist.call("session.list")["sessions"]] == ["r"]
        keep_and_share(artist, watcher, folder)
        assert watcher.call("session.attach", {"session": "r", "revision": 0})["resync"] is False
        mesh = artist.call("mesh.get", {"session": "r"})
        assert np.array_equal(np.asarray(mesh["positions"], np.float32), rest_positions())
        assert np.array_equal(mesh["inverse_binds"],
                              [np.eye(4).ravel(), [1, 0, 0, 0, 0, 1, 0, -1.5, *IDENTITY[2],
                                                   *IDENTITY[3]]])
        artist.call("pose.set", {"session": "r", "pose": "bent", "clip": "bend", "time": 0.5})
        artist.call("pose.set", {"session": "r", "pose": "flat"},
                    {"matrices": np.array([IDENTITY, IDENTITY], np.float64)})
        vertices = np.arange(2, 6, dtype=np.uint32)
        posed = artist.call("pose.evaluate", {"session": "r", "pose": "bent"},
                            {"vertices": vertices})["positions"]
        stroke = artist.call("stroke.apply", {"session": "r", "pose": "bent"}, {
            "vertices": vertices,
            "positions": np.asarray(posed, np.float32) + np.float32(0.05)})
        assert stroke["revision"] == 1 and stroke["vertices"] == 4
        assert {message.method for message in artist.notifications} == {"stroke.weights"}
        weights = artist.call("weights.get", {"session": "r"})
        streamed = artist.notifications[0].params
        assert np.array_equal(np.asarray(weights["weights"])[np.asarray(streamed["vertices"])],
                              np.asarray(streamed["weights"]))
        assert artist.call("history.undo", {"session": "r"})["revision"] == 2
        assert artist.call("history.redo", {"session": "r"})["revision"] == 3
        rows = np.asarray(weights["weights"], np.float32)[vertices]
        wanted = artist.call("weights.set", {"session": "r"}, {"vertices": vertices,
                                                               "weights": rows})
        assert wanted == {"session": "r", "revision": 4, "vertices": 4, "undo_steps": 2,
                          "redo_steps": 0}
        causes = ["stroke", "undo", "redo", "set", *sculpt_two_poses(artist)]
        exported = artist.call("session.export", {"session": "r", "path": str(folder / "o.gltf")})
        assert exported["revision"] == len(causes)
        info = artist.call("session.info", {"session": "r"})
        assert set(info["poses"]) == {"rest", "bent", "flat", "less"}
        artist.call("session.create", {"name": "arrays", "fill": "none"}, rig_arrays())
        artist.call("session.close", {"session": "arrays"})
        artist.call("ping")
        artist.cancel(artist.send("stats"))
        with pytest.raises(SkindError) as refused:
            artist.call("weights.get", {"session": "nobody"})
        assert refused.value.name == "no_session"
        artist.call("session.delete", {"session": "r"})
        wait_for(watcher, "session.closed")
        told = [message for message in watcher.notifications
                if message.method != "session.presence"]
        assert [message.method for message in told] == (
            len(causes) * ["session.update"] + ["session.closed"])
        updates = [message.params for message in told[:-1]]
        assert [update["cause"] for update in updates] == causes
        assert [update["revision"] for update in updates] == list(range(1, len(causes) + 1))


def test_the_capabilities_are_the_documented_ones(daemon):
    text = (schemas.ROOT / "protocol" / "PROTOCOL.md").read_text("utf-8").split("| capability |")[1]
    documented = [name for line in text.splitlines()[2:] if line.startswith("| `")
                  for name in re.findall(r"`([a-z0-9._]+)`", line.split("|")[1])]
    with daemon.link() as link:
        assert sorted(link.hello["capabilities"]) == sorted(documented)


def test_every_message_is_what_its_schema_says(daemon, tmp_path):
    socket_path = daemon.socket
    write_ribbon(tmp_path / "ribbon.gltf")
    schemas.seen.clear()
    use_everything(socket_path, tmp_path, lines=False)
    use_everything(socket_path, tmp_path, lines=True)
    with Link.connect(socket_path, watch=schemas.watch()) as last:
        last.call("session.create", {"file": str(tmp_path / "ribbon.gltf"), "name": "r"})
        last.call("session.attach", {"session": "r"})
        last.call("session.detach", {"session": "r"})
        last.call("shutdown")
        with pytest.raises(ConnectionError):
            last.pump(10)
        assert last.notifications[-1].method == "bye"
    assert schemas.unseen() == set()
    assert os.path.exists(tmp_path / "o.gltf")
