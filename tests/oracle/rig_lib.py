"""The rig room for Python tests: rig_probe, the assets, and glTF files taken apart by other means."""

import base64
import json
import os
import shutil
import struct
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Callable
from urllib.parse import unquote

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT.parent / "shared" / "assets"
QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")
PROBE = Path(os.environ.get("SKIND_BUILD", ROOT / "build" / "release")) / "bin" / "rig_probe"
EMPTY = 0xFFFF


def asset_paths() -> list[str]:
    """Names of all glTF files of the collection, none where it is missing."""
    found = sorted(ASSETS.rglob("*.gl[bt]*")) if ASSETS.is_dir() else []
    return [path.relative_to(ASSETS).as_posix() for path in found if path.suffix in (".glb", ".gltf")]


def _run_probe(*arguments: object) -> list[dict]:
    """Runs rig_probe; a crash or a sanitizer's complaint fails the test."""
    done = subprocess.run([PROBE, *map(str, arguments)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def probe(*arguments: object) -> dict:
    """What one call of rig_probe prints."""
    (answer,) = _run_probe(*arguments)
    return answer


def check(paths: list[Path]) -> list[dict]:
    """Status and text of loading each file, in one process."""
    answers = _run_probe("check", *paths)
    assert len(answers) == len(paths)
    return answers


def node_modules() -> Path:
    """The folder that `npm install` of package.json filled."""
    folder = Path(os.environ.get("SKIND_NODE_MODULES", Path.home() / ".cache" / "skind" / "oracle"))
    for name in ("three", "gltf-validator"):
        if not (folder / "node_modules" / name).is_dir():
            raise RuntimeError(
                f"{name} is not in {folder}: copy tests/oracle/package.json there and run "
                "`npm install --no-package-lock --no-audit --no-fund` in it, or use ./run test"
            )
    return folder


def run_node(script: str, jobs: object) -> object:
    """Runs one of our .mjs files with the npm oracles; jobs and answer are JSON."""
    node = shutil.which("node")
    if node is None:
        raise RuntimeError("node is not installed (Debian package nodejs)")
    done = subprocess.run(
        [node, Path(__file__).with_name(script), node_modules() / "node_modules"],
        input=json.dumps(jobs), capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@dataclass
class Rig:
    """What skind made of a file."""

    summary: dict
    arrays: dict[str, np.ndarray]

    @property
    def length(self) -> float:
        return self.summary["length"]

    def rows(self, slot_count: int) -> tuple[np.ndarray, np.ndarray]:
        """Influences as joints and weights [V][N], the largest N of each vertex."""
        offsets = self.arrays["offsets"].astype(np.int64)
        count = np.diff(offsets)
        joints = np.full((len(count), slot_count), EMPTY, np.uint16)
        weights = np.zeros((len(count), slot_count), np.float32)
        for k in range(slot_count):
            has = count > k
            joints[has, k] = self.arrays["joints"][offsets[:-1][has] + k]
            weights[has, k] = self.arrays["weights"][offsets[:-1][has] + k]
        return joints, weights


def load(path: Path, scratch: Path) -> Rig:
    """Loads a file that skind must accept."""
    file = scratch / "arrays.bin"
    summary = probe("load", path, file)
    assert summary["status"] == "ok", summary
    data = file.read_bytes()
    arrays = {}
    for name, entry in summary.pop("arrays").items():
        count = entry["rows"] * entry["columns"]
        array = np.frombuffer(data, entry["dtype"], count, entry["offset"])
        arrays[name] = array.reshape(entry["rows"], entry["columns"]) if entry["columns"] > 1 else array
    return Rig(summary, arrays)


Shape = tuple[str, np.ndarray, np.ndarray]  # name, vertices [n], offsets [n][3]


def export(
    path: Path, target: Path, joints: np.ndarray, weights: np.ndarray, scratch: Path,
    rest: np.ndarray | None = None, shapes: list[Shape] = [],
) -> dict:  # fmt: skip
    """Exports a file with new weights, rest positions and corrective shapes; the report."""
    joints.astype("<u2").tofile(scratch / "joints.raw")
    weights.astype("<f4").tofile(scratch / "weights.raw")
    more: list[object] = []
    if rest is not None:
        rest.astype("<f4").tofile(scratch / "rest.raw")
    if rest is not None or shapes:
        more = ["-" if rest is None else scratch / "rest.raw"]
    for index, (name, vertices, offsets) in enumerate(shapes):
        more += [name, scratch / f"vertices{index}.raw", scratch / f"offsets{index}.raw"]
        np.asarray(vertices).astype("<u4").tofile(more[-2])
        np.asarray(offsets).astype("<f4").tofile(more[-1])
    raw = [scratch / "joints.raw", scratch / "weights.raw"]
    return probe("export", path, target, joints.shape[1], *raw, *more)


def export_after(
    path: Path, target: Path, rows: tuple[np.ndarray, np.ndarray], scratch: Path, change: Callable[[], object]
) -> dict:
    """Exports a file to which something is done after it was loaded; the report."""
    rows[0].astype("<u2").tofile(scratch / "joints.raw")
    rows[1].astype("<f4").tofile(scratch / "weights.raw")
    arguments = ["hold", path, target, rows[0].shape[1], scratch / "joints.raw", scratch / "weights.raw"]
    with subprocess.Popen(
        [PROBE, *map(str, arguments)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert json.loads(process.stdout.readline())["status"] == "loaded"
        change()
        answer, _ = process.communicate("go on\n", timeout=60)
        assert process.returncode == 0
    return json.loads(answer)


def posed(path: Path, poses: list[tuple[int, float]], vertices: int, scratch: Path) -> np.ndarray:
    """Positions [poses][V][3] at (clip, seconds)."""
    file = scratch / "posed.bin"
    answer = probe("pose", path, file, *(x for clip, time in poses for x in (clip, repr(time))))
    assert answer["status"] == "ok", answer
    return np.fromfile(file, "<f4").reshape(len(poses), vertices, 3)


COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


@dataclass
class Gltf:
    """A glTF file read by Python alone."""

    json: dict
    buffers: list[bytes]

    @classmethod
    @cache
    def read(cls, path: Path) -> "Gltf":
        data = path.read_bytes()
        chunk = b""
        if data[:4] == b"glTF":
            (size,) = struct.unpack_from("<I", data, 12)
            document = json.loads(data[20 : 20 + size])
            if len(data) > 28 + size:
                (chunk_size,) = struct.unpack_from("<I", data, 20 + size)
                chunk = data[28 + size : 28 + size + chunk_size]
        else:
            document = json.loads(data)
        buffers = []
        for buffer in document.get("buffers", []):
            uri = buffer.get("uri")
            if uri is None:
                content = chunk
            elif uri.startswith("data:"):
                content = base64.b64decode(uri.split(",", 1)[1])
            else:
                content = (path.parent / unquote(uri)).read_bytes()
            buffers.append(content[: buffer["byteLength"]])
        return cls(document, buffers)

    def byte_ranges(self, accessor: int) -> list[tuple[int, int, int]]:
        """(buffer, start, end) of each element of a plain accessor."""
        entry = self.json["accessors"][accessor]
        view = self.json["bufferViews"][entry["bufferView"]]
        size = WIDTHS[entry["type"]] * np.dtype(COMPONENTS[entry["componentType"]]).itemsize
        stride = view.get("byteStride", size)
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        return [(view["buffer"], start + i * stride, start + i * stride + size) for i in range(entry["count"])]

    def _plain(self, view: int, offset: int, dtype: np.dtype, width: int, count: int) -> np.ndarray:
        entry = self.json["bufferViews"][view]
        stride = entry.get("byteStride", dtype.itemsize * width)
        buffer = self.buffers[entry["buffer"]]
        start = entry.get("byteOffset", 0) + offset
        return np.ndarray((count, width), dtype, buffer, start, (stride, dtype.itemsize)).copy()

    def elements(self, accessor: int) -> np.ndarray:
        """All elements of an accessor [count][width], as stored."""
        entry = self.json["accessors"][accessor]
        dtype, width = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]]
        if "bufferView" in entry:
            values = self._plain(entry["bufferView"], entry.get("byteOffset", 0), dtype, width, entry["count"])
        else:
            values = np.zeros((entry["count"], width), dtype)
        if sparse := entry.get("sparse"):
            where, what = sparse["indices"], sparse["values"]
            index_type = np.dtype(COMPONENTS[where["componentType"]])
            indices = self._plain(where["bufferView"], where.get("byteOffset", 0), index_type, 1, sparse["count"])
            values[indices[:, 0]] = self._plain(
                what["bufferView"], what.get("byteOffset", 0), dtype, width, sparse["count"]
            )
        return values

    def floats(self, accessor: int, normalized: bool | None = None) -> np.ndarray:
        """Elements as float64, normalised integers mapped as the specification says."""
        entry, values = self.json["accessors"][accessor], self.elements(accessor)
        if normalized is None:
            normalized = entry.get("normalized", False)
        if normalized and values.dtype.kind in "iu":
            return np.maximum(values.astype(np.float64) / np.iinfo(values.dtype).max, -1.0)
        return values.astype(np.float64)
