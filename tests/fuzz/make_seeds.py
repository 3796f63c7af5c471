"""Writes the first inputs of the fuzzers, corpus/frame, session and gltf: one small input a feature.

usage: make_seeds.py CORPUS    with the daemon's modules on PYTHONPATH (./run torture does it)
What a fuzzer found later lies beside them under names of its own and is left alone.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "clients" / "blender_addon"), str(ROOT / "tests" / "oracle")]

from core.wire import encode_notification, encode_request  # noqa: E402
from rig_make import Maker, Tube, plain  # noqa: E402

SEGMENT = b"~~~~"  # in a session's input: what follows goes over the next connection


def rig(influences: int = 4) -> dict:
    """session.create's arrays: 6 vertices over 3 bones, two of them mirrored in x."""
    binds = np.tile(np.eye(4), (3, 1, 1))
    binds[1, 0, 3], binds[2, 0, 3] = 1, -1
    return {
        "positions": np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [1, 1, 0], [-1, 1, 0]],
                              np.float32),
        "triangles": np.array([[0, 1, 3], [1, 4, 3], [0, 3, 2], [2, 3, 5]], np.uint32),
        "bones": {"names": ["root", "arm.L", "arm.R"], "parents": np.array([-1, 0, 0], np.int32),
                  "binds": binds.reshape(3, 16)},
        "influence_offsets": np.array([0, 1, 3, 5, 6, 8, 10], np.uint32),
        "influence_joints": np.array([0, 0, 1, 0, 2, 0, 0, 1, 0, 2], np.uint16),
        "influence_weights": np.array([1, .5, .5, .5, .5, 1, .25, .75, .25, .75], np.float32),
        "influences": influences,
    }


HELLO = ("hello", {"protocol": {"min": 1, "max": 1},
                   "client": {"name": "fuzz", "version": "1", "id": "fuzz-1", "user": "someone"}})
CREATE = ("session.create", {"name": "s", **rig(), "durability": "off"})
BEND = ("pose.set", {"session": "s", "pose": "p", "bend": 20, "seed": 3})
SOME = np.array([1, 4], np.uint32)
AT = np.array([[1.1, 0, .1], [1, 1.2, 0]], np.float32)
STROKE = ("stroke.apply", {"session": "s", "pose": "p", "vertices": SOME, "positions": AT,
                           "sequence": 1})
S = {"session": "s"}

# A seed each: what is asked on one connection, after hello, a session and a pose.
TALKS: dict[str, list[tuple[str, dict]]] = {
    "reading": [("ping", {}), ("session.list", {}), ("session.info", S), ("mesh.get", S),
                ("pose.evaluate", {**S, "pose": "p", "vertices": SOME}),
                ("weights.get", {**S, "vertices": SOME}), ("stats", {})],
    "stroke": [STROKE, ("stroke.apply", {
        **STROKE[1], "mask": np.array([1, .5], np.float32), "mix": .5, "pin": "move",
        "stream": False, "slots": "evidence", "guard": 1, "smooth": .2, "stiffness": .01,
        "residual": "shape", "locked_bones": ["arm.R"], "sequence": 2,
        "locked_vertices": np.array([0], np.uint32)}),
        ("history.undo", {**S, "own": True, "sequence": 3}), ("history.redo", S)],
    "rest": [STROKE, ("stroke.apply", {**STROKE[1], "pose": "rest", "residual": "rest"}),
             ("shapes.list", S), ("shapes.get", {**S, "pose": "p"})],
    "thesis": [("stroke.apply", {**STROKE[1], "method": "thesis", "thesis_k": .1, "thesis_h": 2,
                                 "pin": "none", "constraint": "affine"})],
    "pins": [STROKE, ("pins.list", S), ("pins.get", {**S, "pose": "p"}),
             ("pins.weigh", {**S, "pose": "p", "weight": 3, "vertices": SOME}),
             ("pins.solve", {**S, "pose": "p"}), ("pins.clear", {**S, "pose": "p"})],
    "guards": [("guard.set", {**S, "poses": ["p"], "count": 2}), ("guard.get", S),
               ("guard.set", {**S, "matrices": np.tile(np.eye(4), (3, 1, 1)).reshape(3, 16)})],
    "edits": [("weights.set", {**S, "vertices": SOME, "weights": np.array(
        [[.5, .5, 0, 0], [1, 0, 0, 0]], np.float32), "joints": np.array(
            [[0, 1, 65535, 65535], [1, 65535, 65535, 65535]], np.uint16)}),
        ("weights.mirror", {**S, "tolerance": .01}), ("weights.prune", {**S, "below": .3}),
        ("weights.reduce", {**S, "influences": 1, "by": "size"})],
    "refit": [("session.refit", {**S, "poses": ["p", "rest"], "rounds": 2, "positions": np.tile(
        rig()["positions"], (2, 1))})],
    "poses": [("pose.set", {**S, "pose": "q", "matrices": np.tile(np.eye(4), (3, 1, 1))}),
              ("pose.set", {**S, "pose": "q", "clip": "no", "time": 1.5}),
              ("pose.evaluate", {**S, "pose": "q"})],
    "sharing": [("session.attach", {**S, "revision": 0, "instance": "0123456789abcdef"}),
                ("session.claim", {**S, "bones": ["arm.L"], "vertices": SOME}),
                ("session.claim", S), ("session.detach", S)],
    "keeping": [("session.set", {**S, "durability": "second", "history_bytes": 1 << 20}), STROKE,
                ("session.save", {**S, "path": "/tmp/s.skind"}),
                ("session.fork", {**S, "name": "t"}), ("session.verify", S),
                ("session.close", S), ("session.open", {"closed": "s", "name": "u"}),
                ("session.delete", {"session": "u"}), ("session.list", {})],
    "export": [("session.export", {**S, "path": "/tmp/s.glb"}),
               ("session.create", {"name": "f", "file": "/tmp/s.glb", "reduce": "posed"})],
    "eight": [("session.create", {"name": "e", **rig(8), "fill": "infect"}),
              ("weights.get", {"session": "e"}), ("shutdown", {})],
}


