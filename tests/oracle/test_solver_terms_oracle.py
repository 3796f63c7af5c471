"""The solve with several poses, guard, pulls and changed slots, against SciPy on the stacked
least-squares problem, in 80-bit long double.
"""

from dataclasses import replace

import numpy as np
import pytest

import solver_cases as cases
import solver_lib as lib
import solver_terms as terms
from solver_lib import Batch, Result
from solver_terms import Strengths

APART = 1e-7  # of L and the root of all strengths
SLOTS = [2, 4, 8]


def size(batch: Batch, strengths: Strengths) -> np.ndarray:
    """The root of what all terms weigh."""
    total = np.full(len(batch.vertices), 0.0 if batch.guard is None else strengths.guard)
    for pose in batch.poses():
        total += 1.0 if pose.strengths is None else pose.strengths
    return np.sqrt(np.maximum(total, 1.0))


def check_rows(batch: Batch, result: Result) -> None:
    closed = ~batch.open()
    assert np.isfinite(result.weights).all()
    assert (result.weights >= 0).all()
    sums = result.weights.astype(np.longdouble).sum(1)
    assert (np.abs(sums - 1)[~closed.all(1)] <= 1e-7).all()
    before = batch.weights[batch.vertices]
    assert (result.weights.view(np.uint32) == before.view(np.uint32))[closed].all()


def check_never_worse(batch: Batch, strengths: Strengths, result: Result) -> None:
    problem = terms.stacked(batch, strengths, from_base=True)
    before, anchor = batch.weights[batch.vertices], batch.anchor[batch.vertices]
    # The guard's pair factors are float64: what they round off is no loss.
    rounding = 1e-18 if batch.guard is None else 1e-18 + 1e-15 * strengths.guard
    noise = rounding * np.abs(before - result.weights).sum(1)
    assert (terms.gains(problem, before, result.weights) >= -noise).all()
    started = terms.start_rows(batch)[1][batch.vertices]
    whole = anchor.astype(float).sum(1) == started.astype(float).sum(1)
    open_to_it = ((anchor == before) | batch.open()).all(1) & whole
    noise = 1e-13 * np.abs(anchor - result.weights).sum(1) * size(batch, strengths) ** 2
    noise *= 1 + result.after
    assert (terms.gains(problem, anchor, result.weights) >= -noise)[open_to_it].all()


def check_optimum(
    batch: Batch,
    strengths: Strengths,
    result: Result,
    best: np.ndarray,
    wide: np.ndarray | float = 1.0,
) -> None:
    """As in test_solver_oracle.py. Between the anchor and a solution that is better by no more than
    float64 tells when both are far from the weights before, the anchor is taken."""
    problem = terms.stacked(batch, strengths)
    off = terms.apart(problem, result.weights, best) / batch.length
    off = off > APART * size(batch, strengths) * wide
    lost = terms.energy(problem, result.weights) - terms.energy(problem, best)
    tie = (result.weights == batch.anchor[batch.vertices]).all(1)
    lower = lost <= np.where(tie, 2e-12 * size(batch, strengths) ** 2, 0)
    assert not (off & ~lower).any()
    assert (off & ~tie).mean() <= 2e-2


@pytest.mark.parametrize("slots", SLOTS)
@pytest.mark.parametrize("kind", terms.TERMS)
@pytest.mark.parametrize("name", cases.FAMILIES)
def test_all_terms_against_nnls(name: str, kind: str, slots: int) -> None:
    batch, strengths = terms.make(name, kind, seed=31, count=lib.scaled(60), slots=slots)
    result = lib.solve(batch, **strengths.options())
    check_rows(batch, result)
    check_never_worse(batch, strengths, result)
    check_optimum(batch, strengths, result, terms.optimum(batch, terms.stacked(batch, strengths)))


def widened(rows: np.ndarray | None, fill: float) -> np.ndarray | None:
    return None if rows is None else np.pad(rows, ((0, 0), (0, 1)), constant_values=fill)


