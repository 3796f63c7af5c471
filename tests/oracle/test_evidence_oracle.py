"""Slots by evidence, candidates, reduction, rest offsets and shapes against NumPy and SciPy."""

import itertools

import numpy as np
import pytest

import evidence_lib as ev
import solver_cases as cases
from solver_lib import EMPTY, Batch, Guard, Pose, hops, scaled, solve

Rng = np.random.Generator
BONES, SLOTS, KAPPA = 8, 4, 1e-4


def few_bones(rng: Rng, count: int, poses: int, noise: float = 0.0, bones: int = BONES) -> tuple[Batch, np.ndarray]:
    """Vertices of at most four bones whose start has two of them and two others; the truth [count, B]."""
    rest = rng.uniform(-0.4, 0.4, (count, 3)).astype(np.float32)
    truth = np.zeros((count, bones))
    joints = np.zeros((count, SLOTS), np.uint16)
    weights = np.zeros((count, SLOTS), np.float32)
    for v in range(count):
        order = rng.permutation(bones)
        used = rng.integers(2, SLOTS + 1)
        truth[v, order[:used]] = rng.dirichlet(np.ones(used))
        joints[v] = order[[0, 1, 6, 7]]
        weights[v, :2] = 0.5
    posed = [cases.bent_bones(rng, bones, 40) for _ in range(poses)]
    targets = [
        np.stack([ev.carried(m, p.astype(float)).T @ w for p, w in zip(rest, truth)])
        + noise * rng.normal(size=(count, 3))
        for m in posed
    ]
    more = [Pose(m, t) for m, t in zip(posed[1:], targets[1:])]
    return Batch(rest, joints, weights, posed[0], targets[0], more=more), truth


def all_listed(batch: Batch) -> np.ndarray:
    """Every bone as a candidate: the start's first, then by number."""
    lists = np.full((len(batch.vertices), ev.LISTED), EMPTY, np.uint16)
    for item, vertex in enumerate(batch.vertices):
        own = [int(b) for b, w in zip(batch.joints[vertex], batch.weights[vertex]) if w > 0]
        order = own + [b for b in range(len(batch.matrices)) if b not in own]
        lists[item, : len(order)] = order
    return lists


def energies(batch: Batch, joints: np.ndarray, weights: np.ndarray) -> np.ndarray:
    dense = ev.by_bone(joints, weights, len(batch.matrices))
    return np.array([ev.squares(batch, i, KAPPA).energy(w) for i, w in enumerate(dense)])


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_elimination_against_all_subsets(noise: float) -> None:
    """Of 70 sets of four bones the one found is the best, or nearly always as good."""
    rng = np.random.default_rng(4)
    count = scaled(300)
    batch, _ = few_bones(rng, count, 3, noise)
    found = ev.evidence(batch, all_listed(batch), stiffness=KAPPA)
    got = energies(batch, found.joints, found.result.weights)
    best = np.empty(count)
    for item in range(count):
        squares = ev.squares(batch, item, KAPPA)
        best[item] = min(
            squares.energy(squares.minimum(list(subset)))
            for subset in itertools.combinations(range(BONES), SLOTS)
        )
    # The rank prior is worth 3e-7 at most, and is not part of what is compared.
    assert (got >= best - 1e-9).all()
    assert np.mean(got <= 1.02 * best + 3e-7) >= 0.95
    assert np.mean(got) <= 1.1 * np.mean(best) + 3e-7


def test_true_bones_are_found() -> None:
    """Clean targets in four bent poses, two true bones missing at the start."""
    batch, truth = few_bones(np.random.default_rng(5), scaled(400), 4)
    found = ev.evidence(batch, all_listed(batch), stiffness=KAPPA)
    dense = ev.by_bone(found.joints, found.result.weights, BONES)
    off = np.abs(dense - truth).max(1)
    assert np.median(off) < 1e-5 and np.mean(off < 1e-3) >= 0.98


