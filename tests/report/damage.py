"""What is done to a rig's own weights, so that they can be won back: three damages.

Both sides of a seam get the same. Every result has at most as many influences as was asked.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from .characters import NO_BONE, Rig, sparse_rows

SMOOTHING_ROUNDS = 8


def mesh_mean(rig: Rig) -> sparse.csr_matrix:
    """[P,P] that takes values at the places of a surface to the mean of their neighbours'."""
    places = rig.welds[rig.triangles]
    pairs = np.concatenate([places[:, [0, 1]], places[:, [1, 2]], places[:, [2, 0]]])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    count = rig.welds.max() + 1
    graph = sparse.coo_matrix((np.ones(2 * len(pairs)),
                               (pairs.T.reshape(-1), pairs[:, ::-1].T.reshape(-1))),
                              (count, count)).tocsr()
    graph.data[:] = 1
    degree = np.asarray(graph.sum(axis=1)).ravel()
    return sparse.diags(1 / np.maximum(degree, 1)) @ graph + sparse.diags((degree == 0) * 1.0)


def at_places(rig: Rig, values: np.ndarray) -> np.ndarray:
    """Values [V,...] by vertex to [P,...] by place."""
    _, first = np.unique(rig.welds, return_index=True)
    return values[first]


def smoothed(rig: Rig, slots: int = 4, rounds: int = SMOOTHING_ROUNDS) -> Rig:
    """Weights smoothed over the mesh, again and again, as a brush does it."""
    table, mean = at_places(rig, rig.dense), mesh_mean(rig)
    for _ in range(rounds):
        table = 0.5 * table + 0.5 * (mean @ table)
    return rig.with_weights(*sparse_rows(table[rig.welds], slots))


def nearest_bone(rig: Rig, slots: int = 4) -> Rig:
    """Each vertex wholly on the nearest of the bones that carry anything."""
    carrying = np.flatnonzero(rig.dense.max(axis=0) > 0)
    heads = rig.binds[:, :3, 3]
    nearest = np.full((len(rig.positions), len(heads)), np.inf)
    for bone in carrying:
        children = np.flatnonzero(rig.parents == bone)
        for tail in heads[children] if len(children) else heads[[bone]]:
            along = tail - heads[bone]
            reach = (rig.positions - heads[bone]) @ along / max(along @ along, 1e-12)
            foot = heads[bone] + np.clip(reach, 0, 1)[:, None] * along
            apart = np.linalg.norm(rig.positions - foot, axis=1)
            nearest[:, bone] = np.minimum(nearest[:, bone], apart)
    joints = np.full((len(rig.positions), slots), NO_BONE, np.uint16)
    weights = np.zeros(joints.shape)
    joints[:, 0], weights[:, 0] = nearest.argmin(axis=1), 1
    return rig.with_weights(joints, weights)


def bones_removed(rig: Rig, slots: int = 4) -> Rig:
    """Every weight off by a factor, and in each blend one bone gone that belongs there.

    Of a vertex's bones but the largest a random one is taken from its slots.
    """
    rng = np.random.default_rng(7)
    table = at_places(rig, rig.dense)
    table = table * rng.lognormal(0, 0.5, table.shape)
    chance = np.where(table > 0, rng.uniform(size=table.shape), -1)
    chance[np.arange(len(table)), table.argmax(axis=1)] = -1
    gone = chance.argmax(axis=1)
    has = chance.max(axis=1) >= 0
    table[np.flatnonzero(has), gone[has]] = 0
    return rig.with_weights(*sparse_rows(table[rig.welds], slots))


DAMAGES = {"smoothed": smoothed, "nearest bone": nearest_bone, "bones removed": bones_removed}