@pytest.mark.parametrize("kind", terms.TERMS)
@pytest.mark.parametrize("name", ["strokes", "later_strokes", "empty_slots", "locked_bones"])
def test_lanes_and_active_set_agree(name: str, kind: str) -> None:
    """Four slots and an empty fifth go through the other code."""
    batch, strengths = terms.make(name, kind, seed=32, count=lib.scaled(1000), slots=4)
    wide = replace(
        batch,
        joints=widened(batch.joints, lib.EMPTY),
        weights=widened(batch.weights, 0),
        anchor=widened(batch.anchor, 0),
        start_joints=widened(batch.start_joints, lib.EMPTY),
        start_weights=widened(batch.start_weights, 0),
        pulls=widened(batch.pulls, 0),
    )
    lanes = lib.solve(batch, **strengths.options())
    scalar = lib.solve(wide, **strengths.options())
    assert (scalar.weights[:, 4] == 0).all()
    problem = terms.stacked(batch, strengths)
    off = terms.apart(problem, lanes.weights, scalar.weights[:, :4])
    assert (off > APART * size(batch, strengths)).mean() <= 5e-3


def same_bits(one: Result, other: Result) -> None:
    for a, b in zip(vars(one).values(), vars(other).values()):
        assert (a.view(np.uint32) == b.view(np.uint32)).all()


