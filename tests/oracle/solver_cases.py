"""Random and degenerate problems for the solver, by name. Same seed, same problems.

Scenes are about one unit large (L is 1) unless a family says otherwise.
"""

from collections.abc import Callable

import numpy as np
import scipy.spatial.transform

from solver_lib import EMPTY, Batch

Rng = np.random.Generator
BONES = 40


def rotations(rng: Rng, count: int, degrees: float) -> np.ndarray:
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.radians(degrees) * rng.uniform(-1, 1, (count, 1))
    return scipy.spatial.transform.Rotation.from_rotvec(axes * angles).as_matrix()


def bent_bones(rng: Rng, count: int = BONES, degrees: float = 70) -> np.ndarray:
    """Rotations about points of the scene, as a posed skeleton has them."""
    turn = rotations(rng, count, degrees)
    centre = rng.uniform(-0.3, 0.3, (count, 3))
    shift = centre - np.einsum("bij,bj->bi", turn, centre) + rng.normal(0, 0.02, (count, 3))
    return np.concatenate([turn, shift[..., None]], axis=2)


def random_weights(rng: Rng, count: int, slots: int) -> np.ndarray:
    """Rows on the simplex as files hold them: often zeros, sums to one in float32 only."""
    weights = rng.exponential(size=(count, slots)) ** 2
    weights *= rng.random((count, slots)) < rng.choice([0.3, 0.7, 1.0], (count, 1))
    weights[:, 0] += (weights.sum(1) == 0) * 1.0
    weights /= weights.sum(1, keepdims=True)
    weights = weights.astype(np.float32)
    row = np.arange(count)
    order = rng.permuted(np.tile(np.arange(slots), (count, 1)), axis=1)
    return weights[row[:, None], order]


def random_joints(rng: Rng, count: int, slots: int, bones: int = BONES) -> np.ndarray:
    return rng.random((count, bones)).argsort(axis=1)[:, :slots]


def skinned(batch: Batch, weights: np.ndarray) -> np.ndarray:
    return (weights.astype(float)[..., None] * batch.carried(np.float64)).sum(1)


def plain(rng: Rng, count: int, slots: int) -> Batch:
    """A posed character in rest of its stroke: targets where the vertices are."""
    batch = Batch(
        rest=rng.uniform(-0.3, 0.3, (count, 3)),
        joints=random_joints(rng, count, slots),
        weights=random_weights(rng, count, slots),
        matrices=bent_bones(rng),
        targets=np.zeros((count, 3)),
    )
    batch.targets = skinned(batch, batch.weights).astype(np.float32)
    return batch


def moved(batch: Batch, rng: Rng, size: float) -> Batch:
    batch.targets = (
        batch.targets + rng.normal(0, size, batch.targets.shape)
    ).astype(np.float32)
    return batch


def strokes(rng: Rng, count: int, slots: int) -> Batch:
    """Brush-like displacements from a hair to a limb."""
    batch = plain(rng, count, slots)
    sizes = 10 ** rng.uniform(-6, -0.5, (count, 1))
    batch.targets = (
        batch.targets + sizes * rng.normal(size=batch.targets.shape)
    ).astype(np.float32)
    return batch


def later_strokes(rng: Rng, count: int, slots: int) -> Batch:
    """The weights have left the anchor already."""
    batch = strokes(rng, count, slots)
    batch.anchor = random_weights(rng, count, slots)
    return batch


def reachable(rng: Rng, count: int, slots: int) -> Batch:
    """Targets that some other weights reach."""
    batch = plain(rng, count, slots)
    batch.targets = skinned(batch, random_weights(rng, count, slots)).astype(np.float32)
    return batch


def rest_pose(rng: Rng, count: int, slots: int) -> Batch:
    batch = plain(rng, count, slots)
    batch.matrices[:] = np.eye(3, 4)
    batch.targets = skinned(batch, batch.weights).astype(np.float32)
    return moved(batch, rng, 0.05)


def one_rigid_motion(rng: Rng, count: int, slots: int) -> Batch:
    batch = plain(rng, count, slots)
    batch.matrices[:] = batch.matrices[0]
    batch.targets = skinned(batch, batch.weights).astype(np.float32)
    return moved(batch, rng, 0.05)


