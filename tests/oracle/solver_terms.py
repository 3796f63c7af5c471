"""The energy with all its terms as one stacked least-squares problem a vertex, and its minimum by
SciPy's nnls. Also how problems of solver_cases.py get further terms.

Each term of the energy is a run of rows: |A w - b|^2 summed over all rows is f(w).
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize

import solver_cases as cases
from solver_lib import EMPTY, Batch, Pose
from solver_oracle import closed_weights

Array = np.ndarray


@dataclass
class Strengths:
    """kappa, lambda and mu."""

    stiffness: float = 0.008
    guard: float = 0.3
    smooth: float = 0.0

    def options(self) -> dict[str, float]:
        return vars(self)


def start_rows(batch: Batch) -> tuple[Array, Array]:
    """Joints and weights at the session's start, of all vertices."""
    if batch.start_joints is None:
        return batch.joints, batch.anchor
    return batch.start_joints, batch.start_weights


def stacked(batch: Batch, strengths: Strengths, from_base: bool = False) -> tuple[Array, Array]:
    """A [count, rows, N] and b [count, rows] in long double; an empty slot's column is a guess.

    With from_base the guard measures every bone from the vertex's first, which is the same for
    rows of equal sum and does not see the last bit by which stored sums differ.
    """
    real = np.longdouble
    count, slots = len(batch.vertices), batch.slots
    columns, rights = [], []
    for pose in batch.poses():
        omega = np.ones(count) if pose.strengths is None else pose.strengths
        root = np.sqrt(omega.astype(real))[:, None]
        carried = batch.carried_by(pose.matrices, batch.joints, real)
        columns.append(root[..., None] * carried.transpose(0, 2, 1))
        rights.append(root * pose.targets.astype(real))
    joints, weights = start_rows(batch)
    held = np.where(joints == EMPTY, 0, weights)[batch.vertices].astype(real)
    for matrices in [] if batch.guard is None else batch.guard:
        root = np.sqrt(real(strengths.guard) / len(batch.guard))
        carried = batch.carried_by(matrices, batch.joints, real)
        kept = batch.carried_by(matrices, joints, real)
        if from_base:
            first = (batch.joints[batch.vertices] != EMPTY).argmax(1)
            base = carried[np.arange(count), first][:, None].copy()
            carried, kept = carried - base, kept - base
        columns.append(root * carried.transpose(0, 2, 1))
        rights.append(root * (held[..., None] * kept).sum(1))
    for factor, rows in ((strengths.stiffness, batch.anchor[batch.vertices]),
                         (strengths.smooth, batch.pulls)):  # fmt: skip
        if rows is not None:
            scale = real(factor) * real(batch.length)
            columns.append(np.broadcast_to(scale * np.eye(slots, dtype=real), (count, slots, slots)))
            rights.append(scale * rows.astype(real))
    return np.concatenate(columns, 1), np.concatenate(rights, 1)


def energy(problem: tuple[Array, Array], weights: Array) -> Array:
    a, b = problem
    return ((np.einsum("nrs,ns->nr", a, weights.astype(np.longdouble)) - b) ** 2).sum(1)


def gains(problem: tuple[Array, Array], before: Array, after: Array) -> Array:
    """f(before) - f(after), from differences."""
    a, b = problem
    before, after = before.astype(np.longdouble), after.astype(np.longdouble)
    step = np.einsum("nrs,ns->nr", a, before - after)
    both = np.einsum("nrs,ns->nr", a, before + after) - 2 * b
    return (step * both).sum(1)


def apart(problem: tuple[Array, Array], one: Array, other: Array) -> Array:
    """|A (w - w')|: no feasible row is so far from the minimum without costing its square."""
    step = one.astype(np.longdouble) - other.astype(np.longdouble)
    return np.sqrt((np.einsum("nrs,ns->nr", problem[0], step) ** 2).sum(1))


def optimum(batch: Batch, problem: tuple[Array, Array]) -> Array:
    """The optimal weights of every item, bounds and locks kept, by nnls; see oracle.nearest()."""
    free = batch.open()
    held, mass = closed_weights(batch)
    best = batch.weights[batch.vertices].astype(np.float64)
    a, b = problem
    for row in np.flatnonzero(free.any(1) & (mass > 0)):
        chosen = np.flatnonzero(free[row])
        goal = b[row] - a[row] @ held[row]
        points = (mass[row] * a[row][:, chosen] - goal[:, None]).astype(np.float64)
        scale = np.sqrt((points**2).sum(0).min())
        best[row] = held[row]
        if scale == 0.0:
            best[row, chosen[(points**2).sum(0).argmin()]] = mass[row]
            continue
        system = np.vstack([points, np.full(len(chosen), scale)])
        right = np.zeros(len(system))
        right[-1] = scale
        x, _ = scipy.optimize.nnls(system, right, maxiter=3000)
        best[row, chosen] = mass[row] * x / x.sum()
    return best


def unbounded(batch: Batch, problem: tuple[Array, Array]) -> Array:
    """The optimal weights of rows that need only sum to one: SciPy's least squares in the plane."""
    free = batch.open()
    held, _ = closed_weights(batch)
    best = batch.weights[batch.vertices].astype(np.float64)
    a, b = problem
    for row in np.flatnonzero(free.any(1)):
        chosen = np.flatnonzero(free[row])
        goal = (b[row] - a[row] @ held[row]).astype(np.float64)
        matrix = a[row][:, chosen]
        mass = float(1 - held[row].sum())
        edges = (matrix[:, 1:] - matrix[:, :1]).astype(np.float64)
        start = (goal - mass * matrix[:, 0]).astype(np.float64)
        x = scipy.linalg.lstsq(edges, start)[0] if len(chosen) > 1 else np.zeros(0)
        best[row] = held[row]
        best[row, chosen] = np.append(mass - x.sum(), x)
    return best