@pytest.mark.parametrize("kind", terms.TERMS)
@pytest.mark.parametrize("constraint", [lib.SIMPLEX, lib.AFFINE])
@pytest.mark.parametrize("slots", [4, 8])
def test_same_bits_for_any_instruction_set_and_chunks(
    kind: str, constraint: int, slots: int
) -> None:
    batch, strengths = terms.make("empty_slots", kind, seed=33, count=lib.scaled(400), slots=slots)
    options = strengths.options() | {"constraint": constraint}
    whole = lib.solve(batch, **options)
    for simd in (lib.PLAIN, lib.AVX2, lib.AVX512):
        same_bits(whole, lib.solve(batch, simd=simd, **options))
    order = np.random.default_rng(34).permutation(len(batch.vertices))
    for chunk_size in (1, 7, 61):
        for start in range(0, len(order), chunk_size)[: 400 // chunk_size]:
            chunk = order[start : start + chunk_size]
            part = lib.solve(batch.part(chunk), **options)
            same_bits(part, Result(*(a[chunk] for a in vars(whole).values())))


@pytest.mark.parametrize("slots", [3, 4, 8])
@pytest.mark.parametrize("constraint", [lib.SIMPLEX, lib.AFFINE])
@pytest.mark.parametrize("name", cases.FAMILIES)
def test_terms_without_strength_change_no_bit(name: str, constraint: int, slots: int) -> None:
    rng = np.random.default_rng(35)
    batch = cases.make(name, seed=36, count=lib.scaled(200), slots=slots)
    plain = lib.solve(batch, constraint=constraint)
    items = len(batch.vertices)
    more = terms.with_poses(batch, rng, 9).more
    silent = replace(
        batch,
        strengths=np.ones(items),
        more=[replace(pose, strengths=np.zeros(items)) for pose in more],
    )
    idle = replace(
        terms.with_pulls(terms.with_guard(batch, rng, 3), rng),
        start_joints=batch.joints,
        start_weights=batch.anchor,
    )
    same_bits(plain, lib.solve(silent, constraint=constraint))
    same_bits(plain, lib.solve(idle, constraint=constraint, guard=0.0, smooth=0.0))


@pytest.mark.parametrize("slots", SLOTS)
@pytest.mark.parametrize("kind", terms.TERMS)
@pytest.mark.parametrize("name", ["strokes", "empty_slots", "locked_bones", "later_strokes"])
def test_affine_against_least_squares(name: str, kind: str, slots: int) -> None:
    batch, strengths = terms.make(name, kind, seed=37, count=lib.scaled(60), slots=slots)
    strengths.stiffness = max(strengths.stiffness, 1e-3)
    result = lib.solve(batch, constraint=lib.AFFINE, **strengths.options())
    check_never_worse(batch, strengths, result)
    closed = ~batch.open()
    assert (result.weights == batch.weights[batch.vertices])[closed].all()
    best = terms.unbounded(batch, terms.stacked(batch, strengths))
    # Weights beyond one take float32's larger steps with them. Beyond two a row may have no sum
    # within 1e-7 of one, and then it stays what it was.
    wide = np.maximum(np.abs(best).max(1), 1)
    kept = (result.weights == batch.weights[batch.vertices]).all(1) & (wide > 2)
    some = np.flatnonzero(~kept)
    stored = Result(*(a[some] for a in vars(result).values()))
    check_optimum(batch.part(some), strengths, stored, best[some], 2 * wide[some])
    assert kept.mean() <= 0.05


@pytest.mark.parametrize("slots", SLOTS)
@pytest.mark.parametrize("name", cases.FIRST_STROKES)
def test_a_guarded_first_stroke_leaves_nothing_farther(name: str, slots: int) -> None:
    rng = np.random.default_rng(38)
    for strength in (1e-4, 0.3, 100.0):
        batch = cases.make(name, seed=39, count=lib.scaled(400), slots=slots)
        batch = terms.with_guard(batch, rng, 5)
        problem = terms.stacked(replace(batch, guard=None), Strengths(stiffness=0.0))
        result = lib.solve(batch, guard=strength)
        before = batch.weights[batch.vertices]
        noise = 1e-18 * np.abs(before - result.weights).sum(1)
        assert (terms.gains(problem, before, result.weights) >= -noise).all()
        assert (result.after <= result.before).all()


@pytest.mark.parametrize("slots", SLOTS)
def test_a_guard_keeps_its_poses(slots: int) -> None:
    """The stronger, the less other poses change; without one they change most."""
    rng = np.random.default_rng(40)
    batch = terms.with_guard(cases.make("strokes", 41, lib.scaled(1000), slots), rng, 6)
    problem = terms.stacked(replace(batch, anchor=batch.weights), Strengths(0.0, guard=1.0))
    only_guard = tuple(part[:, 3:] for part in problem)
    moved = [terms.energy(only_guard, lib.solve(batch, guard=g).weights) for g in (0, 0.3, 30)]
    assert moved[2].sum() < 0.1 * moved[1].sum() and moved[1].sum() < moved[0].sum()


@pytest.mark.parametrize("slots", SLOTS)
def test_nothing_asked_gives_the_anchor_back(slots: int) -> None:
    """No target anywhere: w = o, bit for bit. Targets where the anchor is: the same, but for what
    float32 rounds off the targets."""
    rng = np.random.default_rng(42)
    batch, strengths = terms.make("later_strokes", "poses_guard", 43, lib.scaled(500), slots)
    items = len(batch.vertices)
    asked = replace(
        batch,
        strengths=np.zeros(items),
        more=[replace(pose, strengths=np.zeros(items)) for pose in batch.more],
    )
    assert (lib.solve(asked, **strengths.options()).weights == batch.anchor).all()
    shown = terms.with_guard(cases.plain(rng, items, slots), rng, 3)
    assert np.allclose(lib.solve(shown, stiffness=0.05).weights, shown.anchor, 0, 1e-5)


@pytest.mark.parametrize("slots", SLOTS)
@pytest.mark.parametrize("kind", ["poses", "poses_guard", "all"])
def test_far_from_the_origin(kind: str, slots: int) -> None:
    shift = np.array([64.0, -32.0, 16.0])
    batch, strengths = terms.make("strokes", kind, seed=44, count=lib.scaled(60), slots=slots)
    strengths.stiffness = max(strengths.stiffness, 1e-3)
    batch = terms.far_away(batch, shift)
    result = lib.solve(batch, **strengths.options())
    check_rows(batch, result)
    problem = terms.stacked(batch, strengths, from_base=True)
    before = batch.weights[batch.vertices]
    noise = 1e-14 * (1 + strengths.guard) * np.abs(before - result.weights).sum(1)
    assert (terms.gains(problem, before, result.weights) >= -noise).all()
    # A sum's last bit is 70 times as long here as at the origin.
    check_optimum(batch, strengths, result, terms.optimum(batch, problem), 70.0)


@pytest.mark.parametrize("slots", [4, 8])
@pytest.mark.parametrize("kind", ["poses", "guard", "all"])
def test_same_weights_in_any_unit(kind: str, slots: int) -> None:
    """As in test_solver_oracle.py, on a grid that float32 holds in every unit."""
    batch, strengths = terms.make("reachable", kind, seed=45, count=lib.scaled(500), slots=slots)
    strengths.stiffness = max(strengths.stiffness, 1e-3)

    def on_grid(points: np.ndarray, steps: float) -> np.ndarray:
        return np.round(points * steps) / steps

    def in_unit(batch: Batch, unit: float) -> Batch:
        def scaled(matrices: np.ndarray | None) -> np.ndarray | None:
            if matrices is None:
                return None
            return np.concatenate([matrices[..., :3], unit * matrices[..., 3:]], -1)

        return replace(
            batch,
            rest=on_grid(batch.rest, 2.0**10) * unit,
            targets=on_grid(batch.targets, 2.0**14) * unit,
            matrices=scaled(batch.matrices),
            guard=scaled(batch.guard),
            more=[
                lib.Pose(scaled(p.matrices), on_grid(p.targets, 2.0**14) * unit, p.strengths)
                for p in batch.more
            ],
            length=batch.length * unit,
        )

    expected = lib.solve(in_unit(batch, 1.0), **strengths.options()).weights
    for unit in (100.0, 1000.0):
        found = lib.solve(in_unit(batch, unit), **strengths.options()).weights
        assert np.abs(found - expected).max() <= 1e-6


def test_leftovers() -> None:
    for slots in (3, 4, 8):
        for name in ("empty_slots", "locked_vertices"):
            batch, strengths = terms.make(name, "all", 46, lib.scaled(300), slots)
            result = lib.solve(batch, **strengths.options())
            squares, weight = np.zeros(len(result.weights)), np.zeros(len(result.weights))
            for pose in batch.poses():
                carried = batch.carried_by(pose.matrices, batch.joints, np.float64)
                at = (result.weights.astype(float)[..., None] * carried).sum(1)
                omega = 1.0 if pose.strengths is None else pose.strengths
                squares += omega * ((at - pose.targets) ** 2).sum(1)
                weight += omega
            expected = np.sqrt(squares / np.maximum(weight, 1e-30))
            assert np.allclose(result.leftover, expected, 1e-6, 1e-12)


@pytest.mark.parametrize("poses", [1, 2, 32, 64])
def test_pair_factors_against_numpy(poses: int) -> None:
    rng = np.random.default_rng(47)
    matrices = np.array([cases.bent_bones(rng, 12) for _ in range(poses)])
    matrices[:, 5] = matrices[:, 4]  # two bones that always move alike
    matrices[:, 7, :, 3] += 1e-9  # and two that differ by a hair
    matrices[:, 8] = matrices[:, 7]
    matrices[:, 8, 0, 3] += 1e-9
    guard = lib.Guard(matrices)
    for i in range(12):
        for j in range(i + 1, 12):
            factor = guard.factor(i, j)
            stack = (matrices[:, i] - matrices[:, j]).reshape(-1, 4)
            gram = stack.T @ stack / poses
            assert np.allclose(factor.T @ factor, gram, 0, 1e-14 * np.abs(gram).max())
    assert (guard.factor(4, 5) == 0).all()


@pytest.mark.parametrize("slots", [4, 8])
@pytest.mark.parametrize("name", ["strokes", "reachable", "far_targets", "locked_vertices"])
@pytest.mark.parametrize("further", [0, 3])
def test_stiffness_from_leftovers(name: str, slots: int, further: int) -> None:
    rng = np.random.default_rng(48)
    for count in (1, 2, 301, 400):
        batch = cases.make(name, seed=49, count=count, slots=slots)
        batch = terms.with_poses(batch, rng, further)
        left = lib.solve(batch, stiffness=1e-4).leftover
        targets = sum(
            np.ones(count, int) if p.strengths is None else (p.strengths > 0).astype(int)
            for p in batch.poses()
        )
        used = targets > 0
        if batch.vertex_locked is not None:
            used &= batch.vertex_locked == 0
        floor = 1e-4 if used.any() and (targets[used] >= 2).mean() >= 0.5 else 5e-4
        wanted = 2 * np.median(left[used].astype(float)) / batch.length if used.any() else 0
        assert lib.choose_stiffness(batch) == pytest.approx(np.clip(wanted, floor, 0.03), rel=1e-12)
