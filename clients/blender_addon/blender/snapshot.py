# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh as it was: its rest shape and vertex groups, taken, kept in a file, restored to the bit.

Main thread. Knows no daemon and no session. Taking and restoring are jobs, as in weights.py.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass

import numpy as np

from .mesh import read_positions
from .weights import (
    ARRAYS_AT_ONCE,
    WRITE_AT_ONCE,
    Entries,
    Progress,
    add_entries,
    entries,
    group_names,
    make_batch,
    mesh_named,
    object_named,
    remove_entries,
    set_weights,
    spread,
    within,
)

_MAGIC = b"SKS1"
_HEAD_BYTES_MAX = 1 << 24


@dataclass(frozen=True)
class Snapshot:
    """A mesh's rest shape, and its vertex groups with names, order, locks and entries."""

    names: list[str]
    locks: list[bool]
    active: int
    entries: Entries
    positions: np.ndarray  # f32 [V,3]

    @staticmethod
    def take(obj_name: str) -> Progress["Snapshot"]:
        """Job: reads it."""
        found = yield from entries(obj_name)
        obj = object_named(obj_name)
        return Snapshot(group_names(obj), [group.lock_weight for group in obj.vertex_groups],
                        obj.vertex_groups.active_index, found, read_positions(obj.data))

    @staticmethod
    def restore(obj_name: str, snapshot: "Snapshot") -> Progress[None]:
        """Job: makes the object what it was when the snapshot was taken, to the bit.

        Whatever happened to groups and entries since; the vertices must be the same ones. Raises
        MeshChanged where they are not.
        """
        count = len(snapshot.positions)
        mesh_named(obj_name, count)
        yield from _restore_groups(obj_name, snapshot)
        found = yield from within(entries(obj_name), 0.0, 0.5)
        for first in range(0, count, ARRAYS_AT_ONCE):
            vertices = np.arange(first, min(first + ARRAYS_AT_ONCE, count))
            mesh_named(obj_name, count)
            yield from _restore_entries(obj_name, found, snapshot.entries, vertices)
            yield 0.5 + 0.5 * first / count
        obj, mesh = object_named(obj_name), mesh_named(obj_name, count)
        for group, lock in zip(obj.vertex_groups, snapshot.locks):
            if group.lock_weight != lock:
                group.lock_weight = lock
        if snapshot.names and obj.vertex_groups.active_index != snapshot.active:
            obj.vertex_groups.active_index = snapshot.active
        if read_positions(mesh).tobytes() != snapshot.positions.tobytes():
            mesh.vertices.foreach_set("co", snapshot.positions.ravel())
        mesh.update()

    def to_bytes(self) -> bytes:
        """All of it, compressed. Half a second for a million vertices."""
        counts = np.diff(self.entries.offsets)
        head = json.dumps({"names": self.names, "locks": self.locks, "active": self.active,
                           "vertices": len(self.positions), "entries": len(self.entries.groups),
                           }).encode()
        body = b"".join(_planes(part) for part in (
            counts.astype(np.uint32), self.entries.groups.astype(np.uint32),
            self.entries.weights, self.positions))
        return _MAGIC + struct.pack("<I", len(head)) + head + zlib.compress(body, 1)

    @staticmethod
    def from_bytes(data: bytes) -> "Snapshot":
        """What to_bytes made. Raises ValueError for anything else: it comes from a file."""
        try:
            return _parse(data)
        except (ValueError, KeyError, TypeError, struct.error, zlib.error, RecursionError) as error:
            raise ValueError(f"this is not what Skind saved: {error}") from error


def _planes(values: np.ndarray) -> bytes:
    """32-bit values as four planes of bytes: much of a plane is alike, which compresses."""
    return np.ascontiguousarray(values).reshape(-1).view(np.uint8).reshape(-1, 4).T.tobytes()


