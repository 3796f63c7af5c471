"""Rigs as arrays, and linear blend skinning in NumPy to hold the daemon against."""

from __future__ import annotations

import numpy as np

BONES = 12


def sheet(vertex_count: int) -> dict:
    """session.create's parameters for a rippled sheet that a chain of bones bends."""
    side = int(np.ceil(np.sqrt(vertex_count)))
    column, row = np.meshgrid(np.arange(side), np.arange(side))
    positions = np.stack([column / side, row / side, 0.05 * np.sin(column * 0.7)], -1)
    index = np.arange(side * side, dtype=np.uint32).reshape(side, side)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1)
    quads = quads.reshape(-1, 4)
    binds = np.tile(np.eye(4), (BONES, 1, 1))
    binds[:, 1, 3] = np.arange(BONES) / BONES
    along = positions[..., 1].ravel() * (BONES - 1)
    first = np.minimum(along.astype(int), BONES - 2)
    share = (along - first).astype(np.float32)
    weights = np.stack([1 - share, share], -1)
    kept = weights > 0
    return {
        "positions": positions.reshape(-1, 3).astype(np.float32),
        "triangles": np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint32),
        "bones": {"names": [f"bone.{i}" for i in range(BONES)],
                  "parents": np.arange(-1, BONES - 1, dtype=np.int32),
                  "binds": binds.reshape(BONES, 16)},
        "influence_offsets": np.concatenate([[0], np.cumsum(kept.sum(1))]).astype(np.uint32),
        "influence_joints": np.stack([first, first + 1], -1)[kept].astype(np.uint16),
        "influence_weights": weights[kept].astype(np.float32),
    }


def bent(angle: float) -> np.ndarray:
    """Posed bone matrices [B,16] with every joint bent and twisted by `angle` radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    bend = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    twist = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    matrices, world = [], np.eye(4)
    for bone in range(BONES):
        local = np.eye(4)
        local[:3, :3] = bend if bone % 2 else bend @ twist
        local[1, 3] = 1 / BONES if bone else 0
        world = world @ local
        matrices.append(world)
    return np.array(matrices).reshape(BONES, 16)


def skin(rig: dict, posed: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Linear blend skinning in float64."""
    binds = np.asarray(rig["bones"]["binds"]).reshape(-1, 4, 4)
    matrices = posed.reshape(-1, 4, 4) @ np.linalg.inv(binds)
    rest = np.concatenate([rig["positions"], np.ones((len(rig["positions"]), 1))], -1)
    used = np.where(joints == 65535, 0, joints)
    carried = np.einsum("vsij,vj->vsi", matrices[used][:, :, :3], rest.astype(np.float64))
    return np.einsum("vs,vsi->vi", weights.astype(np.float64), carried)


def bump(positions: np.ndarray, centre: int, radius: float, height: float) -> tuple:
    """A brush stroke: (vertices, targets) around one vertex, pushed outward by a smooth falloff."""
    distance = np.linalg.norm(positions - positions[centre], axis=-1)
    vertices = np.flatnonzero(distance < radius).astype(np.uint32)
    fall = (1 - (distance[vertices] / radius) ** 2) ** 2
    targets = positions[vertices] + height * fall[:, None] * np.array([0.3, 0.2, 0.9])
    return vertices, targets.astype(np.float32)
