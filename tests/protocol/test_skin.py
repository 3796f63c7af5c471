"""core.skin, core.steps and core.rig against loops over single vertices and SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from core import skin, steps
from core.rig import Y_UP, Rig, Space
from core.state import Change, State
from scipy.spatial.transform import Rotation
from tools import same

NONE = skin.NO_BONE


def random_moves(random: np.random.Generator, count: int) -> np.ndarray:
    """Rigid 4x4 matrices, f64 [count,4,4]."""
    moves = np.tile(np.eye(4), (count, 1, 1))
    turns = Rotation.random(count, random_state=int(random.integers(1 << 30)))
    moves[:, :3, :3] = turns.as_matrix()
    moves[:, :3, 3] = random.normal(size=(count, 3))
    return moves


def random_skin(random: np.random.Generator, vertices: int, bones: int, slots: int) -> tuple:
    """Rest positions, and joints and weights with free slots and sums other than one."""
    positions = random.normal(size=(vertices, 3)).astype(np.float32)
    joints = random.integers(0, bones, (vertices, slots)).astype(np.uint16)
    weights = random.random((vertices, slots)).astype(np.float32)
    for row in np.flatnonzero(random.random(vertices) < 0.7):
        free = random.integers(0, slots)
        joints[row, slots - free:], weights[row, slots - free:] = NONE, 0
    return positions, joints, weights


def carry(position: np.ndarray, joints: np.ndarray, weights: np.ndarray, pose: np.ndarray,
          binds: np.ndarray) -> np.ndarray:
    """Where one vertex goes, a bone at a time, as the Armature modifier does it."""
    total = sum(float(weight) for weight in weights)
    if total <= 1e-4:
        return position.astype(np.float64)
    moved = np.zeros(3)
    for joint, weight in zip(joints, weights):
        if joint != NONE:
            at_bone = np.linalg.solve(binds[joint], np.append(position.astype(np.float64), 1))
            moved += float(weight) / total * (pose[joint] @ at_bone)[:3]
    return moved


@pytest.mark.parametrize("slots", [1, 4, 8])
@pytest.mark.parametrize("vertices", [0, 1, 300, skin.AT_ONCE + 1])
def test_blend_is_what_a_loop_makes_of_it(slots, vertices):
    random = np.random.default_rng(slots + vertices)
    positions, joints, weights = random_skin(random, vertices, 7, slots)
    if vertices > 100:
        weights[5] = 0  # stay where they are
        weights[6] = 2e-5 / slots
        joints[7] = NONE
        weights[7] = 0
    binds, pose = random_moves(random, 7), random_moves(random, 7)
    posed = skin.blend(positions, joints, weights, skin.deformations(pose, binds))
    assert posed.shape == (vertices, 3) and posed.dtype == np.float64
    looked_at = {0, 5, 6, 7, vertices - 1, *random.integers(0, max(vertices, 1), 300).tolist()}
    for vertex in sorted(each for each in looked_at if 0 <= each < vertices):
        expected = carry(positions[vertex], joints[vertex], weights[vertex], pose, binds)
        assert np.allclose(posed[vertex], expected, rtol=0, atol=1e-12), vertex


def test_the_rest_pose_is_the_rest_shape():
    random = np.random.default_rng(4)
    positions, joints, weights = random_skin(random, 200, 5, 4)
    binds = random_moves(random, 5)
    posed = skin.blend(positions, joints, weights, skin.deformations(binds, binds))
    assert np.allclose(posed, positions, rtol=0, atol=1e-12)


def test_differing_rows():
    random = np.random.default_rng(7)
    rows = random.random((500, 4)).astype(np.float32)
    others = rows.copy()
    changed = np.sort(random.choice(500, 60, replace=False))
    for row in changed:
        slot = random.integers(4)
        others[row, slot] = np.nextafter(others[row, slot], np.float32(2))
    found = skin.differing(rows, others)
    assert found.dtype == np.uint32 and np.array_equal(found, changed)
    zeros = np.zeros((3, 4), np.float32)
    assert len(skin.differing(zeros, -zeros)) == 0
    assert len(skin.differing(zeros[:0], zeros[:0])) == 0
    assert list(skin.differing(zeros, np.where([[0], [1], [0]], np.nan, zeros))) == [1]


def test_distances():
    random = np.random.default_rng(8)
    points, others = random.normal(size=(2, 50, 3)).astype(np.float32)
    expected = [sum((float(a) - float(b)) ** 2 for a, b in zip(p, o)) ** 0.5
                for p, o in zip(points, others)]
    found = skin.distances(points, others)
    assert found.dtype == np.float32 and np.allclose(found, expected, rtol=1e-6)


# ---- spaces ----


def test_y_up_is_a_quarter_turn():
    turn = Rotation.from_euler("x", -90, degrees=True).as_matrix()
    assert np.allclose(Y_UP[:3, :3], turn, atol=1e-15) and np.array_equal(Y_UP[3], [0, 0, 0, 1])
    # up (z) becomes y; what looks at the viewer (-y) becomes z, as glTF has it
    assert np.allclose(Y_UP @ [0, 0, 1, 1], [0, 1, 0, 1])
    assert np.allclose(Y_UP @ [0, -1, 0, 1], [0, 0, 1, 1])


def make_rig(random: np.random.Generator, positions: np.ndarray, bones: int) -> Rig:
    empty = np.empty(0)
    return Rig(positions, empty, [f"bone{i}" for i in range(bones)], empty,
               random_moves(random, bones), empty, empty, empty, np.zeros(len(positions), bool))


def test_an_own_space_changes_nothing():
    random = np.random.default_rng(1)
    rig = make_rig(random, random.normal(size=(9, 3)).astype(np.float32), 4)
    pose, joints = random_moves(random, 4), np.array([[3, NONE]], np.uint16)
    space = Space(rig)
    assert space.pose(pose) is pose and space.joints(joints) is joints
    assert space.points(rig.positions) is rig.positions


@pytest.mark.parametrize("turn", [np.eye(4), Y_UP], ids=["as it is", "turned"])
def test_a_session_with_other_bones_and_axes_poses_alike(turn):
    """The session has fewer bones, in another order, that point elsewhere at rest."""
    random = np.random.default_rng(2)
    positions, held, weights = random_skin(random, 120, 5, 4)
    rig = make_rig(random, positions, 8)
    order = [6, 0, 3, 7, 2]
    binds = random_moves(random, 5)
    space = Space(rig, [rig.names[bone] for bone in order], np.linalg.inv(binds), turn)
    pose = random_moves(random, 8)
    ours = space.joints(held)
    assert ours.dtype == np.uint16
    for joint, own in zip(held.ravel(), ours.ravel()):
        assert own == (NONE if joint == NONE else order[joint])
    theirs = space.points(positions)
    assert theirs.dtype == np.float32
    their_pose = space.pose(pose)
    assert their_pose.shape == (5, 4, 4) and np.allclose(their_pose[:, 3], [0, 0, 0, 1])
    quarter = np.eye(3) if turn is not Y_UP else Rotation.from_euler("x", -90, True).as_matrix()
    for vertex in range(len(positions)):
        here = carry(positions[vertex], ours[vertex], weights[vertex], pose, rig.binds)
        there = carry(theirs[vertex], held[vertex], weights[vertex], their_pose, binds)
        assert np.allclose(there, quarter @ here, rtol=0, atol=1e-5), vertex


# ---- steps ----


SHAPES = ["pose a", "pose b"]


def random_state(random: np.random.Generator, vertices: int = 40) -> State:
    return State(random.integers(0, 9, (vertices, 4)).astype(np.uint16),
                 random.random((vertices, 4)).astype(np.float32),
                 random.random((vertices, 3)).astype(np.float32))


def random_step(random: np.random.Generator, log: steps.Steps) -> steps.Step:
    """Of weights, and now and then of bones, rest positions and a shape."""
    vertices = random.choice(len(log.state.weights), random.integers(1, 9), replace=False)
    count, extra = len(vertices), random.random(3) < 0.4
    return log.add(Change(
        vertices.astype(np.uint32), random.random((count, 4)).astype(np.float32),
        random.integers(0, 9, (count, 4)).astype(np.uint16) if extra[0] else None,
        random.random((count, 3)).astype(np.float32) if extra[1] else None,
        str(random.choice(SHAPES)) if extra[2] else "",
        random.random((count, 3)).astype(np.float32) if extra[2] else None))


@pytest.mark.parametrize("seed", range(5))
def test_any_state_comes_back_to_the_bit(seed):
    random = np.random.default_rng(seed)
    log = steps.Steps(random_state(random))
    state = log.state
    states = {0: state.copy()}
    parents = {0: -1}
    for _ in range(300):
        if random.random() < 0.5:
            live = log.live
            step = random_step(random, log)
            assert (step.parent, log.live) == (live, step.id) and step.id not in states
            states[step.id], parents[step.id] = state.copy(), live
            continue
        goal = int(random.choice(list(states)))
        start, before = log.live, state.copy()
        undo, redo = log.go(goal)
        assert log.live == goal and same(state, states[goal])
        place = start
        for step in undo:  # a way from one to the next
            assert step.id == place
            place = step.parent
        for step in redo:
            assert step.parent == place
            place = step.id
        assert place == goal and not {step.id for step in undo} & {step.id for step in redo}
        touched = {int(v) for step in undo + redo for v in step.vertices}
        moved = [state.differing(before), *(those for _, those in state.reshaped(before))]
        assert set(np.concatenate(moved).tolist()) <= touched


def test_the_oldest_are_forgotten(monkeypatch):
    random = np.random.default_rng(3)
    log = steps.Steps(random_state(random))
    first = random_step(random, log)
    limit = 4000
    monkeypatch.setattr(steps, "LOG_BYTES_MAX", limit)
    states = {log.live: log.state.copy()}
    kept = [first]
    for _ in range(200):
        kept.append(random_step(random, log))
        states[log.live] = log.state.copy()
    now, live = log.state.copy(), log.live
    assert log.go(first.id) is None and log.go(0) is None and log.go(10 ** 6) is None
    assert log.live == live and same(log.state, now), "nothing was changed"
    reached = 0
    for id in reversed(sorted(states)):
        if log.go(id) is None:
            break
        assert same(log.state, states[id])
        reached += 1
    assert sum(step.bytes for step in kept[-reached + 1:]) <= limit
    assert reached > 5, "what fits is kept"
