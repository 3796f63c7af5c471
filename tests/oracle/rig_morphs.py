"""Tubes that bend and have morph targets, and how three.js and NumPy show what was exported."""

from pathlib import Path

import numpy as np
import rig_numpy
from rig_lib import Gltf, Rig, run_node
from rig_make import Maker, Tube
from test_rig_pose import roots

TIMES = [0.0, 0.3, 1.0]


def fresh(path: Path) -> Gltf:
    """Reads past the cache: exports overwrite each other's names."""
    return Gltf.read.__wrapped__(Gltf, path)


def primitive(maker: Maker, shape: Tube, targets: int = 0, normals: bool = False, **attributes: int) -> dict:
    """A primitive with targets of random offsets; normals are in it and in its targets then."""
    rng = np.random.default_rng(5)
    flat = np.zeros_like(shape.positions) + np.float32([0, 0, 1])
    if normals:
        attributes["NORMAL"] = maker.accessor(flat)
    made = {"attributes": shape.attributes(maker, **attributes), "indices": maker.accessor(shape.indices)}
    for _ in range(targets):
        offsets = rng.normal(0, 0.1, shape.positions.shape).astype("<f4")
        target = {"POSITION": vectors(maker, offsets)}
        if normals:
            target["NORMAL"] = maker.accessor(np.zeros_like(flat))
        made.setdefault("targets", []).append(target)
    return made


def vectors(maker: Maker, array: np.ndarray, **extra: object) -> int:
    """An accessor with the bounds that a POSITION needs."""
    return maker.accessor(array, min=array.min(0).tolist(), max=array.max(0).tolist(), **extra)


def bend(maker: Maker) -> Maker:
    """Adds a clip that bends the chain at three joints."""
    angle = np.array([0, 0.5], "<f4")
    keys = np.stack([np.sin(angle), 0 * angle, 0 * angle, np.cos(angle)], 1).astype("<f4")
    times = maker.accessor(np.array([0, 1], "<f4"), min=[0], max=[1])
    rotations = maker.accessor(keys)
    maker.json["animations"] = [{
        "samplers": [{"input": times, "output": rotations}],
        "channels": [{"sampler": 0, "target": {"node": node, "path": "rotation"}} for node in (1, 2, 3)],
    }]  # fmt: skip
    return maker


def weight_clip(maker: Maker, node: int, values: np.ndarray, interpolation: str = "LINEAR", **extra: object) -> int:
    """Adds a channel for the weights of a node's mesh to the first clip, two keys; its sampler."""
    animation = maker.json["animations"][0]
    sampler = {"input": maker.accessor(np.array([0, 1], "<f4"), min=[0], max=[1]),
               "output": maker.accessor(values, **extra), "interpolation": interpolation}  # fmt: skip
    animation["samplers"].append(sampler)
    number = len(animation["samplers"]) - 1
    animation["channels"].append({"sampler": number, "target": {"node": node, "path": "weights"}})
    return number


def shown(path: Path, rig: Rig, morphs: dict[str, float] | None, scratch: Path) -> tuple[np.ndarray, list[str]]:
    """What three.js makes of the first clip at TIMES [times][V][3], and its names of the targets."""
    parts = [[part["mesh"], part["primitive"]] for part in rig.summary["parts"]]
    job = {"file": str(path), "out": str(scratch / "three.bin"), "poses": [[0, t] for t in TIMES], "parts": parts}
    if morphs is not None:
        job["morphs"] = morphs
    (answer,) = run_node("rig_three.mjs", [job])
    assert "error" not in answer, answer
    return np.fromfile(job["out"], "<f8").reshape(len(TIMES), -1, 3), answer["targets"][0]


def expected(path: Path, rig: Rig, rest: np.ndarray) -> np.ndarray:
    """The same by NumPy, with rest positions in place of the file's."""
    return np.stack([rig_numpy.posed(path, rig.summary["parts"], roots(rig), 0, t, rest) for t in TIMES])
