# SPDX-License-Identifier: GPL-3.0-or-later
"""Linear blend skinning in NumPy, as Blender's Armature modifier does it.

    p' = sum_i w_i D_i p / sum_i w_i,    D_b = pose_b @ inverse(bind_b)

Matrices are 4x4, bone to mesh space. Computed rather than read from an evaluated mesh, because an
evaluation costs a hundred times as much and is not there while a stroke is drawn.
"""

from __future__ import annotations

import numpy as np

NO_BONE = 65535  # fills free slots
AT_ONCE = 2048  # vertices: what is in between stays in the cache, a third of the time
LEAST_SUM = 1e-4  # Blender leaves a vertex with less weight than this where it is


def deformations(pose: np.ndarray, binds: np.ndarray) -> np.ndarray:
    """f64 [B,4,4] that take the rest shape to the pose."""
    return pose @ np.linalg.inv(binds)


def blend(positions: np.ndarray, joints: np.ndarray, weights: np.ndarray,
          matrices: np.ndarray) -> np.ndarray:
    """Posed positions, f64 [n,3], of rest positions [n,3] under weights [n,N] of joints [n,N]."""
    rows = matrices[:, :3].reshape(len(matrices), 12).astype(np.float64, copy=False)
    posed = np.empty((len(positions), 3))
    for first in range(0, len(positions), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        posed[part] = _blend(positions[part].astype(np.float64), joints[part], weights[part], rows)
    return posed


def _blend(rest: np.ndarray, joints: np.ndarray, weights: np.ndarray,
           rows: np.ndarray) -> np.ndarray:
    """The same for a few, with matrices as rows [B,12]."""
    sums = weights.sum(axis=1, dtype=np.float64)
    moves = sums > LEAST_SUM
    share = weights / np.where(moves, sums, 1.0)[:, None]
    used = np.where(joints == NO_BONE, 0, joints)
    blended = share[:, 0, None] * rows[used[:, 0]]
    for slot in range(1, joints.shape[1]):
        blended += share[:, slot, None] * rows[used[:, slot]]
    blended = blended.reshape(-1, 3, 4)
    posed = np.einsum("nij,nj->ni", blended[:, :, :3], rest) + blended[:, :, 3]
    return np.where(moves[:, None], posed, rest)


def differing(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """u32 indexes of the rows that are not the same, bit for bit but for the sign of zero."""
    differs = np.zeros(len(rows), bool)
    for column in range(rows.shape[1]):  # three times as fast as any(axis=1) on so few columns
        differs |= rows[:, column] != others[:, column]
    return np.flatnonzero(differs).astype(np.uint32)


def distances(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """f32 [n] between points [n,3]."""
    apart = np.asarray(points, np.float64) - others
    return np.sqrt(np.einsum("ni,ni->n", apart, apart)).astype(np.float32)