@pytest.mark.parametrize("poses", [1, 2, 4])
@pytest.mark.parametrize("stiffness", [1e-4, 0.008])
def test_never_above_the_plain_solve(poses: int, stiffness: float) -> None:
    """With a guard, strengths and locks, the energy is never higher; what is locked stays."""
    rng = np.random.default_rng(6 + poses)
    count = scaled(600)
    batch, _ = few_bones(rng, count, poses, 0.01)
    batch.guard = np.stack([cases.bent_bones(rng, BONES, 30) for _ in range(3)])
    batch.bone_locked = np.array([0, 0, 1, 0, 0, 1, 0, 0], np.uint8)
    batch.vertex_locked = (rng.random(count) < 0.1).astype(np.uint8)
    for pose in batch.more:
        pose.strengths = rng.choice([0.0, 0.5, 2.0], count).astype(np.float32)
    plain = solve(batch, stiffness=stiffness)
    found = ev.evidence(batch, all_listed(batch), stiffness=stiffness)
    joints, weights = found.joints, found.result.weights
    for item in range(count):
        squares = ev.squares(batch, item, stiffness)
        rows = ev.by_bone(np.stack([batch.joints[item], joints[item]]), np.stack([plain.weights[item], weights[item]]), BONES)
        assert squares.energy(rows[1]) <= squares.energy(rows[0]) + 1e-12
        used = joints[item][joints[item] != EMPTY]
        assert len(set(used)) == len(used)
        held = np.isin(batch.joints[item], [2, 5])
        assert (joints[item][held] == batch.joints[item][held]).all()
        assert (weights[item][held] == batch.weights[item][held]).all()
        assert not np.isin(used, [2, 5]).sum() > held.sum(), "a locked bone came in"
        if batch.vertex_locked[item] or (joints[item] == batch.joints[item]).all():
            assert (weights[item] == plain.weights[item]).all()
    assert np.abs(weights.astype(float).sum(1) - 1).max() <= 1e-7 and (weights >= 0).all()
    assert (joints != batch.joints).any(), "nothing was tested"


def test_any_split_gives_the_same_bits() -> None:
    batch, _ = few_bones(np.random.default_rng(9), 64, 4, 0.002)
    lists = all_listed(batch)
    whole = ev.evidence(batch, lists, stiffness=KAPPA)
    for chosen in (np.arange(0, 64, 3), np.arange(63, -1, -1)):
        part = ev.evidence(batch.part(chosen), lists[chosen], stiffness=KAPPA)
        assert (part.joints == whole.joints[chosen]).all()
        assert part.result.weights.tobytes() == whole.result.weights[chosen].tobytes()
        assert part.result.leftover.tobytes() == whole.result.leftover[chosen].tobytes()


def test_short_lists_and_other_skins() -> None:
    """Without candidates the plain solve comes back; other skins' bones never come in."""
    batch, _ = few_bones(np.random.default_rng(10), 100, 4, bones=20)
    plain = solve(batch, stiffness=KAPPA)
    lists = np.full((100, ev.LISTED), EMPTY, np.uint16)
    other = np.ones(20, np.uint16)
    alone = ev.evidence(batch, lists, bone_skin=other, stiffness=KAPPA)
    assert (alone.joints == batch.joints).all()
    assert alone.result.weights.tobytes() == plain.weights.tobytes()
    half = (np.arange(20) >= 10).astype(np.uint16)
    own = np.full((100, ev.LISTED), EMPTY, np.uint16)
    own[:, :2] = batch.joints[:, :2]
    found = ev.evidence(batch, own, bone_skin=half, stiffness=KAPPA)
    new = found.joints[(found.joints != EMPTY) & ~(found.joints[:, :, None] == batch.joints[:, None]).any(2)]
    assert len(new) > 0 and (new < 10).all()


