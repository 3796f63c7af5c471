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
        ("guard", ctypes.c_double),
        ("smooth", ctypes.c_double),
        ("thesis_k", ctypes.c_double),
        ("thesis_h", ctypes.c_double),
    ]


class _Pose(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("matrices", "targets", "strengths")]


class _Batch(ctypes.Structure):
    _fields_ = [
        ("count", ctypes.c_size_t),
        ("slot_count", ctypes.c_int),
        ("vertices", ctypes.c_void_p),
        ("pose_count", ctypes.c_int),
    ] + [
        (name, ctypes.c_void_p)
        for name in (
            "poses", "rest", "joints", "weights", "anchor", "vertex_locked", "bone_locked",
            "start_joints", "start_weights", "guard", "pulls", "weights_out", "residual_before",
            "residual_after", "leftover_out",
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
    lib.skd_guard_bytes.restype = ctypes.c_size_t
    lib.skd_stiffness_choose.restype = ctypes.c_double
    return lib


_lib = _load()


def _pointer(array: np.ndarray | None) -> int | None:
    return None if array is None else array.ctypes.data


@dataclass
class Pose:
    """A further pose with targets."""

    matrices: np.ndarray  # [B, 3, 4] float64
    targets: np.ndarray  # [count, 3] float32
    strengths: np.ndarray | None = None  # [count] float32, all 1 if None

    def __post_init__(self) -> None:
        self.matrices = np.ascontiguousarray(self.matrices, np.float64).reshape(-1, 3, 4)
        self.targets = np.ascontiguousarray(self.targets, np.float32)
        if self.strengths is not None:
            self.strengths = np.ascontiguousarray(self.strengths, np.float32)

    def part(self, chosen: np.ndarray) -> "Pose":
        strengths = None if self.strengths is None else self.strengths[chosen]
        return Pose(self.matrices, self.targets[chosen], strengths)


@dataclass
class Batch:
    """A batch of vertices; arrays as struct skd_solve_batch has them, checked for type.

    matrices, targets and strengths are the first pose's, `more` are the others.
    """

    rest: np.ndarray  # [V, 3] float32
    joints: np.ndarray  # [V, N] uint16
    weights: np.ndarray  # [V, N] float32
    matrices: np.ndarray  # [B, 3, 4] float64
    targets: np.ndarray  # [count, 3] float32
    anchor: np.ndarray | None = None  # [V, N], the weights if None
    vertices: np.ndarray | None = None  # [count], all if None
    vertex_locked: np.ndarray | None = None
    bone_locked: np.ndarray | None = None
    strengths: np.ndarray | None = None  # [count], all 1 if None
    more: list[Pose] = field(default_factory=list)
    guard: np.ndarray | None = None  # [Q, B, 3, 4] the poses to keep
    pulls: np.ndarray | None = None  # [count, N]
    start_joints: np.ndarray | None = None  # [V, N], joints and anchor if None
    start_weights: np.ndarray | None = None
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
        for name in ("strengths", "pulls", "start_weights"):
            if getattr(self, name) is not None:
                setattr(self, name, np.ascontiguousarray(getattr(self, name), np.float32))
        if self.start_joints is not None:
            self.start_joints = np.ascontiguousarray(self.start_joints, np.uint16)
        if self.guard is not None:
            self.guard = np.ascontiguousarray(self.guard, np.float64)

    @property
    def slots(self) -> int:
        return self.joints.shape[1]

    def part(self, chosen: np.ndarray) -> "Batch":
        """The same session with only some items of the batch."""
        return replace(
            self,
            vertices=self.vertices[chosen],
            targets=self.targets[chosen],
            strengths=None if self.strengths is None else self.strengths[chosen],
            pulls=None if self.pulls is None else self.pulls[chosen],
            more=[pose.part(chosen) for pose in self.more],
        )

    def poses(self) -> list[Pose]:
        return [Pose(self.matrices, self.targets, self.strengths), *self.more]

    def carried(self, dtype: type = np.longdouble) -> np.ndarray:
        """d_i of every item and slot, [count, N, 3]; an empty slot's is not to be used."""
        return self.carried_by(self.matrices, self.joints, dtype)

    def carried_by(self, matrices: np.ndarray, joints: np.ndarray, dtype: type) -> np.ndarray:
        """The same for any pose's matrices and any [V, N] joints."""
        rest = self.rest[self.vertices].astype(dtype)
        joints = joints[self.vertices].astype(int)
        rows = matrices.astype(dtype)[np.where(joints == EMPTY, 0, joints)]
        return (rows[..., :3] * rest[:, None, None, :]).sum(-1) + rows[..., 3]

    def open(self) -> np.ndarray:
        """Which slots of each item may change, [count, N] bool."""
        joints = self.joints[self.vertices]
        free = joints != EMPTY
        if self.bone_locked is not None:
            free &= self.bone_locked[np.where(joints == EMPTY, 0, joints)] == 0
        if self.vertex_locked is not None:
            free &= (self.vertex_locked[self.vertices] == 0)[:, None]
        return free


class Guard:
    """struct skd_guard, built from [Q, B, 3, 4] poses."""

    def __init__(self, poses: np.ndarray) -> None:
        count, bones = poses.shape[:2]
        self.memory = np.full(_lib.skd_guard_bytes(ctypes.c_int(bones)) // 8, np.nan)
        matrices = [np.ascontiguousarray(pose, np.float64) for pose in poses]
        _lib.skd_guard_build(
            ctypes.c_int(bones), ctypes.c_int(count),
            (ctypes.c_void_p * count)(*(_pointer(m) for m in matrices)),
            ctypes.c_void_p(_pointer(self.memory)),
        )  # fmt: skip
        self.bones = bones

    def factor(self, i: int, j: int) -> np.ndarray:
        """U_ij of bones i < j, [4, 4]."""
        pair = i * (2 * self.bones - i - 1) // 2 + (j - i - 1)
        factor = np.zeros((4, 4))
        factor[np.triu_indices(4)] = self.memory[1 + 10 * pair : 11 + 10 * pair]
        return factor


@dataclass
class Result:
    weights: np.ndarray  # [count, N] float32
    before: np.ndarray  # [count] float32
    after: np.ndarray
    leftover: np.ndarray


class _Call:
    """A batch and options as C has them, and the arrays that they point to."""

    def __init__(self, batch: Batch, options: dict[str, float]) -> None:
        self.options = _lib.skd_solve_defaults()
        self.options.length = batch.length
        for name, value in options.items():
            setattr(self.options, name, value)
        count, slots = len(batch.vertices), batch.slots
        rows = [np.full((count, slots), np.nan, np.float32)]
        rows += [np.full(count, np.nan, np.float32) for _ in range(3)]
        self.result = Result(*rows)
        self.kept = batch.poses()
        self.poses = (_Pose * len(self.kept))(
            *((_pointer(p.matrices), _pointer(p.targets), _pointer(p.strengths)) for p in self.kept)
        )
        self.guard = None if batch.guard is None else Guard(batch.guard)
        self.batch = _Batch(count=count, slot_count=slots, pose_count=len(self.kept))
        for name in ("vertices", "rest", "joints", "weights", "anchor", "vertex_locked",
                     "bone_locked", "start_joints", "start_weights", "pulls"):  # fmt: skip
            setattr(self.batch, name, _pointer(getattr(batch, name)))
        self.batch.poses = ctypes.addressof(self.poses)
        self.batch.guard = None if self.guard is None else _pointer(self.guard.memory)
        self.batch.weights_out = _pointer(self.result.weights)
        self.batch.residual_before = _pointer(self.result.before)
        self.batch.residual_after = _pointer(self.result.after)
        self.batch.leftover_out = _pointer(self.result.leftover)


def solve(batch: Batch, **options: float) -> Result:
    """skd_solve with the default options but for those named."""
    call = _Call(batch, options)
    _lib.skd_solve(ctypes.byref(call.batch), ctypes.byref(call.options))
    return call.result


def choose_stiffness(batch: Batch, **options: float) -> float:
    """skd_stiffness_choose of the batch as a sample, solved with the probe's stiffness."""
    call = _Call(batch, {**options, "stiffness": 1e-4})
    leftovers = np.full(len(batch.vertices), np.nan, np.float32)
    call.batch.leftover_out = _pointer(leftovers)
    _lib.skd_solve(ctypes.byref(call.batch), ctypes.byref(call.options))
    return _lib.skd_stiffness_choose(
        ctypes.byref(call.batch), ctypes.c_double(call.options.length),
        ctypes.c_void_p(_pointer(leftovers)),
    )  # fmt: skip


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
