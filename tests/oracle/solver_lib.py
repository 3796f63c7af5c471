"""The solver's C functions for Python tests, through libskd_solver_test.so and ctypes."""

import ctypes
import os
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

import solver_build

EMPTY = 0xFFFF
APART = 0xFF
EXACT, THESIS = 0, 1
SIMPLEX, AFFINE = 0, 1
AUTO, PLAIN, AVX2, AVX512 = 0, 1, 2, 3
HOP, INFECT, NEIGHBOURS, NONE = 0, 1, 2, 3

# Sanitizer builds run fewer cases.
QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")


def scaled(count: int) -> int:
    """How many cases to run where a release build runs `count`."""
    return max(count // 20, 40) if QUICK else count


class _Options(ctypes.Structure):
    _fields_ = [
        ("method", ctypes.c_int),
        ("constraint", ctypes.c_int),
        ("simd", ctypes.c_int),
        ("stiffness", ctypes.c_double),
        ("length", ctypes.c_double),
        ("thesis_k", ctypes.c_double),
        ("thesis_h", ctypes.c_double),
    ]


class _Batch(ctypes.Structure):
    _fields_ = [("count", ctypes.c_size_t), ("slot_count", ctypes.c_int)] + [
        (name, ctypes.c_void_p)
        for name in (
            "vertices", "targets", "rest", "joints", "weights", "anchor", "vertex_locked",
            "bone_locked", "matrices", "weights_out", "residual_before", "residual_after",
        )
    ]  # fmt: skip


class _SlotsInput(ctypes.Structure):
    _fields_ = [
        ("vertex_count", ctypes.c_size_t),
        ("slot_count", ctypes.c_int),
        ("fill", ctypes.c_int),
        ("bone_count", ctypes.c_int),
    ] + [
        (name, ctypes.c_void_p)
        for name in (
            "hops", "bone_heads", "bone_skin", "vertex_skin", "rest", "influence_offsets",
            "influence_joints", "influence_weights", "neighbour_offsets", "neighbours",
        )
    ]  # fmt: skip


class SlotsReport(ctypes.Structure):
    _fields_ = [
        ("reduced_count", ctypes.c_size_t),
        ("filled_count", ctypes.c_size_t),
        ("empty_count", ctypes.c_size_t),
        ("largest_cut", ctypes.c_float),
    ]


def _load() -> ctypes.CDLL:
    if solver_build.missing_runtime():
        pytest.skip("runs inside test_solver_sanitized.py", allow_module_level=True)
    lib = ctypes.CDLL(str(solver_build.LIBRARY))
    lib.skd_solve_defaults.restype = _Options
    lib.skd_slots_scratch_bytes.restype = ctypes.c_size_t
    return lib


_lib = _load()


def _pointer(array: np.ndarray | None) -> int | None:
    return None if array is None else array.ctypes.data


@dataclass
class Batch:
    """A batch of vertices; arrays as struct skd_solve_batch has them, checked for type."""

    rest: np.ndarray  # [V, 3] float32
    joints: np.ndarray  # [V, N] uint16
    weights: np.ndarray  # [V, N] float32
    matrices: np.ndarray  # [B, 3, 4] float64
    targets: np.ndarray  # [count, 3] float32
    anchor: np.ndarray | None = None  # [V, N], the weights if None
    vertices: np.ndarray | None = None  # [count], all if None
    vertex_locked: np.ndarray | None = None
    bone_locked: np.ndarray | None = None
    length: float = 1.0
    name: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        self.rest = np.ascontiguousarray(self.rest, np.float32)
        self.joints = np.ascontiguousarray(self.joints, np.uint16)
        self.weights = np.ascontiguousarray(self.weights, np.float32)
        self.matrices = np.ascontiguousarray(self.matrices, np.float64).reshape(-1, 3, 4)
        self.targets = np.ascontiguousarray(self.targets, np.float32)
        if self.anchor is None:
            self.anchor = self.weights
        self.anchor = np.ascontiguousarray(self.anchor, np.float32)
        if self.vertices is None:
            self.vertices = np.arange(len(self.rest))
        self.vertices = np.ascontiguousarray(self.vertices, np.uint32)
        for name in ("vertex_locked", "bone_locked"):
            if getattr(self, name) is not None:
                setattr(self, name, np.ascontiguousarray(getattr(self, name), np.uint8))

    @property
    def slots(self) -> int:
        return self.joints.shape[1]

    def part(self, chosen: np.ndarray) -> "Batch":
        """The same session with only some items of the batch."""
        return replace(self, vertices=self.vertices[chosen], targets=self.targets[chosen])

    def carried(self, dtype: type = np.longdouble) -> np.ndarray:
        """d_i of every item and slot, [count, N, 3]; an empty slot's is not to be used."""
        rest = self.rest[self.vertices].astype(dtype)
        joints = self.joints[self.vertices].astype(int)
        matrices = self.matrices.astype(dtype)[np.where(joints == EMPTY, 0, joints)]
        return (matrices[..., :3] * rest[:, None, None, :]).sum(-1) + matrices[..., 3]

    def open(self) -> np.ndarray:
        """Which slots of each item may change, [count, N] bool."""
        joints = self.joints[self.vertices]
        free = joints != EMPTY
        if self.bone_locked is not None:
            free &= self.bone_locked[np.where(joints == EMPTY, 0, joints)] == 0
        if self.vertex_locked is not None:
            free &= (self.vertex_locked[self.vertices] == 0)[:, None]
        return free


@dataclass
class Result:
    weights: np.ndarray  # [count, N] float32
    before: np.ndarray  # [count] float32
    after: np.ndarray


def solve(batch: Batch, **options: float) -> Result:
    """skd_solve with the default options but for those named."""
    chosen = _lib.skd_solve_defaults()
    chosen.length = batch.length
    for name, value in options.items():
        setattr(chosen, name, value)
    count = len(batch.vertices)
    result = Result(
        np.full((count, batch.slots), np.nan, np.float32),
        np.full(count, np.nan, np.float32),
        np.full(count, np.nan, np.float32),
    )
    raw = _Batch(count=count, slot_count=batch.slots)
    for name in ("vertices", "targets", "rest", "joints", "weights", "anchor", "vertex_locked",
                 "bone_locked", "matrices"):  # fmt: skip
        setattr(raw, name, _pointer(getattr(batch, name)))
    raw.weights_out = _pointer(result.weights)
    raw.residual_before = _pointer(result.before)
    raw.residual_after = _pointer(result.after)
    _lib.skd_solve(ctypes.byref(raw), ctypes.byref(chosen))
    return result


def skin(batch: Batch, weights: np.ndarray) -> np.ndarray:
    """skd_skin of all the batch's items with the given [V, N] weights."""
    weights = np.ascontiguousarray(weights, np.float32)
    out = np.empty((len(batch.vertices), 3), np.float32)
    _lib.skd_skin(
        ctypes.c_size_t(len(batch.vertices)),
        ctypes.c_void_p(_pointer(batch.vertices)),
        ctypes.c_int(batch.slots),
        *(
            ctypes.c_void_p(_pointer(a))
            for a in (batch.rest, batch.joints, weights, batch.matrices, out)
        ),
    )
    return out


def hops(parents: np.ndarray) -> np.ndarray:
    """skd_hops_build: [B, B] uint8."""
    parents = np.ascontiguousarray(parents, np.int32)
    out = np.empty((len(parents), len(parents)), np.uint8)
    _lib.skd_hops_build(
        ctypes.c_int(len(parents)),
        ctypes.c_void_p(_pointer(parents)),
        ctypes.c_void_p(_pointer(out)),
    )
    return out


@dataclass
class Mesh:
    """What skd_slots_fill reads, as lists that a test can make by hand."""

    rest: np.ndarray  # [V, 3]
    influences: list[dict[int, float]]  # bone -> weight, in the file's order
    neighbours: list[list[int]]
    parents: np.ndarray  # [B]
    heads: np.ndarray  # [B, 3]
    bone_skin: np.ndarray | None = None
    vertex_skin: np.ndarray | None = None


def fill_slots(
    mesh: Mesh, slots: int, fill: int
) -> tuple[np.ndarray, np.ndarray, SlotsReport]:
    """skd_slots_fill: joints, weights, report."""
    count, bones = len(mesh.rest), len(mesh.parents)

    def offsets(rows: list) -> np.ndarray:
        return np.cumsum([0] + [len(row) for row in rows]).astype(np.uint32)

    zeros = np.zeros(max(count, bones), np.uint16)
    arrays = {
        "hops": hops(mesh.parents),
        "bone_heads": np.ascontiguousarray(mesh.heads, np.float32),
        "bone_skin": zeros if mesh.bone_skin is None else mesh.bone_skin.astype(np.uint16),
        "vertex_skin": zeros if mesh.vertex_skin is None else mesh.vertex_skin.astype(np.uint16),
        "rest": np.ascontiguousarray(mesh.rest, np.float32),
        "influence_offsets": offsets(mesh.influences),
        "influence_joints": np.array([b for row in mesh.influences for b in row], np.uint16),
        "influence_weights": np.array(
            [w for row in mesh.influences for w in row.values()], np.float32
        ),
        "neighbour_offsets": offsets(mesh.neighbours),
        "neighbours": np.array([u for row in mesh.neighbours for u in row], np.uint32),
    }
    raw = _SlotsInput(count, slots, fill, bones, *(_pointer(a) for a in arrays.values()))
    scratch = ctypes.create_string_buffer(_lib.skd_slots_scratch_bytes(ctypes.byref(raw)) or 1)
    joints = np.zeros((count, slots), np.uint16)
    weights = np.full((count, slots), np.nan, np.float32)
    report = SlotsReport()
    _lib.skd_slots_fill(
        ctypes.byref(raw), scratch, ctypes.c_void_p(_pointer(joints)),
        ctypes.c_void_p(_pointer(weights)), ctypes.byref(report),
    )  # fmt: skip
    return joints, weights, report