def chain(rng: Rng, rows: int, bones: int) -> ev.Body:
    """A strip of vertices along a chain of bones, one bone a vertex; random links across."""
    rest = np.column_stack([np.linspace(0, bones, rows), 0.1 * rng.normal(size=(rows, 2))])
    links = [{i - 1, i + 1} & set(range(rows)) for i in range(rows)]
    for a, b in rng.integers(0, rows, (rows // 4, 2)):
        if a != b:
            links[a].add(int(b))
            links[b].add(int(a))
    heads = np.column_stack([np.arange(bones), np.zeros((bones, 2))])
    joints = np.full((rows, SLOTS), EMPTY, np.uint16)
    weights = np.zeros((rows, SLOTS), np.float32)
    for v in range(rows):
        used = rng.integers(1, 4)
        joints[v, :used] = rng.choice(bones, used, replace=False)
        weights[v, :used] = rng.dirichlet(np.ones(used))
    skin = np.zeros(max(rows, bones), np.uint16)
    return ev.Body(
        np.arange(-1, bones - 1), heads, skin[:bones], skin[:rows], rest, joints, weights,
        [sorted(row) for row in links],
    )  # fmt: skip


def rankings(body: ev.Body, vertex: int, diffused: np.ndarray) -> list[np.ndarray]:
    """The three rankings of a vertex as scores over bones; -inf: not ranked."""
    point, bones = body.rest[vertex].astype(np.float32).astype(float), len(body.parents)
    heads = body.heads.astype(np.float32).astype(float)
    near = np.full(bones, np.inf)
    for bone in range(bones):
        children = np.flatnonzero(body.parents == bone)
        for end in heads[children] if len(children) else heads[[bone]]:
            way = end - heads[bone]
            share = np.clip((point - heads[bone]) @ way / (way @ way), 0, 1) if way.any() else 0
            near[bone] = min(near[bone], np.linalg.norm(point - heads[bone] - share * way))
    table = hops(body.parents).astype(float)
    own = body.joints[vertex] != EMPTY
    close = (body.weights[vertex, own, None].astype(float) * 2.0 ** -table[body.joints[vertex, own]]).sum(0)
    return [np.where(diffused > 0, diffused, -np.inf), -near, close]


def test_candidates_against_numpy() -> None:
    """Own bones by weight, then the three rankings in turn; near ties may stand in either order."""
    body = chain(np.random.default_rng(11), 60, 12)
    dense = ev.by_bone(body.joints, body.weights, 12)
    for _ in range(8):
        dense = np.stack([(dense[v] + dense[row].sum(0)) / (1 + len(row)) for v, row in enumerate(body.neighbours)])
    lists = ev.candidates(body)
    for v in range(60):
        scores = rankings(body, v, dense[v])
        own = [int(b) for b in body.joints[v][np.argsort(-body.weights[v], kind="stable")] if b != EMPTY]
        listed = [int(b) for b in lists[v] if b != EMPTY]
        assert listed[: len(own)] == own and len(set(listed)) == len(listed) == 12
        turn = 0
        for at in range(len(own), 12):
            open_bones = [b for b in range(12) if b not in listed[:at]]
            while not np.isfinite(scores[turn % 3][open_bones]).any():
                turn += 1
            score = scores[turn % 3]
            assert score[listed[at]] >= score[open_bones].max() - 1e-5 * abs(score[open_bones].max())
            turn += 1


def test_candidates_of_a_part_and_of_twins() -> None:
    """A part of the mesh gets the lists of the whole; twins at a seam get equal ones; skins are kept apart."""
    body = chain(np.random.default_rng(12), 80, 30)
    whole = ev.candidates(body)
    for chosen in (np.array([40]), np.arange(5, 20), np.arange(79, 0, -7)):
        assert (ev.candidates(body, chosen) == whole[chosen]).all()
    twin = ev.Body(
        body.parents, body.heads, body.bone_skin, np.append(body.vertex_skin, 0),
        np.vstack([body.rest, body.rest[17]]), np.vstack([body.joints, body.joints[17]]),
        np.vstack([body.weights, body.weights[17]]), [*body.neighbours, body.neighbours[17]],
    )  # fmt: skip
    assert (ev.candidates(twin, np.array([80])) == ev.candidates(twin, np.array([17]))).all()
    body.bone_skin = (np.arange(30) % 2).astype(np.uint16)
    body.joints[:, 0], body.joints[:, 1:] = 0, EMPTY
    body.weights[:, 0], body.weights[:, 1:] = 1, 0
    lists = ev.candidates(body)
    assert (lists[lists != EMPTY] % 2 == 0).all() and (lists[:, :15] != EMPTY).all()


def test_reduction_against_all_subsets() -> None:
    """The posed error of the four kept, against every choice of four, and against the largest four."""
    rng = np.random.default_rng(13)
    poses = np.stack([cases.bent_bones(rng, BONES, 40) for _ in range(6)])
    guard = Guard(poses)
    errors = []
    for _ in range(scaled(150)):
        rest = rng.uniform(-0.4, 0.4, 3).astype(np.float32)
        weights = rng.dirichlet(np.ones(7)).astype(np.float32)
        joints = rng.permutation(BONES)[:7]
        d = np.stack([ev.carried(m, rest.astype(float)) for m in poses])[:, joints]  # [Q, 7, 3]
        a = d.transpose(0, 2, 1).reshape(-1, 7)
        squares = ev.Squares(a, a @ weights)
        kept = ev.reduce(guard, rest, joints, weights, 4)
        assert (kept > 0).sum() <= 4 and abs(kept.sum() - 1) < 1e-6 and (kept >= 0).all()
        largest = np.where(np.argsort(np.argsort(-weights)) < 4, weights, 0)
        best = min(squares.energy(squares.minimum(list(s))) for s in itertools.combinations(range(7), 4))
        errors.append([squares.energy(kept), best, squares.energy(largest / largest.sum())])
    got, best, largest = np.array(errors).T
    assert (got >= best - 1e-9).all() and (got <= largest + 1e-9).all()
    assert np.mean(got <= 1.01 * best + 1e-9) >= 0.9 and got.mean() <= 1.05 * best.mean()


def rest_energy(batch: Batch, item: int, w: np.ndarray, rest: np.ndarray) -> float:
    origin = batch.rest[batch.vertices[item]].astype(float)
    squares = ev.squares(batch, item, KAPPA, rest=rest)
    return squares.energy(w) + 1e-6 * len(batch.poses()) * float(((rest - origin) ** 2).sum())


def test_rest_offsets_against_scipy() -> None:
    """Never above the weights alone; and SciPy, started from where it ended, finds little more."""
    import scipy.optimize

    rng = np.random.default_rng(14)
    count = scaled(60)
    batch, truth = few_bones(rng, count, 4)
    moved = batch.rest + 0.02 * rng.normal(size=batch.rest.shape)
    for pose in [batch, *batch.more]:
        pose.targets = np.stack(
            [ev.carried(pose.matrices, v).T @ w for v, w in zip(moved, truth)]
        ).astype(np.float32)
    batch.joints = np.argsort(-truth, 1)[:, :SLOTS].astype(np.uint16)
    batch.weights = np.full((count, SLOTS), 0.25, np.float32)
    batch.anchor = batch.weights
    plain = solve(batch, stiffness=KAPPA)
    weights, rest, doubtful = ev.move_rest(batch, batch.joints, plain.weights, stiffness=KAPPA)
    alone = ev.by_bone(batch.joints, plain.weights, BONES)
    dense = ev.by_bone(batch.joints, weights, BONES)
    for item in range(count):
        before = rest_energy(batch, item, alone[item], batch.rest[item].astype(float))
        after = rest_energy(batch, item, dense[item], rest[item].astype(float))
        assert after <= before * (1 + 1e-9)
        slots = batch.joints[item].astype(int)

        def free(x: np.ndarray) -> float:
            w = np.zeros(BONES)
            w[slots] = np.abs(x[:4]) / np.abs(x[:4]).sum()
            return 1e6 * rest_energy(batch, item, w, x[4:])

        begin = np.append(weights[item].astype(float), rest[item].astype(float))
        found = scipy.optimize.minimize(free, begin, method="Nelder-Mead", options={"maxiter": 2000, "xatol": 1e-9})
        assert after <= 1e-6 * found.fun + 0.02 * (before - 1e-6 * found.fun)
    assert np.linalg.norm(rest - moved, axis=1).mean() < 0.2 * np.linalg.norm(batch.rest - moved, axis=1).mean()
    assert np.abs(weights.astype(float).sum(1) - 1).max() <= 1e-7 and (weights >= 0).all()
    assert set(doubtful) == {0}


def test_rest_says_when_poses_tell_too_little() -> None:
    """One target: nothing moves. Two, or poses that are alike: said so."""
    rng = np.random.default_rng(15)
    batch, _ = few_bones(rng, 40, 4, 0.01)
    single = Batch(batch.rest, batch.joints, batch.weights, batch.matrices, batch.targets)
    weights, rest, doubtful = ev.move_rest(single, single.joints, single.weights, stiffness=KAPPA)
    assert weights.tobytes() == single.weights.tobytes() and rest.tobytes() == single.rest.tobytes()
    assert not doubtful.any()
    two = Batch(batch.rest, batch.joints, batch.weights, batch.matrices, batch.targets, more=batch.more[:1])
    _, rest, doubtful = ev.move_rest(two, two.joints, two.weights, stiffness=KAPPA)
    assert doubtful[(rest != two.rest).any(1)].all() and doubtful.any()
    same = [Pose(batch.matrices, batch.targets + 0.001 * rng.normal(size=batch.targets.shape)) for _ in range(3)]
    alike = Batch(batch.rest, batch.joints, batch.weights, batch.matrices, batch.targets, more=same)
    weights, rest, doubtful = ev.move_rest(alike, alike.joints, alike.weights, stiffness=KAPPA)
    blended = (weights > 0).sum(1) > 1
    assert doubtful[blended & (rest != alike.rest).any(1)].all() and doubtful.any()


def test_shapes_against_a_linear_solve() -> None:
    rng = np.random.default_rng(16)
    batch, truth = few_bones(rng, 200, 1)
    joints, weights = batch.joints, rng.dirichlet(np.ones(SLOTS), 200).astype(np.float32)
    targets = batch.targets + 0.05 * rng.normal(size=(200, 3)).astype(np.float32)
    offsets = ev.shape(batch.rest, joints, weights, batch.matrices, targets)
    blends = np.einsum("vk,vkij->vij", weights.astype(float), batch.matrices[joints.astype(int)])
    missing = targets - (np.einsum("vij,vj->vi", blends[..., :3], batch.rest) + blends[..., 3])
    exact = np.linalg.solve(blends[..., :3], missing)
    well = np.linalg.cond(blends[..., :3]) < 20
    assert well.sum() > 150
    assert np.abs(offsets - exact)[well].max() < 2e-6


def test_shapes_of_a_collapsed_blend() -> None:
    """Half a turn between two equal weights flattens everything to the axis: the offset stays within
    reach, and does what can be done along the axis."""
    turn = np.zeros((2, 3, 4))
    turn[0, :, :3], turn[1, :, :3] = np.eye(3), np.diag([-1.0, -1.0, 1.0])
    rest, target = np.array([[0.3, 0.2, 0.1]]), np.array([[0.5, 0.0, 0.4]])
    offset = ev.shape(rest, np.array([[0, 1]]), np.array([[0.5, 0.5]]), turn, target)
    assert np.abs(offset - [[0, 0, 0.3]]).max() < 1e-6
    almost = turn.copy()
    angle = np.pi - 1e-3
    almost[1, :2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    near = ev.shape(rest, np.array([[0, 1]]), np.array([[0.5, 0.5]]), almost, target)
    assert np.isfinite(near).all() and np.abs(near).max() < 30
