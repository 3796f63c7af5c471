"""Candidates, slots by evidence, reduction, rest offsets and shapes of the C library, and the energy
of solve.h over all bones at once (not over slots) in NumPy."""

import ctypes
from dataclasses import dataclass

import numpy as np
import scipy.optimize

from solver_lib import EMPTY, Batch, Guard, Result, _Call, _lib, _pointer, hops

LISTED = 16
Array = np.ndarray


class _Bones(ctypes.Structure):
    _fields_ = [("bone_count", ctypes.c_int)] + [
        (name, ctypes.c_void_p) for name in ("bone_skin", "vertex_skin", "lists")
    ]


class _Candidates(ctypes.Structure):
    _fields_ = [
        ("vertex_count", ctypes.c_size_t),
        ("slot_count", ctypes.c_int),
        ("bone_count", ctypes.c_int),
    ] + [
        (name, ctypes.c_void_p)
        for name in (
            "hops", "bone_heads", "bone_parents", "bone_skin", "vertex_skin", "rest",
            "start_joints", "start_weights", "neighbour_offsets", "neighbours",
        )
    ] + [("count", ctypes.c_size_t), ("vertices", ctypes.c_void_p)]  # fmt: skip


_lib.skd_candidates_scratch_bytes.restype = ctypes.c_size_t


@dataclass
class Body:
    """What candidates are found by."""

    parents: Array  # [B]
    heads: Array  # [B, 3]
    bone_skin: Array  # [B]
    vertex_skin: Array  # [V]
    rest: Array  # [V, 3]
    joints: Array  # [V, N] at the start
    weights: Array
    neighbours: list[list[int]]


def candidates(body: Body, vertices: Array | None = None) -> Array:
    """skd_candidates_fill: lists [count, 16]."""
    if vertices is None:
        vertices = np.arange(len(body.rest))
    arrays = {
        "hops": hops(body.parents),
        "bone_heads": np.ascontiguousarray(body.heads, np.float32),
        "bone_parents": np.ascontiguousarray(body.parents, np.int32),
        "bone_skin": np.ascontiguousarray(body.bone_skin, np.uint16),
        "vertex_skin": np.ascontiguousarray(body.vertex_skin, np.uint16),
        "rest": np.ascontiguousarray(body.rest, np.float32),
        "start_joints": np.ascontiguousarray(body.joints, np.uint16),
        "start_weights": np.ascontiguousarray(body.weights, np.float32),
        "neighbour_offsets": np.cumsum([0] + [len(row) for row in body.neighbours]).astype(np.uint32),
        "neighbours": np.array([u for row in body.neighbours for u in row], np.uint32),
    }
    vertices = np.ascontiguousarray(vertices, np.uint32)
    count, slots = body.joints.shape
    raw = _Candidates(
        count, slots, len(body.parents), *map(_pointer, arrays.values()), len(vertices), _pointer(vertices)
    )
    scratch = ctypes.create_string_buffer(_lib.skd_candidates_scratch_bytes(ctypes.byref(raw)))
    lists = np.zeros((len(vertices), LISTED), np.uint16)
    _lib.skd_candidates_fill(ctypes.byref(raw), scratch, ctypes.c_void_p(_pointer(lists)))
    return lists


@dataclass
class Evidence:
    joints: Array  # [count, N]
    result: Result


def evidence(
    batch: Batch, lists: Array, bone_skin: Array | None = None, vertex_skin: Array | None = None,
    **options: float,
) -> Evidence:  # fmt: skip
    """skd_evidence_solve; one skin where none is given."""
    call = _Call(batch, options)
    bones = len(batch.matrices)
    bone_skin = np.zeros(bones, np.uint16) if bone_skin is None else bone_skin.astype(np.uint16)
    if vertex_skin is None:
        vertex_skin = np.zeros(len(batch.rest), np.uint16)
    lists = np.ascontiguousarray(lists, np.uint16)
    raw = _Bones(bones, _pointer(bone_skin), _pointer(vertex_skin), _pointer(lists))
    joints = np.zeros((len(batch.vertices), batch.slots), np.uint16)
    _lib.skd_evidence_solve(
        ctypes.byref(call.batch), ctypes.byref(call.options), ctypes.byref(raw),
        ctypes.c_void_p(_pointer(joints)),
    )  # fmt: skip
    return Evidence(joints, call.result)


