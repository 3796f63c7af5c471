"""Slots by brute force: what each fill means, with dictionaries and no thought of speed."""

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

from solver_lib import APART, EMPTY, HOP, INFECT, NEIGHBOURS, NONE, Mesh

RINGS = 8


def hops(parents: np.ndarray) -> np.ndarray:
    """Steps between bones in the forest, which go through the nearest common ancestor."""
    count = len(parents)
    children = np.flatnonzero(parents >= 0)
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(children)), (children, parents[children])), shape=(count, count)
    )
    steps = scipy.sparse.csgraph.shortest_path(graph, directed=False, unweighted=True)
    return np.where(np.isinf(steps), APART, np.minimum(steps, 254)).astype(np.uint8)


def fill(mesh: Mesh, slots: int, rule: int) -> list[list[int]]:
    """The bones of each vertex in the order of its slots, shorter where slots stay empty."""
    own = [
        sorted(row, key=lambda bone: (-np.float32(row[bone]), bone))[:slots]
        for row in mesh.influences
    ]
    rows = [list(bones) for bones in own]
    if rule == INFECT:
        rows = _infect(mesh, own, slots)
    elif rule == NEIGHBOURS:
        rows = [_rings(mesh, vertex, own[vertex], slots) for vertex in range(len(own))]
    if rule != NONE:
        steps = hops(mesh.parents)
        for vertex, row in enumerate(rows):
            _by_hops(mesh, vertex, row, own[vertex], steps, slots)
    return [row + [EMPTY] * (slots - len(row)) for row in rows]


def _same_skin(mesh: Mesh, vertex: int, bone: int) -> bool:
    return mesh.bone_skin is None or mesh.bone_skin[bone] == mesh.vertex_skin[vertex]


def _by_hops(
    mesh: Mesh, vertex: int, row: list[int], own: list[int], steps: np.ndarray, slots: int
) -> None:
    scores = {}
    for bone in range(len(mesh.parents)):
        if bone in row or not _same_skin(mesh, vertex, bone):
            continue
        near = [0.0 if steps[i, bone] == APART else 2.0 ** -int(steps[i, bone]) for i in own]
        weights = [float(np.float32(mesh.influences[vertex][i])) for i in own]
        score = sum(w * n for w, n in zip(weights, near))
        if score > 0:
            scores[bone] = score
    row += sorted(scores, key=lambda bone: (-scores[bone], bone))[: slots - len(row)]


def _rings(mesh: Mesh, vertex: int, own: list[int], slots: int) -> list[int]:
    row, seen, ring = list(own), {vertex}, {vertex}
    for _ in range(RINGS):
        if len(row) >= slots:
            break
        ring = {u for v in ring for u in mesh.neighbours[v]} - seen
        seen |= ring
        totals: dict[int, int] = {}
        for other in ring:
            for bone, weight in mesh.influences[other].items():
                if bone not in row and _same_skin(mesh, vertex, bone):
                    share = 1 + int(float(np.float32(weight)) * 2.0**32)
                    totals[bone] = totals.get(bone, 0) + share
        row += sorted(totals, key=lambda bone: (-totals[bone], bone))[: slots - len(row)]
    return row


def _infect(mesh: Mesh, own: list[list[int]], slots: int) -> list[list[int]]:
    rest = np.asarray(mesh.rest, np.float32).astype(float)
    heads = np.asarray(mesh.heads, np.float32).astype(float)
    borrowed: list[list[int]] = [[] for _ in own]
    while True:
        found = []
        for vertex, bones in enumerate(own):
            offered = set(borrowed[vertex])
            for other in mesh.neighbours[vertex]:
                offered |= set(own[other]) | set(borrowed[other])
            offered = {b for b in offered - set(bones) if _same_skin(mesh, vertex, b)}
            apart = {b: ((rest[vertex] - heads[b]) ** 2).tolist() for b in offered}
            order = sorted(offered, key=lambda b: (sum(apart[b]), b))
            found.append(order[: slots - len(bones)])
        if found == borrowed:
            return [bones + more for bones, more in zip(own, borrowed)]
        borrowed = found