def stream(talk: list[tuple[str, dict]], lines: bool) -> bytes:
    """A whole connection: hello, a session, a pose, and the talk."""
    pieces = []
    for id, (method, params) in enumerate([HELLO, CREATE, BEND, *talk], 1):
        pieces += encode_request(id, method, params, lines=lines)
    pieces += encode_notification("cancel", {"id": 4}, lines=lines)
    return b"".join(bytes(piece) for piece in pieces)


def two(first: list[tuple[str, dict]], second: list[tuple[str, dict]]) -> bytes:
    """Two connections that take turns: the second attaches to the first one's session."""
    begin = [HELLO, CREATE, BEND]
    segments, id = [], 0
    for turn, talk in enumerate([begin, [HELLO, ("session.attach", S)], [], first, second, [],
                                 [("history.undo", S)], [("history.undo", {**S, "own": True})]]):
        pieces = []
        for method, params in talk:
            id += 1
            pieces += encode_request(id, method, params, lines=turn % 3 == 1)
        segments.append(b"".join(bytes(piece) for piece in pieces))
    return SEGMENT.join(segments)


def animated() -> Maker:
    """A tube with a clip of each interpolation, and a morph target."""
    maker = plain(joint_count=4)
    times = maker.accessor(np.array([0, .5, 1], "<f4"))
    turns = np.tile(np.array([0, 0, 0, 1], "<f4"), (3, 1))
    samplers = [{"input": times, "output": maker.accessor(turns)},
                {"input": times, "output": maker.accessor(np.ones((3, 3), "<f4")),
                 "interpolation": "STEP"},
                {"input": times, "output": maker.accessor(np.ones((9, 3), "<f4")),
                 "interpolation": "CUBICSPLINE"}]
    channels = [{"sampler": 0, "target": {"node": 1, "path": "rotation"}},
                {"sampler": 1, "target": {"node": 1, "path": "scale"}},
                {"sampler": 2, "target": {"node": 2, "path": "translation"}}]
    maker.json["animations"] = [{"name": "go", "samplers": samplers, "channels": channels}]
    offsets = maker.accessor(np.zeros((30, 3), "<f4"))
    primitive = maker.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": offsets}]
    maker.json["meshes"][0] |= {"weights": [.5], "extras": {"targetNames": ["smile"]}}
    return maker


def awkward() -> Maker:
    """Bytes for weights, interleaved, sparse positions, no indices."""
    maker, shape = Maker(), Tube(joint_count=8)
    columns = maker.interleaved(JOINTS_0=shape.joints.astype("u1"), WEIGHTS_0=shape.shares)
    positions = maker.sparse(shape.positions, base=False)
    return shape.build(maker, [{"attributes": {**columns, "POSITION": positions}}])


def write(folder: Path) -> None:
    for kind in ("frame", "session", "gltf"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    for name, talk in TALKS.items():
        for lines in (False, True):
            ending = "lines" if lines else "frames"
            content = stream(talk, lines)
            (folder / "session" / f"{name}.{ending}").write_bytes(content)
            (folder / "frame" / f"{name}.{ending}").write_bytes(bytes([97 * lines]) + content)
    (folder / "session" / "two").write_bytes(
        two([STROKE, ("weights.prune", S)], [("session.claim", {**S, "vertices": SOME}), STROKE]))
    (folder / "frame" / "answer").write_bytes(
        b'\0{"jsonrpc":"2.0","id":null,"error":{"code":-32700,"message":"m"}}\n')
    for name, maker in {"plain": plain(joint_count=4), "animated": animated(),
                        "awkward": awkward()}.items():
        (folder / "gltf" / f"{name}.glb").write_bytes(maker.glb())
        maker.write(folder / "gltf" / f"{name}.gltf")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
