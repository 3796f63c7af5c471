"""The thesis's loop (chapter 7.6), as the baseline for what a stroke costs Blender's main thread.

Written anew after its description, with its structure kept: a pass over all vertices in Python,
matrices by vertex group and bone, a 3x3 system of mathutils a changed vertex, one call of
`VertexGroup.add` a weight.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix, Vector

K, H, EPSILON = 0.05, 1.2, 1.2e-8
ONES = Matrix(((1, 1, 1),) * 3)


class Quadratic:
    """w A w + b w; a constant has no part in where it is least."""

    def __init__(self, A: Matrix, b: Vector) -> None:
        self.A, self.b = A, b

    def __add__(self, other: "Quadratic") -> "Quadratic":
        return Quadratic(self.A + other.A, self.b + other.b)

    def least(self) -> Vector:
        w = -0.5 * (self.A.inverted() @ self.b)
        return Vector((w.x, w.y, w.z, 1 - w.x - w.y - w.z))


def penalty(slot: int) -> Quadratic:
    """What pulls one weight to zero."""
    if slot == 3:
        return Quadratic(ONES * H, Vector((-2, -2, -2)) * H)
    A = Matrix(((0, 0, 0),) * 3)
    A[slot][slot] = H
    return Quadratic(A, Vector((0, 0, 0)))


def normalised(w: Vector) -> Vector:
    low, high = min(0, *w), max(1, *w)
    scaled = [(value - low) / (high - low) for value in w]
    return Vector([value / sum(scaled) for value in scaled])


def solve(points: list[Vector], target: Vector, old: Vector) -> Vector:
    T = Matrix([points[slot] - points[3] for slot in range(3)]).transposed()
    aside = target - points[3]
    total = Quadratic(T.transposed() @ T, -2 * (T.transposed() @ aside))
    total += Quadratic(K * K * Matrix.Identity(3), -2 * K * K * old.to_3d())
    total += Quadratic(K * K * ONES, 2 * K * K * (old.w - 1) * Vector((1, 1, 1)))
    w = total.least()
    for slot in range(4):
        if w[slot] < -EPSILON:
            total += penalty(slot)
            w = total.least()
    return normalised(w)


def stroke(thing: bpy.types.Object, armature: bpy.types.Object, before: np.ndarray) -> int:
    """What the thesis's tool does when the button is released; returns the changed vertices."""
    vertices_before = [Vector(position) for position in before.tolist()]
    changed = 0
    for v in thing.data.vertices:
        # All of this for every vertex, changed or not: so it stands there.
        rest, sculpted = vertices_before[v.index].copy(), v.co.copy()
        old = Vector([member.weight for member in v.groups])
        to_rests, to_poses, matrices = [], [], []
        blended = Matrix(((0, 0, 0, 0),) * 4)
        for member in v.groups:
            name = thing.vertex_groups[member.group].name
            to_rests.append(armature.data.bones[name].matrix_local.copy())
            to_poses.append(armature.pose.bones[name].matrix.copy())
            matrices.append(to_poses[-1] @ to_rests[-1].inverted())
            blended += member.weight * matrices[-1]
        _, target = blended @ rest, blended @ sculpted
        if (sculpted - rest).magnitude != 0:
            changed += 1
            v.co = rest
            new = solve([matrix @ rest for matrix in matrices], target, old)
            for slot, member in enumerate(v.groups):
                name = thing.vertex_groups[member.group].name
                thing.vertex_groups[name].add([v.index], new[slot], "REPLACE")
    return changed
