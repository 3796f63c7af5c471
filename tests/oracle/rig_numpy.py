"""Linear blend skinning of glTF files with NumPy and SciPy: any number of influences, skind's
policies for weights, and nothing of skind's code."""

from pathlib import Path

import numpy as np
from rig_lib import Gltf
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp


def _sample(sampler: dict, gltf: Gltf, path: str, time: float) -> np.ndarray:
    times = gltf.floats(sampler["input"])[:, 0]
    values = gltf.floats(sampler["output"])
    kind = sampler.get("interpolation", "LINEAR")
    time = float(np.clip(time, times[0], times[-1]))
    if kind == "CUBICSPLINE":
        values = values.reshape(len(times), 3, -1)
        left, value, right = values[:, 0], values[:, 1], values[:, 2]
        if len(times) == 1:
            return value[0]
        at = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2))
        piece = CubicHermiteSpline(times[at : at + 2], value[at : at + 2], [right[at], left[at + 1]])
        return piece(time)
    at = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 1))
    if kind == "STEP" or at == len(times) - 1:
        return values[at]
    if path == "rotation":
        return Slerp(times[at : at + 2], Rotation.from_quat(values[at : at + 2]))(time).as_quat()
    share = (time - times[at]) / (times[at + 1] - times[at])
    return (1 - share) * values[at] + share * values[at + 1]


def _local(node: dict) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    rotation = Rotation.from_quat(node.get("rotation", [0, 0, 0, 1])).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1, 1, 1]), float)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def node_matrices(gltf: Gltf, clip: int | None, time: float) -> np.ndarray:
    nodes = [dict(node) for node in gltf.json["nodes"]]
    if clip is not None:
        animation = gltf.json["animations"][clip]
        for channel in animation["channels"]:
            path, node = channel["target"]["path"], channel["target"].get("node")
            if path in ("translation", "rotation", "scale") and node is not None:
                sampler = animation["samplers"][channel["sampler"]]
                nodes[node][path] = _sample(sampler, gltf, path, time)
    parents = np.full(len(nodes), -1)
    for index, node in enumerate(nodes):
        parents[node.get("children", [])] = index
    matrices = [_local(node) for node in nodes]
    result = np.empty((len(nodes), 4, 4))
    for index in range(len(nodes)):
        matrix, up = matrices[index], parents[index]
        while up >= 0:
            matrix, up = matrices[up] @ matrix, parents[up]
        result[index] = matrix
    return result


def _weights(gltf: Gltf, attributes: dict, root: int) -> tuple[np.ndarray, np.ndarray]:
    sets = sum(name.startswith("JOINTS_") for name in attributes)
    joints = np.hstack([gltf.elements(attributes[f"JOINTS_{s}"]) for s in range(sets)]).astype(int)
    weights = np.hstack([gltf.floats(attributes[f"WEIGHTS_{s}"], normalized=True) for s in range(sets)])
    weights[~np.isfinite(weights) | (weights < 0)] = 0
    empty = weights.sum(axis=1) == 0
    joints[empty, 0], weights[empty, 0] = root, 1
    return joints, weights / weights.sum(axis=1, keepdims=True)


def posed(
    path: Path, parts: list[dict], roots: list[int], clip: int | None, time: float, moved: np.ndarray | None = None
) -> np.ndarray:
    """Positions [V][3] of the parts that rig_probe lists; roots[skin] is a joint number; moved [V][3]
    stands for the file's rest positions."""
    gltf = Gltf.read(path)
    nodes = node_matrices(gltf, clip, time)
    result = []
    for part in parts:
        skin = gltf.json["skins"][part["skin"]]
        joints = skin["joints"]
        binds = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in skin:
            columns = gltf.floats(skin["inverseBindMatrices"])
            binds = columns.reshape(-1, 4, 4).transpose(0, 2, 1)[: len(joints)]
        matrices = (nodes[joints] @ binds)[:, :3]
        primitive = gltf.json["meshes"][part["mesh"]]["primitives"][part["primitive"]]
        attributes = primitive["attributes"]
        rest = gltf.floats(attributes["POSITION"])
        if moved is not None:
            rest = moved[part["first"] : part["first"] + part["count"]].astype(np.float64)
        which, weights = _weights(gltf, attributes, roots[part["skin"]])
        carried = np.einsum("vkij,vj->vki", matrices[which], np.c_[rest, np.ones(len(rest))])
        result.append(np.einsum("vk,vki->vi", weights, carried))
    return np.concatenate(result)