def _parse(data: bytes) -> Snapshot:
    if data[:4] != _MAGIC:
        raise ValueError("it begins otherwise")
    head_bytes, = struct.unpack_from("<I", data, 4)
    if head_bytes > min(_HEAD_BYTES_MAX, len(data) - 8):
        raise ValueError("its head is too long")
    head = json.loads(data[8:8 + head_bytes])
    names, locks, active = head["names"], head["locks"], head["active"]
    vertices, total = head["vertices"], head["entries"]
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)
            and len(set(names)) == len(names) and isinstance(locks, list)
            and len(locks) == len(names) and all(isinstance(lock, bool) for lock in locks)
            and all(type(number) is int for number in (active, vertices, total))
            and -1 <= active <= len(names) and vertices >= 0 and total >= 0):
        raise ValueError("its head does not fit together")
    sizes = [vertices, total, total, vertices * 3]
    # zlib shrinks to a thousandth at best: this bounds what a short file can ask for.
    if sum(sizes) * 4 > 1100 * len(data):
        raise ValueError("it is cut off")
    unpacker = zlib.decompressobj()
    body = unpacker.decompress(data[8 + head_bytes:], sum(sizes) * 4 + 1)
    if len(body) != sum(sizes) * 4 or not unpacker.eof or unpacker.unused_data:
        raise ValueError("it is cut off")
    parts, at = [], 0
    for size in sizes:
        planes = np.frombuffer(body, np.uint8, size * 4, at).reshape(4, size)
        parts.append(np.ascontiguousarray(planes.T).reshape(-1).view(np.uint32))
        at += size * 4
    counts, groups, weights, positions = parts
    offsets = np.zeros(vertices + 1, np.int64)
    np.cumsum(counts, out=offsets[1:])
    if offsets[-1] != total or (total and groups.max() >= len(names)):
        raise ValueError("its entries do not fit together")
    keys = np.repeat(np.arange(vertices), counts) * max(len(names), 1) + groups
    if len(np.unique(keys)) != total:
        raise ValueError("a vertex is in a group twice")
    return Snapshot(names, locks, active,
                    Entries(offsets, groups.astype(np.int32), weights.view(np.float32)),
                    positions.view(np.float32).reshape(-1, 3))


def _restore_groups(obj_name: str, snapshot: Snapshot) -> Progress[None]:
    """Gives the object the snapshot's groups; entries in groups that were there before stay."""
    obj = object_named(obj_name)
    names, wanted = group_names(obj), snapshot.names
    if names[:len(wanted)] == wanted:
        for name in reversed(names[len(wanted):]):
            obj = object_named(obj_name)
            obj.vertex_groups.remove(obj.vertex_groups[name])
            yield None
        return
    # Renamed, removed, or in another order: all entries are written anew.
    obj.vertex_groups.clear()
    for name in wanted:
        obj.vertex_groups.new(name=name)


def _restore_entries(obj_name: str, found: Entries, wanted: Entries,
                     vertices: np.ndarray) -> Progress[None]:
    """Job: gives some vertices the entries wanted, in their order."""
    have, have_owner, have_ends = spread(found.offsets, vertices)
    want, want_owner, want_ends = spread(wanted.offsets, vertices)
    have_groups, want_groups = found.groups[have], wanted.groups[want]
    # A vertex whose entries begin with those wanted keeps them; of any other, none is of use.
    begins = np.diff(have_ends) >= np.diff(want_ends)
    place = np.arange(len(want)) - want_ends[:-1][want_owner]
    there = begins[want_owner]
    twin = have_ends[:-1][want_owner[there]] + place[there]
    begins[want_owner[there][have_groups[twin] != want_groups[there]]] = False

    have_place = np.arange(len(have)) - have_ends[:-1][have_owner]
    surplus = ~begins[have_owner] | (have_place >= np.diff(want_ends)[have_owner])
    yield None
    yield from remove_entries(obj_name, have_groups[surplus], vertices[have_owner[surplus]])
    missing = ~begins[want_owner]
    for turn in range(int(place[missing].max(initial=-1)) + 1):
        now = missing & (place == turn)
        yield from add_entries(obj_name, want_groups[now], vertices[want_owner[now]])

    weights = wanted.weights[want]
    differs = ~begins
    twin = have_ends[:-1][want_owner] + place
    kept = begins[want_owner]
    changed = (found.weights[have][twin[kept]].view(np.uint32) != weights[kept].view(np.uint32))
    differs[want_owner[kept][changed]] = True
    written = vertices[differs]
    for first in range(0, len(written), WRITE_AT_ONCE):
        part = written[first:first + WRITE_AT_ONCE]
        index, _, ends = spread(wanted.offsets, part)
        set_weights(object_named(obj_name).data.vertices,
                    make_batch(part, ends, wanted.weights[index]))
        yield None
