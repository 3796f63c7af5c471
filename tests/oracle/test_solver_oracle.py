"""The solver against oracles that are not its code: more than 10^5 random and degenerate vertices.

Positions, energies and distances are formed in 80-bit long double from what was stored.
"""

from dataclasses import replace

import numpy as np
import pytest

import solver_cases as cases
import solver_lib as lib
import solver_oracle as oracle
from solver_lib import Batch, Result

STIFFNESSES = [1e-5, 1e-4, 1e-3, 0.008, 0.1]
POSITION_ERROR = 1e-7  # of L
# Long double's own rounding, for a step of weights that sums to one.
ROUNDING = 1e-18


def apart(batch: Batch, found: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Distance between the positions of two sets of weights, over L."""
    gap = oracle.positions(batch, found) - oracle.positions(batch, best)
    return np.sqrt((gap**2).sum(-1)) / batch.length


def check_rows(batch: Batch, result: Result) -> None:
    """What must hold of every row that is stored, whatever it is."""
    before = batch.weights[batch.vertices]
    closed = ~batch.open()
    solved = ~closed.all(1)
    sums = result.weights.astype(np.longdouble).sum(1)
    assert np.isfinite(result.weights).all()
    assert (result.weights >= 0).all()
    assert (np.abs(sums - 1)[solved] <= 1e-7).all()
    assert (result.weights.view(np.uint32) == before.view(np.uint32))[closed].all()
    assert np.allclose(result.before, oracle.distance(batch, before).astype(float), 1e-6, 1e-12)
    after = oracle.distance(batch, result.weights).astype(float)
    assert np.allclose(result.after, after, 1e-6, 1e-12)


def check_guard(batch: Batch, result: Result, kappa: float) -> None:
    """Nothing is worse than it was: the energy always, the distance on a first stroke."""
    before, anchor = batch.weights[batch.vertices], batch.anchor[batch.vertices]
    gained, nearer = oracle.gains(batch, before, result.weights, kappa)
    noise = ROUNDING * np.abs(before - result.weights).sum(1)
    assert (gained >= -noise).all()
    first = (anchor == before).all(1)
    assert (nearer >= -noise)[first].all()
    assert (result.after <= result.before)[first].all()
    # An anchor that differs in a locked slot is not a choice that the stroke has.
    open_to_it = ((anchor == before) | batch.open()).all(1)
    gained, _ = oracle.gains(batch, anchor, result.weights, kappa)
    # A tie between the weights before and the anchor is decided in float64.
    noise = 1e-13 * np.abs(anchor - result.weights).sum(1) * (1 + result.after)
    assert (gained >= -noise)[open_to_it].all()


def check_optimum(batch: Batch, result: Result, best: np.ndarray, kappa: float) -> None:
    """Every position is the optimum's. A row whose stored sum is not quite one may have a lower
    energy than any row on the simplex; then it is not to be given up, but that is very rare."""
    off = apart(batch, result.weights, best) > POSITION_ERROR
    lower = oracle.energy(batch, result.weights, kappa) <= oracle.energy(batch, best, kappa)
    assert not (off & ~lower).any()
    assert off.mean() <= 1e-3


@pytest.mark.parametrize("kappa", STIFFNESSES)
@pytest.mark.parametrize("name", cases.FAMILIES)
def test_four_slots_against_all_faces(name: str, kappa: float) -> None:
    batch = cases.make(name, seed=11, count=lib.scaled(3000), slots=4)
    result = lib.solve(batch, stiffness=kappa)
    check_rows(batch, result)
    check_guard(batch, result, kappa)
    check_optimum(batch, result, oracle.exact(batch, kappa), kappa)


@pytest.mark.parametrize("slots", [1, 2, 3, 5, 6, 8, 11, 16])
@pytest.mark.parametrize("name", cases.FAMILIES)
def test_other_slot_counts_against_nnls(name: str, slots: int) -> None:
    for kappa in STIFFNESSES:
        batch = cases.make(name, seed=12, count=lib.scaled(100), slots=slots)
        result = lib.solve(batch, stiffness=kappa)
        check_rows(batch, result)
        check_guard(batch, result, kappa)
        check_optimum(batch, result, oracle.nearest(batch, kappa), kappa)


@pytest.mark.parametrize("name", cases.FAMILIES)
def test_four_slots_against_nnls(name: str) -> None:
    """The two oracles are independent of each other, too."""
    batch = cases.make(name, seed=13, count=lib.scaled(100), slots=4)
    for kappa in (1e-5, 0.008):
        best = oracle.nearest(batch, kappa)
        assert (apart(batch, oracle.exact(batch, kappa), best) <= 1e-9).all()
        check_optimum(batch, lib.solve(batch, stiffness=kappa), best, kappa)


@pytest.mark.parametrize("name", cases.FAMILIES)
def test_lanes_and_active_set_agree(name: str) -> None:
    """Four slots and an empty fifth go through the other code."""
    batch = cases.make(name, seed=14, count=lib.scaled(2000), slots=4)

    def widened(rows: np.ndarray, fill: float) -> np.ndarray:
        return np.pad(rows, ((0, 0), (0, 1)), constant_values=fill)

    wide = replace(
        batch,
        joints=widened(batch.joints, lib.EMPTY),
        weights=widened(batch.weights, 0),
        anchor=widened(batch.anchor, 0),
    )
    lanes, scalar = lib.solve(batch), lib.solve(wide)
    assert (scalar.weights[:, 4] == 0).all()
    off = apart(batch, lanes.weights, scalar.weights[:, :4]) > POSITION_ERROR
    assert off.mean() <= 1e-3


@pytest.mark.parametrize("name", cases.FAMILIES)
@pytest.mark.parametrize("constraint", [lib.SIMPLEX, lib.AFFINE])
def test_same_bits_for_any_instruction_set_and_chunks(name: str, constraint: int) -> None:
    batch = cases.make(name, seed=15, count=lib.scaled(700), slots=4)
    whole = lib.solve(batch, constraint=constraint)
    for simd in (lib.PLAIN, lib.AVX2, lib.AVX512):
        same_bits(whole, lib.solve(batch, constraint=constraint, simd=simd))
    rng = np.random.default_rng(16)
    order = rng.permutation(len(batch.vertices))
    for size in (1, 3, 16, 61):
        for start in range(0, len(order), size)[: 2000 // size]:
            chunk = order[start : start + size]
            part = lib.solve(batch.part(chunk), constraint=constraint)
            same_bits(part, Result(*(a[chunk] for a in vars(whole).values())))


def same_bits(one: Result, other: Result) -> None:
    for a, b in zip(vars(one).values(), vars(other).values()):
        assert (a.view(np.uint32) == b.view(np.uint32)).all()


# With more bones than directions float64 differences weigh 10^-16 / kappa^2 in the weights, so more
# than four slots keep 1e-6 from kappa = 3e-5 on (3e-6 at 1e-5; positions hold there too).
@pytest.mark.parametrize(
    "slots, kappa",
    [(4, k) for k in STIFFNESSES] + [(8, k) for k in (3e-5, 1e-4, 1e-3, 0.008, 0.1)],
)
@pytest.mark.parametrize("name", ["strokes", "reachable", "later_strokes", "locked_bones"])
def test_same_weights_in_any_unit(name: str, slots: int, kappa: float) -> None:
    """Metres, centimetres, millimetres. Positions lie on a grid that float32 holds in all three,
    or the test would measure how float32 rounds them."""
    batch = cases.make(name, seed=17, count=lib.scaled(1000), slots=slots)
    metres = replace(
        batch,
        rest=(np.round(batch.rest * 2.0**10) / 2**10),
        targets=(np.round(batch.targets * 2.0**14) / 2**14),
    )
    expected = lib.solve(metres, stiffness=kappa).weights
    for unit in (100.0, 1000.0):
        matrices = metres.matrices.copy()
        matrices[:, :, 3] *= unit
        scaled = replace(
            metres,
            rest=metres.rest * np.float32(unit),
            targets=metres.targets * np.float32(unit),
            matrices=matrices,
            length=metres.length * unit,
        )
        found = lib.solve(scaled, stiffness=kappa).weights
        assert np.abs(found - expected).max() <= 1e-6


@pytest.mark.parametrize("slots", [4, 8])
@pytest.mark.parametrize("name", ["rest_pose", "one_rigid_motion"])
def test_equal_bones_give_the_anchor_back(name: str, slots: int) -> None:
    """Where all bones carry the vertex to one point, weights say nothing: w = o, bit for bit."""
    batch = cases.make(name, seed=18, count=lib.scaled(2000), slots=slots)
    assert (lib.solve(batch).weights == batch.anchor).all()
    rng = np.random.default_rng(19)
    rows = np.round(cases.random_weights(rng, len(batch.rest), slots) * 2.0**24) / 2**24
    rows[np.arange(len(rows)), rows.argmax(1)] += 1 - rows.sum(1)
    # Sums that differ would be a reason to differ, so here they are exact.
    anchor = rows.astype(np.float32)
    before = anchor[:, ::-1].copy()
    later = replace(batch, anchor=anchor, weights=before)
    for kappa in STIFFNESSES:
        assert (lib.solve(later, stiffness=kappa).weights == anchor).all()


def test_a_session_of_strokes() -> None:
    """Strokes one after the other: every one holds, and rows stay rows."""
    rng = np.random.default_rng(20)
    batch = cases.make("strokes", seed=20, count=lib.scaled(1500), slots=4)
    for _ in range(10):
        batch.matrices = cases.bent_bones(rng)
        shown = cases.skinned(batch, batch.weights[batch.vertices])
        batch.targets = (shown + rng.normal(0, 0.01, shown.shape)).astype(np.float32)
        result = lib.solve(batch)
        check_rows(batch, result)
        check_guard(batch, result, 0.008)
        check_optimum(batch, result, oracle.exact(batch, 0.008), 0.008)
        batch.weights = result.weights


@pytest.mark.parametrize("slots", [2, 3, 4, 8])
@pytest.mark.parametrize(
    "name", ["strokes", "later_strokes", "empty_slots", "locked_bones", "coincident_pairs"]
)
def test_affine_against_kkt(name: str, slots: int) -> None:
    batch = cases.make(name, seed=21, count=lib.scaled(300), slots=slots)
    negative = 0
    for kappa in (1e-3, 0.008, 0.1):
        result = lib.solve(batch, stiffness=kappa, constraint=lib.AFFINE)
        best = oracle.affine(batch, kappa)
        negative += (result.weights < 0).sum()
        sums = result.weights.astype(np.longdouble).sum(1)
        assert (np.abs(sums - 1)[batch.open().any(1)] <= 1e-7).all()
        closed = ~batch.open()
        assert (result.weights == batch.weights[batch.vertices])[closed].all()
        check_guard(batch, result, kappa)
        # Weights beyond one take float32's larger steps with them.
        size = np.maximum(np.abs(best).max(1), 1)
        off = apart(batch, result.weights, best) > POSITION_ERROR * size
        lower = oracle.energy(batch, result.weights, kappa) <= oracle.energy(batch, best, kappa)
        assert not (off & ~lower).any() and off.mean() <= 1e-2
    assert negative > 0 or name != "strokes"


@pytest.mark.parametrize("unit", [1.0, 100.0])
@pytest.mark.parametrize("k, h", [(0.05, 1.2), (0.5, 10.0)])
def test_thesis_against_its_own_loop(unit: float, k: float, h: float) -> None:
    raw_negative = 0
    for name in ("strokes", "reachable", "far_targets", "scaled_bones", "on_a_grid"):
        batch = cases.make(name, seed=22, count=lib.scaled(1500), slots=4)
        batch = replace(batch, rest=batch.rest * unit, targets=batch.targets * unit)
        batch.matrices[:, :, 3] *= unit
        result = lib.solve(batch, method=lib.THESIS, thesis_k=k, thesis_h=h)
        expected = oracle.thesis(batch, k, h)
        assert (result.weights >= 0).all()
        assert (np.abs(result.weights.astype(float).sum(1) - 1) <= 1e-7).all()
        # Its matrix is singular but for k^2, in squared scene units: what 1 in 10^16 becomes.
        tolerance = 2e-7 + 1e-14 * (unit / k) ** 2
        clear = ~near_a_threshold(batch, k)
        assert (np.abs(result.weights - expected).max(1) <= tolerance)[clear].all()
        assert clear.mean() > 0.9
        raw_negative += (expected == 0).any(1).sum()
        distance = oracle.distance(batch, result.weights).astype(float)
        assert np.allclose(result.after, distance, 1e-6, 1e-9)
    assert raw_negative > 100


def near_a_threshold(batch: Batch, k: float) -> np.ndarray:
    """Where the loop's answer jumps: an unbounded weight within rounding of -epsilon."""
    carried = batch.carried(np.float64)
    edges = carried[:, :3] - carried[:, 3:]
    old = batch.weights[batch.vertices].astype(float)
    matrix = np.einsum("nik,njk->nij", edges, edges) + k * k * (np.eye(3) + 1)
    right = np.einsum("nik,nk->ni", edges, batch.targets - carried[:, 3])
    right += k * k * (old[:, :3] - (old[:, 3:] - 1))
    weights = np.linalg.solve(matrix, right[..., None])[..., 0]
    weights = np.column_stack([weights, 1 - weights.sum(1)])
    return (np.abs(weights + 0.000000012) < 1e-8).any(1)


def test_thesis_leaves_rows_it_does_not_know() -> None:
    for name, slots in (("locked_bones", 4), ("empty_slots", 4), ("locked_vertices", 4),
                        ("strokes", 3), ("strokes", 8)):  # fmt: skip
        batch = cases.make(name, seed=23, count=lib.scaled(500), slots=slots)
        result = lib.solve(batch, method=lib.THESIS)
        whole = batch.open().all(1) & (slots == 4)
        assert (result.weights == batch.weights)[~whole].all()
        assert (result.after == result.before)[~whole].all()
        assert np.allclose(
            result.before, oracle.distance(batch, batch.weights).astype(float), 1e-6, 1e-12
        )


@pytest.mark.parametrize("slots", [1, 4, 8])
def test_skinning(slots: int) -> None:
    batch = cases.make("empty_slots", seed=24, count=lib.scaled(3000), slots=slots)
    expected = oracle.positions(batch, batch.weights)
    # Float64 sums, so all that is lost is the last half step of float32.
    assert np.allclose(lib.skin(batch, batch.weights), expected.astype(np.float32), 1.2e-7, 1e-15)
    some = batch.part(np.arange(len(batch.rest))[::-3])
    assert (lib.skin(some, batch.weights) == lib.skin(batch, batch.weights)[::-3]).all()
