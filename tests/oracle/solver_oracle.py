"""What the solver should find, by other means than the solver's.

exact        every face of the simplex in 80-bit long double, energies formed directly
nearest      SciPy's nnls on the problem as a nearest point of a hull, for any number of slots
affine       the KKT system, solved whole
thesis       the thesis's printed loop, its own Quadratic class and all, in NumPy
"""

import itertools

import numpy as np
import scipy.optimize

from solver_lib import Batch

Array = np.ndarray


def energy(batch: Batch, weights: Array, kappa: float) -> Array:
    """f of each item's weights in long double, from the definition."""
    ridge = np.longdouble(kappa * batch.length) ** 2
    anchor = batch.anchor[batch.vertices].astype(np.longdouble)
    moved = ((weights.astype(np.longdouble) - anchor) ** 2).sum(-1)
    return distance(batch, weights) ** 2 + ridge * moved


def positions(batch: Batch, weights: Array) -> Array:
    return (weights.astype(np.longdouble)[..., None] * batch.carried()).sum(1)


def distance(batch: Batch, weights: Array) -> Array:
    apart = positions(batch, weights) - batch.targets.astype(np.longdouble)
    return np.sqrt((apart**2).sum(-1))


def gains(batch: Batch, before: Array, after: Array, kappa: float) -> tuple[Array, Array]:
    """What a step gains, from differences, which long double resolves far below the energies:
    in energy, and in squared distance to the target. A loss is negative."""
    ridge = np.longdouble(kappa * batch.length) ** 2
    anchor = batch.anchor[batch.vertices].astype(np.longdouble)
    before, after = before.astype(np.longdouble), after.astype(np.longdouble)
    step = ((before - after)[..., None] * batch.carried()).sum(1)
    middle = positions(batch, before) - batch.targets - step / 2
    nearer = 2 * (step * middle).sum(-1)
    kept = ((before - after) * (before + after - 2 * anchor)).sum(-1)
    return nearer + ridge * kept, nearer


def closed_weights(batch: Batch) -> tuple[Array, Array]:
    """What closed slots weigh (0 in open ones), and what is left for the open ones."""
    held = np.where(batch.open(), 0, batch.weights[batch.vertices]).astype(np.longdouble)
    return held, np.maximum(1 - held.sum(-1), 0)


def _eliminate(matrix: Array, right: Array) -> Array:
    """Solves many small symmetric positive systems: [n, k, k], [n, k] -> [n, k]."""
    matrix, right = matrix.copy(), right.copy()
    size = right.shape[1]
    for p in range(size):
        for r in range(p + 1, size):
            factor = matrix[:, r, p] / matrix[:, p, p]
            matrix[:, r, p:] -= factor[:, None] * matrix[:, p, p:]
            right[:, r] -= factor * right[:, p]
    for p in reversed(range(size)):
        for r in range(p + 1, size):
            right[:, p] -= matrix[:, p, r] * right[:, r]
        right[:, p] /= matrix[:, p, p]
    return right


def exact(batch: Batch, kappa: float) -> Array:
    """The optimal weights of every item, by trying all faces. For few slots."""
    carried, free = batch.carried(), batch.open()
    anchor = batch.anchor[batch.vertices].astype(np.longdouble)
    target = batch.targets.astype(np.longdouble)
    ridge = np.longdouble(kappa * batch.length) ** 2
    held, mass = closed_weights(batch)
    best = batch.weights[batch.vertices].astype(np.longdouble)
    lowest = np.full(len(best), np.inf, np.longdouble)
    slots = range(batch.slots)
    for face in (f for k in slots for f in itertools.combinations(slots, k + 1)):
        rows = np.flatnonzero(free[:, face].all(-1))
        if len(rows) == 0:
            continue
        base, others = face[0], list(face[1:])
        weights = held[rows].copy()
        weights[:, base] = mass[rows]
        if others:
            # Directions e_i - e_base, in space and (times kappa L) among the weights.
            edges = carried[rows][:, others] - carried[rows][:, [base]]
            matrix = np.einsum("nik,njk->nij", edges, edges)
            matrix += ridge * (np.eye(len(others), dtype=np.longdouble) + 1)
            start = (weights[..., None] * carried[rows]).sum(1)
            apart = weights - anchor[rows]
            right = -np.einsum("nik,nk->ni", edges, start - target[rows])
            right -= ridge * (apart[:, others] - apart[:, [base]])
            step = _eliminate(matrix, right)
            weights[:, others] += step
            weights[:, base] -= step.sum(-1)
        here = ((weights[..., None] * carried[rows]).sum(1) - target[rows]) ** 2
        value = here.sum(-1) + ridge * ((weights - anchor[rows]) ** 2).sum(-1)
        value = np.where((weights[:, face] >= 0).all(-1), value, np.inf)
        better = value < lowest[rows]
        lowest[rows[better]] = value[better]
        best[rows[better]] = weights[better]
    return best