def reduce(guard: Guard, rest: Array, joints: Array, weights: Array, keep: int) -> Array:
    """skd_reduce of one vertex."""
    rest = np.ascontiguousarray(rest, np.float32)
    joints = np.ascontiguousarray(joints, np.uint16)
    weights = np.ascontiguousarray(weights, np.float32)
    out = np.full(len(joints), np.nan, np.float32)
    _lib.skd_reduce(
        ctypes.c_void_p(_pointer(guard.memory)), ctypes.c_void_p(_pointer(rest)),
        ctypes.c_int(len(joints)), ctypes.c_void_p(_pointer(joints)),
        ctypes.c_void_p(_pointer(weights)), ctypes.c_int(keep), ctypes.c_void_p(_pointer(out)),
    )  # fmt: skip
    return out


def move_rest(batch: Batch, joints: Array, weights: Array, **options: float) -> tuple[Array, Array, Array]:
    """skd_rest_solve: weights, rest, doubtful of the batch's items."""
    call = _Call(batch, options)
    joints = np.ascontiguousarray(joints, np.uint16)
    weights = np.array(weights, np.float32)
    rest = np.ascontiguousarray(batch.rest[batch.vertices])
    doubtful = np.full(len(batch.vertices), 7, np.uint8)
    _lib.skd_rest_solve(
        ctypes.byref(call.batch), ctypes.byref(call.options),
        *(ctypes.c_void_p(_pointer(a)) for a in (joints, weights, rest, doubtful)),
    )  # fmt: skip
    return weights, rest, doubtful


def shape(rest: Array, joints: Array, weights: Array, matrices: Array, targets: Array) -> Array:
    """skd_shape_solve: offsets [count, 3]."""
    arrays = [
        np.ascontiguousarray(rest, np.float32),
        np.ascontiguousarray(joints, np.uint16),
        np.ascontiguousarray(weights, np.float32),
        np.ascontiguousarray(matrices, np.float64),
        np.ascontiguousarray(targets, np.float32),
    ]
    out = np.full(arrays[0].shape, np.nan, np.float32)
    _lib.skd_shape_solve(
        ctypes.c_size_t(len(out)), ctypes.c_int(joints.shape[1]),
        *(ctypes.c_void_p(_pointer(a)) for a in (*arrays, out)),
    )  # fmt: skip
    return out


def by_bone(joints: Array, weights: Array, bones: int) -> Array:
    """Rows [count, N] as weights of all bones, [count, B] float64."""
    dense = np.zeros((len(joints), bones))
    for slot in range(joints.shape[1]):
        has = joints[:, slot] != EMPTY
        np.add.at(dense, (np.flatnonzero(has), joints[has, slot].astype(int)), weights[has, slot])
    return dense


def carried(matrices: Array, rest: Array) -> Array:
    """[B, 3]: a point moved by every bone."""
    return matrices[..., :3] @ rest + matrices[..., 3]


@dataclass
class Squares:
    """The energy of one item as |A w - b|^2 over the weights w of all bones."""

    a: Array  # [rows, B]
    b: Array  # [rows]

    def energy(self, w: Array) -> float:
        return float(((self.a @ w - self.b) ** 2).sum())

    def minimum(self, bones: list[int], mass: float = 1.0) -> Array:
        """The best w >= 0 over these bones with the given sum, by scipy's nnls: a huge row holds the
        sum, and what it leaves is scaled away."""
        huge = 1e5 * max(np.abs(self.a).max(), 1e-9)
        a = np.vstack([self.a[:, bones], np.full((1, len(bones)), huge)])
        x, _ = scipy.optimize.nnls(a, np.append(self.b, huge * mass), maxiter=1000)
        w = np.zeros(self.a.shape[1])
        w[bones] = x * mass / x.sum()
        return w


def squares(batch: Batch, item: int, stiffness: float, guard: float = 0.3, rest: Array | None = None) -> Squares:
    """solve.h's energy of an item, targets + guard + anchor, over all bones."""
    vertex = batch.vertices[item]
    rest = batch.rest[vertex].astype(float) if rest is None else rest
    bones = len(batch.matrices)
    start = (
        (batch.joints, batch.anchor) if batch.start_joints is None else (batch.start_joints, batch.start_weights)
    )
    o = by_bone(start[0][vertex : vertex + 1], start[1][vertex : vertex + 1], bones)[0]
    a, b = [], []
    for pose in batch.poses():
        omega = 1.0 if pose.strengths is None else float(pose.strengths[item])
        a.append(np.sqrt(omega) * carried(pose.matrices, rest).T)
        b.append(np.sqrt(omega) * pose.targets[item].astype(float))
    for matrices in [] if batch.guard is None else batch.guard:
        root = np.sqrt(guard / len(batch.guard))
        a.append(root * carried(matrices, rest).T)
        b.append(a[-1] @ o)
    kappa = max(stiffness, 1e-6) * batch.length
    return Squares(np.vstack([*a, kappa * np.eye(bones)]), np.concatenate([*b, kappa * o]))
