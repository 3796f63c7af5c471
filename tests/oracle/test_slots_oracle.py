"""Slot filling against brute force, on random skeletons and meshes with fixed seeds."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.spatial

import solver_lib as lib
import solver_slots_oracle as oracle
from solver_lib import Mesh

FILLS = {"hop": lib.HOP, "infect": lib.INFECT, "neighbours": lib.NEIGHBOURS, "none": lib.NONE}


def random_parents(rng: np.random.Generator, bones: int, roots: int) -> np.ndarray:
    """A forest in any order of bones."""
    parents = np.full(bones, -1)
    for bone in range(roots, bones):
        parents[bone] = rng.integers(max(0, bone - 4), bone)
    names = rng.permutation(bones)
    shuffled = np.empty(bones, int)
    shuffled[names] = np.where(parents >= 0, names[parents], -1)
    return shuffled


def random_mesh(seed: int, skins: int = 1) -> Mesh:
    """A triangulated sheet in which each bone has its patch, an island and loose vertices."""
    rng = np.random.default_rng([30, seed])
    count, bones = int(rng.integers(30, 160)), int(rng.integers(5, 24))
    points = rng.uniform(-1, 1, (count, 2))
    neighbours: list[set[int]] = [set() for _ in range(count)]
    sheet = int(0.8 * count)
    for first, end in ((0, sheet), (sheet, count - 3)):
        if end - first > 3:
            for triangle in scipy.spatial.Delaunay(points[first:end]).simplices + first:
                for v in triangle:
                    neighbours[v] |= set(map(int, triangle)) - {int(v)}
    heads = rng.uniform(-1, 1, (bones, 3))
    bone_skin = rng.integers(0, skins, bones)
    bone_skin[:skins] = np.arange(skins)
    vertex_skin = rng.integers(0, skins, count)
    influences = []
    for vertex in range(count):
        mine = np.flatnonzero(bone_skin == vertex_skin[vertex])
        near = mine[np.argsort(((heads[mine, :2] - points[vertex]) ** 2).sum(1))]
        chosen = near[: min(len(near), int(rng.choice([1, 1, 1, 2, 3, 5, 9])))]
        # Few values, so that equal weights are met.
        weights = rng.integers(1, 4, len(chosen)).astype(float)
        order = rng.permutation(len(chosen))
        weights /= weights.sum()
        influences.append({int(chosen[i]): float(weights[i]) for i in order})
    return Mesh(
        rest=np.column_stack([points, np.zeros(count)]),
        influences=influences,
        neighbours=[sorted(n) for n in neighbours],
        parents=random_parents(rng, bones, int(rng.integers(1, 3))),
        heads=heads,
        bone_skin=bone_skin,
        vertex_skin=vertex_skin,
    )


@pytest.mark.parametrize("bones, roots", [(1, 1), (7, 7), (30, 1), (60, 3), (400, 2)])
def test_hops(bones: int, roots: int) -> None:
    for seed in range(4):
        parents = random_parents(np.random.default_rng([31, seed]), bones, roots)
        assert (lib.hops(parents) == oracle.hops(parents)).all()


def test_hops_of_a_long_chain_stop_at_254() -> None:
    parents = np.arange(-1, 599)
    assert (lib.hops(parents) == oracle.hops(parents)).all()
    assert lib.hops(parents)[0, 599] == 254


@pytest.mark.parametrize("skins", [1, 3])
@pytest.mark.parametrize("slots", [1, 2, 4, 8])
@pytest.mark.parametrize("name", FILLS)
def test_fill(name: str, slots: int, skins: int) -> None:
    rng = np.random.default_rng(32)
    for seed in range(lib.scaled(40) // 4):
        mesh = random_mesh(seed, skins)
        joints, weights, report = lib.fill_slots(mesh, slots, FILLS[name])
        assert joints.tolist() == oracle.fill(mesh, slots, FILLS[name])
        check_weights(mesh, joints, weights, slots, report)
        shuffled = replace(mesh, neighbours=[rng.permutation(n).tolist() for n in mesh.neighbours])
        again, _, _ = lib.fill_slots(shuffled, slots, FILLS[name])
        assert (again == joints).all()


def check_weights(
    mesh: Mesh, joints: np.ndarray, weights: np.ndarray, slots: int, report: lib.SlotsReport
) -> None:
    reduced, filled, largest = 0, 0, 0.0
    for row, stored, given in zip(joints, weights, mesh.influences):
        exact = {bone: np.float32(weight) for bone, weight in given.items()}
        kept = sorted(exact, key=lambda bone: (-exact[bone], bone))[:slots]
        filled += int((row[len(kept) :] != lib.EMPTY).sum())
        assert (stored[len(kept) :] == 0).all() and (stored >= 0).all()
        if len(given) <= slots:
            assert stored[: len(kept)].tolist() == [exact[bone] for bone in kept]
            continue
        share = np.array([exact[bone] for bone in kept], float)
        reduced += 1
        largest = max(largest, 1 - share.sum() / sum(float(w) for w in exact.values()))
        assert np.abs(stored - share / share.sum()).max() <= 1e-7
        assert abs(stored.astype(float).sum() - 1) <= 1e-7
    assert (report.reduced_count, report.filled_count) == (reduced, filled)
    assert report.empty_count == int((joints == lib.EMPTY).sum())
    assert report.largest_cut == pytest.approx(largest, rel=1e-6, abs=1e-7)


def test_thesis_example_of_hops() -> None:
    """Chapter 7.5.1 on a chain 0-1-2-3-4 with a side bone 5 on 1: a vertex of bones 1 and 2."""
    mesh = Mesh(
        rest=np.zeros((1, 3)),
        influences=[{1: 0.75, 2: 0.25}],
        neighbours=[[]],
        parents=np.array([-1, 0, 1, 2, 3, 1]),
        heads=np.zeros((6, 3)),
    )
    # Nearness: bone 0 and bone 5 0.75/2 + 0.25/4, bone 3 0.75/4 + 0.25/2, bone 4 half of that.
    joints, weights, _ = lib.fill_slots(mesh, 6, lib.HOP)
    assert joints.tolist() == [[1, 2, 0, 5, 3, 4]]
    assert weights.tolist() == [[0.75, 0.25, 0, 0, 0, 0]]


def test_infection_travels_and_replaces() -> None:
    """A strip of vertices at x = 0..9, bone b's head at x = b, one bone a vertex."""
    x = np.arange(10)
    mesh = Mesh(
        rest=np.column_stack([x, 0 * x, 0 * x]),
        influences=[{int(v): 1.0} for v in x],
        neighbours=[[u for u in (v - 1, v + 1) if 0 <= u < 10] for v in range(10)],
        parents=np.full(10, -1),
        heads=np.column_stack([x, 0 * x, 0 * x]),
    )
    joints, _, _ = lib.fill_slots(mesh, 4, lib.INFECT)
    # The nearest heads, the lower bone first where two are as near.
    assert joints[0].tolist() == [0, 1, 2, 3]
    assert joints[5].tolist() == [5, 4, 6, 3]
    assert joints[9].tolist() == [9, 8, 7, 6]