def nearest(batch: Batch, kappa: float) -> Array:
    """The optimal weights by SciPy's nnls, item by item, in float64.

    On the simplex of size m the residual is linear without a constant: sum_i w_i q_i with
    q_i = (d_i - t', kappa L (e_i m - o)) / m. The point of the hull of q_i nearest to the origin
    has the weights x / sum x of the x >= 0 that minimises |Q x|^2 + s^2 (1.x - 1)^2.
    """
    carried = batch.carried(np.longdouble)
    target = batch.targets.astype(np.longdouble)
    anchor = batch.anchor[batch.vertices].astype(np.longdouble)
    free = batch.open()
    held, mass = closed_weights(batch)
    stiff = np.longdouble(kappa * batch.length)
    best = held.astype(np.float64)
    for row in range(len(best)):
        chosen = np.flatnonzero(free[row])
        if len(chosen) == 0 or mass[row] <= 0:
            if len(chosen) == 0:
                best[row] = batch.weights[batch.vertices[row]]
            continue
        m = mass[row]
        goal = target[row] - (held[row][:, None] * carried[row]).sum(0)
        points = (m * carried[row, chosen] - goal).T
        lifted = stiff * (m * np.eye(len(chosen)) - anchor[row, chosen][:, None])
        matrix = np.vstack([points, lifted]).astype(np.float64)
        scale = np.sqrt((matrix**2).sum(0).min())
        if scale == 0.0:
            found = (matrix**2).sum(0).argmin()
            best[row, chosen[found]] = m
            continue
        system = np.vstack([matrix, np.full(len(chosen), scale)])
        right = np.zeros(len(system))
        right[-1] = scale
        x, _ = scipy.optimize.nnls(system, right, maxiter=1000)
        best[row, chosen] = m * x / x.sum()
    return best


def affine(batch: Batch, kappa: float) -> Array:
    """The optimal weights without bounds: the KKT matrix of each item, in long double."""
    carried, free = batch.carried(), batch.open()
    anchor = batch.anchor[batch.vertices].astype(np.longdouble)
    ridge = np.longdouble(kappa * batch.length) ** 2
    held, _ = closed_weights(batch)
    best = held.copy()
    for row in range(len(best)):
        chosen = np.flatnonzero(free[row])
        if len(chosen) == 0:
            best[row] = batch.weights[batch.vertices[row]]
            continue
        size = len(chosen)
        d = carried[row, chosen]
        goal = batch.targets[row] - (held[row][:, None] * carried[row]).sum(0)
        kkt = np.zeros((size + 1, size + 1), np.longdouble)
        kkt[:size, :size] = d @ d.T + ridge * np.eye(size)
        kkt[:size, size] = kkt[size, :size] = 1
        right = np.append(d @ goal + ridge * anchor[row, chosen], 1 - held[row].sum())
        best[row, chosen] = _pivoted(kkt, right)[:size]
    return best


def _pivoted(matrix: Array, right: Array) -> Array:
    """Gauss elimination with row pivoting, for long double (NumPy has none)."""
    table = np.column_stack([matrix, right])
    size = len(right)
    for p in range(size):
        lead = p + int(np.abs(table[p:, p]).argmax())
        table[[p, lead]] = table[[lead, p]]
        for r in range(p + 1, size):
            table[r] -= table[r, p] / table[p, p] * table[p]
    x = np.zeros(size, matrix.dtype)
    for p in reversed(range(size)):
        x[p] = (table[p, size] - table[p, p + 1 : size] @ x[p + 1 :]) / table[p, p]
    return x


class Quadratic:
    """w @ A @ w + b @ w + c, as in chapter 7.6.1."""

    def __init__(self, a: Array, b: Array, c: float) -> None:
        self.a, self.b, self.c = a, b, c
        self.w_min = None

    def __add__(self, other: "Quadratic") -> "Quadratic":
        return Quadratic(self.a + other.a, self.b + other.b, self.c + other.c)

    def get_minimiser(self) -> None:
        self.w_min = (-1 / 2) * np.linalg.inv(self.a) @ self.b

    def to_4d_weights(self) -> Array:
        return np.append(self.w_min, 1 - self.w_min.sum())


def thesis_row(p: Array, target: Array, old: Array, k: float, h: float) -> Array:
    """Chapters 7.6.2 and 7.6.3 for one vertex: p[j] = M_j v, old = its weights."""
    t = np.column_stack([p[0] - p[3], p[1] - p[3], p[2] - p[3]])
    target_minus_p3 = target - p[3]
    ones, identity = np.ones((3, 3)), np.eye(3)
    quadratic = Quadratic(t.T @ t, -2 * t.T @ target_minus_p3, target_minus_p3 @ target_minus_p3)
    quadratic += Quadratic(
        k * k * identity, -2 * k * k * old[:3], k * k * old[:3] @ old[:3]
    )
    quadratic += Quadratic(
        k * k * ones, 2 * k * k * np.full(3, old[3] - 1), k * k * (old[3] - 1) ** 2
    )
    quadratic.get_minimiser()
    weights = quadratic.to_4d_weights()
    epsilon = 0.000000012
    for axis in range(3):
        if weights[axis] < -epsilon:
            single = np.zeros((3, 3))
            single[axis, axis] = 1
            quadratic += Quadratic(single * h, np.zeros(3), 0)
            quadratic.get_minimiser()
            weights = quadratic.to_4d_weights()
    if weights[3] < -epsilon:
        quadratic += Quadratic(ones * h, np.full(3, -2.0) * h, 1 * h)
        quadratic.get_minimiser()
        weights = quadratic.to_4d_weights()
    return normalize_vector(weights)


def normalize_vector(vector: Array) -> Array:
    """normalizeVector of chapter 7.6.2, line by line."""
    minimum, maximum = 0, 1
    for i in range(4):
        if vector[i] < minimum:
            minimum = vector[i]
        if vector[i] > maximum:
            maximum = vector[i]
    total = 0
    for i in range(4):
        vector[i] += -minimum
        vector[i] /= maximum - minimum
        total += vector[i]
    for i in range(4):
        vector[i] /= total
    return vector


def thesis(batch: Batch, k: float = 0.05, h: float = 1.2) -> Array:
    carried = batch.carried(np.float64)
    old = batch.weights[batch.vertices].astype(np.float64)
    targets = batch.targets.astype(np.float64)
    return np.array([thesis_row(*row, k, h) for row in zip(carried, targets, old)])