# ---- problems ----


def with_poses(batch: Batch, rng: np.random.Generator, count: int) -> Batch:
    """Targets in `count` further poses; strengths from none to a lot."""
    items = len(batch.vertices)

    def strengths() -> Array:
        return rng.choice([0.0, 0.0, 0.25, 1.0, 1.0, 30.0], items)

    more = []
    for _ in range(count):
        matrices = cases.bent_bones(rng, len(batch.matrices))
        wanted = cases.random_weights(rng, items, batch.slots)
        carried = batch.carried_by(matrices, batch.joints, np.float64)
        targets = (wanted[..., None] * carried).sum(1) + rng.normal(0, 0.02, (items, 3))
        more.append(Pose(matrices, targets, strengths() if rng.random() < 0.7 else None))
    return replace(batch, strengths=strengths() if rng.random() < 0.7 else None, more=more)


def with_guard(batch: Batch, rng: np.random.Generator, count: int) -> Batch:
    bones = len(batch.matrices)
    return replace(batch, guard=np.array([cases.bent_bones(rng, bones) for _ in range(count)]))


def with_pulls(batch: Batch, rng: np.random.Generator) -> Batch:
    """Smoothed changes: rows near the anchor, at times with negative entries."""
    pulls = batch.anchor[batch.vertices] + rng.normal(0, 0.05, batch.anchor[batch.vertices].shape)
    return replace(batch, pulls=pulls)


def with_changed_slots(batch: Batch, rng: np.random.Generator) -> Batch:
    """A later state: some of the start's bones have lost their slot to others."""
    count, slots = batch.joints.shape
    joints, anchor = batch.joints.copy(), batch.anchor.copy()
    for row in np.flatnonzero(rng.random(count) < 0.6):
        if len(set(joints[row])) < slots:
            continue  # a bone twice, or several slots without
        taken = rng.random(slots) < 0.4
        spare = np.setdiff1d(np.arange(len(batch.matrices)), joints[row])
        joints[row, taken] = rng.choice(spare, taken.sum(), replace=False)
        anchor[row, taken] = 0
        order = rng.permutation(slots)
        joints[row], anchor[row] = joints[row, order], anchor[row, order]
    weights = exact_sums(cases.random_weights(rng, count, slots))
    empty = joints == EMPTY
    if empty.any():
        weights = exact_sums(cases.without(weights, empty))
    return replace(
        batch,
        joints=joints,
        weights=weights,
        anchor=anchor,
        start_joints=batch.joints,
        start_weights=batch.anchor,
    )


def far_away(batch: Batch, shift: Array) -> Batch:
    """The same scene somewhere else."""

    def moved(matrices: Array) -> Array:
        matrices = matrices.copy()
        matrices[..., 3] += shift - matrices[..., :3] @ shift
        return matrices

    offset = shift.astype(np.float32)
    return replace(
        batch,
        rest=batch.rest + offset,
        matrices=moved(batch.matrices),
        targets=batch.targets + offset,
        more=[Pose(moved(p.matrices), p.targets + offset, p.strengths) for p in batch.more],
        guard=None if batch.guard is None else moved(batch.guard),
    )


def exact_sums(rows: Array) -> Array:
    """Rows that sum to one without a last bit to argue about: times strength and distance, that bit
    could weigh more than what is to be told apart."""
    rounded = np.round(rows.astype(float) * 2.0**24) / 2.0**24
    rounded[np.arange(len(rows)), rounded.argmax(1)] += 1 - rounded.sum(1)
    return np.where(rows.sum(1, keepdims=True) > 0, rounded, rows).astype(np.float32)


TERMS = ("poses", "many_poses", "guard", "pulls", "poses_guard", "slots_guard", "all")


def make(name: str, terms: str, seed: int, count: int, slots: int) -> tuple[Batch, Strengths]:
    """A family of solver_cases.py with further terms."""
    rng = np.random.default_rng([seed, slots, *name.encode(), *terms.encode()])
    batch = cases.make(name, seed, count, slots)
    batch.weights, batch.anchor = exact_sums(batch.weights), exact_sums(batch.anchor)
    strengths = Strengths(stiffness=float(rng.choice([1e-4, 1e-3, 0.008, 0.05])))
    if terms in ("slots_guard", "all"):
        batch = with_changed_slots(batch, rng)
    if terms in ("poses", "poses_guard", "all"):
        batch = with_poses(batch, rng, int(rng.integers(1, 5)))
    if terms == "many_poses":
        batch = with_poses(batch, rng, int(rng.integers(8, 19)))
    if terms in ("guard", "poses_guard", "slots_guard", "all"):
        batch = with_guard(batch, rng, int(rng.integers(1, 7)))
        strengths.guard = float(rng.choice([1e-4, 0.3, 3.0]))
    if terms in ("pulls", "all"):
        batch = with_pulls(batch, rng)
        strengths.smooth = float(rng.choice([0.003, 0.03]))
    batch.name = f"{name}+{terms}"
    return batch, strengths