def coincident_pairs(rng: Rng, count: int, slots: int) -> Batch:
    """Bones 0 and 1, 2 and 3, ... move alike."""
    batch = strokes(rng, count, slots)
    batch.matrices[1::2] = batch.matrices[0::2]
    batch.joints = np.ascontiguousarray(
        (2 * rng.integers(0, BONES // 2 - slots, (count, 1)) + np.arange(slots)), np.uint16
    )
    return batch


def all_but_one_coincident(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.matrices[1:] = batch.matrices[1]
    batch.joints[:, rng.integers(slots)] = 0
    return batch


def nearly_coincident(rng: Rng, count: int, slots: int) -> Batch:
    """Here gains are so small that rows must sum to one exactly, or their sums decide."""
    batch = strokes(rng, count, slots)
    batch.weights = np.round(batch.weights * 2.0**24) / 2.0**24
    batch.weights[np.arange(count), batch.weights.argmax(1)] += 1 - batch.weights.sum(1)
    batch.weights = batch.weights.astype(np.float32)
    batch.anchor = batch.weights
    sizes = 10 ** rng.uniform(-16, -4, (BONES, 1, 1))
    batch.matrices = batch.matrices[:1] + sizes * rng.normal(size=(BONES, 3, 4))
    return batch


def on_a_line(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.matrices[:] = np.eye(3, 4)
    batch.matrices[:, :, 3] = rng.normal(0, 0.2, (BONES, 1)) * rng.normal(0, 1, (1, 3))
    return batch


def on_a_plane(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.matrices[:] = np.eye(3, 4)
    batch.matrices[:, :2, 3] = rng.normal(0, 0.2, (BONES, 2))
    return batch


def on_a_grid(rng: Rng, count: int, slots: int) -> Batch:
    """Translations by whole steps: ties everywhere."""
    batch = plain(rng, count, slots)
    batch.rest[:] = rng.integers(-2, 3, (count, 3)) / 8
    batch.matrices[:] = np.eye(3, 4)
    batch.matrices[:, :, 3] = rng.integers(-1, 2, (BONES, 3)) / 4
    batch.weights = rng.permuted(
        np.tile(np.eye(1, slots, dtype=np.float32), (count, 1)), axis=1
    )
    batch.anchor = batch.weights
    batch.targets = (rng.integers(-4, 5, (count, 3)) / 8).astype(np.float32)
    return batch


def far_targets(rng: Rng, count: int, slots: int) -> Batch:
    return moved(plain(rng, count, slots), rng, 30.0)


def hopeless_targets(rng: Rng, count: int, slots: int) -> Batch:
    return moved(plain(rng, count, slots), rng, 1000.0)


def at_a_corner(rng: Rng, count: int, slots: int) -> Batch:
    """The target is where one of the bones carries the vertex."""
    batch = plain(rng, count, slots)
    carried = batch.carried(np.float64)
    batch.targets = carried[np.arange(count), rng.integers(slots, size=count)].astype(np.float32)
    return batch


def on_an_edge(rng: Rng, count: int, slots: int) -> Batch:
    batch = plain(rng, count, slots)
    weights = np.zeros((count, slots))
    weights[:, 0] = rng.random(count)
    weights[:, slots - 1] += 1 - weights[:, 0]
    batch.targets = skinned(batch, weights).astype(np.float32)
    return batch


def one_bone(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.weights[:] = 0
    batch.weights[:, 0] = 1
    batch.joints[:, 1:] = EMPTY
    return batch


def empty_slots(rng: Rng, count: int, slots: int) -> Batch:
    batch = later_strokes(rng, count, slots)
    gone = rng.random((count, slots)) < 0.4
    gone[np.arange(count), rng.integers(slots, size=count)] = False
    batch.joints[gone] = EMPTY
    batch.weights = without(batch.weights, gone)
    batch.anchor = without(batch.anchor, gone)
    return batch


def without(weights: np.ndarray, gone: np.ndarray) -> np.ndarray:
    weights = np.where(gone, 0, weights.astype(float))
    bare = weights.sum(1) == 0
    weights[bare, gone[bare].argmin(1)] = 1
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)


def locked_bones(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.bone_locked = (rng.random(BONES) < 0.4).astype(np.uint8)
    return batch


def locked_later(rng: Rng, count: int, slots: int) -> Batch:
    """Locked after strokes: the anchor is out of reach for the locked slots."""
    batch = later_strokes(rng, count, slots)
    batch.bone_locked = (rng.random(BONES) < 0.4).astype(np.uint8)
    return batch


def no_free_mass(rng: Rng, count: int, slots: int) -> Batch:
    """Locked slots hold all the weight there is."""
    batch = strokes(rng, count, slots)
    batch.bone_locked = (np.arange(BONES) % 2).astype(np.uint8)
    open_ones = batch.joints % 2 == 0
    open_ones[open_ones.all(1)] = False
    batch.weights = without(batch.weights, open_ones)
    batch.anchor = batch.weights
    return batch


def all_locked(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.bone_locked = np.ones(BONES, np.uint8)
    return batch


def locked_vertices(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    batch.vertex_locked = (rng.random(count) < 0.5).astype(np.uint8)
    return batch


def scaled_bones(rng: Rng, count: int, slots: int) -> Batch:
    """Flat, mirrored and stretched bones."""
    batch = plain(rng, count, slots)
    batch.matrices[:, :, :3] *= rng.choice([-1.0, 0.0, 0.5, 1.0], (BONES, 1, 3))
    return moved(batch, rng, 0.05)


def tiny_weights(rng: Rng, count: int, slots: int) -> Batch:
    batch = strokes(rng, count, slots)
    weights = 10.0 ** rng.uniform(-44, -6, (count, slots))
    weights[:, 0] = 1 - weights[:, 1:].sum(1)
    batch.weights = weights.astype(np.float32)
    batch.anchor = batch.weights
    return batch


FAMILIES: dict[str, Callable[[Rng, int, int], Batch]] = {
    f.__name__: f
    for f in (
        strokes, later_strokes, reachable, rest_pose, one_rigid_motion, coincident_pairs,
        all_but_one_coincident, nearly_coincident, on_a_line, on_a_plane, on_a_grid, far_targets,
        hopeless_targets, at_a_corner, on_an_edge, one_bone, empty_slots, locked_bones,
        locked_later, no_free_mass, all_locked, locked_vertices, scaled_bones, tiny_weights,
    )
}  # fmt: skip

# The weights are the anchor: what a session's first stroke sees.
FIRST_STROKES = [n for n in FAMILIES if n not in ("later_strokes", "empty_slots", "locked_later")]


def make(name: str, seed: int, count: int, slots: int) -> Batch:
    """One family's problems. L is 1 and the scene about that large."""
    rng = np.random.default_rng([seed, slots, *name.encode()])
    batch = FAMILIES[name](rng, count, slots)
    batch.name = name
    # Families set arrays after the batch was made: check their types again.
    batch.__post_init__()
    return batch
