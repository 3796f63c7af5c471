# SPDX-License-Identifier: GPL-3.0-or-later
"""The vertex groups of a mesh: read whole, written slot by slot.

Main thread. This module and snapshot.py alone change groups and their entries; they know no daemon
and no session. A vertex has *entries* (group, weight) in an order of its own. The daemon has N
*slots* a vertex, each with a bone. `make_slots` gives every slot an entry, so that later writes are one call a vertex,
whole rows of weights, which is many times as fast as adding to groups:

    entries of a vertex    [ arm 0.5 | cloth 1.0 | spine 0.5 | hand 0 ]    hand: added, "padding"
    Layout.slots           [    1    |   KEEP    |     0     |    2   ]

Blender appends a new entry, and fills the gap of a removed one with the vertex's last. What is
added here stands behind what was there, so removing it again leaves the old order. For the same
reason an entry stays, with weight zero, when its bone loses the slot; the end takes it away.

Everything that walks over vertices is a job (a generator in pieces of about a millisecond that
yields progress, 0 to 1) and finds its object by name after each yield. Objects must not be in Edit
Mode: Blender then refuses changes to groups.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generator, Iterable, Iterator, TypeVar

import bpy
import numpy as np

from ..core.skin import NO_BONE

T = TypeVar("T")
Progress = Generator["float | None", None, T]

# A layout's marks: not a bone's entry; a bone's that has no slot; one's that has none any more.
KEEP, OUTSIDE, LEFT = -1, -2, -3

READ_AT_ONCE = 256  # vertices: below 1 ms with the 12 groups that a vertex of a rig may have
WRITE_AT_ONCE = 500
ARRAYS_AT_ONCE = 1024  # where NumPy does the work
LONG_CALL = 200  # vertices that one call adds to a group


class MeshChanged(RuntimeError):
    """The object is not as it was when the job began, or when the layout was made."""


def within(job: Progress[T], low: float, high: float) -> Progress[T]:
    """The job with its progress as a part of a larger one's."""
    while True:
        try:
            done = next(job)
        except StopIteration as end:
            return end.value
        yield None if done is None else low + done * (high - low)


def object_named(name: str) -> bpy.types.Object:
    """The mesh object of this file (not a linked one) of that name. Raises MeshChanged."""
    obj = bpy.data.objects.get((name, None))
    if obj is None or obj.type != "MESH":
        raise MeshChanged(f"\u201c{name}\u201d is no longer in this file")
    return obj


def mesh_named(name: str, vertices: int) -> bpy.types.Mesh:
    """The mesh of an object that must have so many vertices. Raises MeshChanged."""
    mesh = object_named(name).data
    if len(mesh.vertices) != vertices:
        raise MeshChanged(f"\u201c{name}\u201d had {vertices} vertices and has {len(mesh.vertices)}"
                          " now; undo the change to its topology")
    return mesh


def group_names(obj: bpy.types.Object) -> list[str]:
    return [group.name for group in obj.vertex_groups]


@dataclass(frozen=True)
class Entries:
    """All entries of a mesh: those of vertex v stand at offsets[v]:offsets[v + 1], in its order."""

    offsets: np.ndarray  # i64 [V + 1]
    groups: np.ndarray  # i32 [E]
    weights: np.ndarray  # f32 [E]


def entries(obj_name: str) -> Progress[Entries]:
    """Job: reads every vertex's entries, bit for bit."""
    count = len(object_named(obj_name).data.vertices)
    offsets = np.zeros(count + 1, np.int64)
    groups: list[np.ndarray] = []
    weights: list[np.ndarray] = []
    for first in range(0, count, READ_AT_ONCE):
        members, values, ends = _read(
            mesh_named(obj_name, count).vertices[first:first + READ_AT_ONCE])
        offsets[first + 1:first + 1 + len(ends)] = np.add(ends, offsets[first])
        groups.append(np.array(members, np.int32))
        weights.append(np.array(values, np.float32))
        yield first / count
    return Entries(offsets, np.concatenate([np.zeros(0, np.int32), *groups]),
                   np.concatenate([np.zeros(0, np.float32), *weights]))


def _read(vertices: Iterable[bpy.types.MeshVertex]) -> tuple[list[int], list[float], list[int]]:
    """Groups and weights of their entries, and where each vertex's end."""
    # Faster than foreach_get on each vertex's few entries, and flat lists of numbers, because
    # tuples by the thousand would set off collections of garbage, 15 ms each.
    members: list[int] = []
    values: list[float] = []
    ends: list[int] = []
    for vertex in vertices:
        for entry in vertex.groups:
            members.append(entry.group)
            values.append(entry.weight)
        ends.append(len(members))
    return members, values, ends


def spread(offsets: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The entries of some vertices: (indexes into them all, which of `vertices` owns each, ends).

    The entries of vertices[i] are those at ends[i]:ends[i + 1] of the result.
    """
    first = offsets[vertices]
    counts = offsets[vertices.astype(np.int64) + 1] - first
    ends = np.zeros(len(vertices) + 1, np.int64)
    np.cumsum(counts, out=ends[1:])
    owners = np.repeat(np.arange(len(vertices)), counts)
    return np.arange(ends[-1]) + (first - ends[:-1])[owners], owners, ends


def _by_group(groups: np.ndarray, vertices: np.ndarray) -> Iterator[tuple[int, list[int]]]:
    """(group, its vertices) by ascending group, from pairs."""
    order = np.argsort(groups, kind="stable")
    cuts = np.flatnonzero(np.diff(groups[order])) + 1
    for part in np.split(order, cuts) if len(order) else []:
        yield int(groups[part[0]]), vertices[part].tolist()


def add_entries(obj_name: str, groups: np.ndarray, vertices: np.ndarray) -> Progress[None]:
    """Job: appends an entry of weight zero for each pair; those of a vertex by ascending group."""
    for group, members in _by_group(groups, vertices):
        object_named(obj_name).vertex_groups[group].add(members, 0.0, "ADD")
        if len(members) > LONG_CALL:
            yield None


def remove_entries(obj_name: str, groups: np.ndarray, vertices: np.ndarray) -> Progress[None]:
    """Job: removes the entry of each pair."""
    for group, members in _by_group(groups, vertices):
        object_named(obj_name).vertex_groups[group].remove(members)
        if len(members) > LONG_CALL:
            yield None


def _parts(flat: np.ndarray, ends: np.ndarray) -> Iterable[np.ndarray]:
    """Views of flat[ends[i]:ends[i + 1]]."""
    count = len(ends) - 1
    if count and (np.diff(ends) == ends[1]).all():
        return flat.reshape(count, -1)  # a fifth of the time of all that follows
    bounds = ends.tolist()
    return (flat[begin:end] for begin, end in zip(bounds, bounds[1:]))


def _get(vertices: Any, indexes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """f32: the weights of whole vertices, one after the other."""
    flat = np.empty(ends[-1], np.float32)
    try:
        for index, part in zip(indexes.tolist(), _parts(flat, ends)):
            vertices[index].groups.foreach_get("weight", part)
    except RuntimeError as error:
        raise _stale() from error
    return flat


@dataclass(frozen=True)
class Batch:
    """Whole rows of weights f32, ready to be written: rows[i] into vertices[i]."""

    vertices: list[int]
    rows: list[np.ndarray]


def make_batch(vertices: np.ndarray, ends: np.ndarray, flat: np.ndarray) -> Batch:
    """Cuts flat at the ends: what can be done before the writing itself."""
    return Batch(vertices.tolist(), list(_parts(flat, ends)))


def set_weights(vertices: Any, batch: Batch) -> None:
    """Writes the weights of whole vertices; they keep their bits, which one by one they do not."""
    try:
        for index, row in zip(batch.vertices, batch.rows):
            vertices[index].groups.foreach_set("weight", row)
    except RuntimeError as error:
        raise _stale() from error


def _stale() -> MeshChanged:
    return MeshChanged("vertex groups were changed outside of Skind; their slots have to be made"
                       " again")


# --- Slots --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Layout:
    """Where each slot's weight stands among a vertex's entries."""

    influences: int  # N, slots a vertex
    groups: list[str]  # the object's groups when it was made, in order
    added: list[str]  # those of them that were made for it
    offsets: np.ndarray  # i64 [V + 1]
    members: np.ndarray  # i32 [E] group of each entry
    slots: np.ndarray  # i8 [E] slot of each entry, KEEP, OUTSIDE or LEFT
    padding: np.ndarray  # bool [E] entries that were made for it
    skip: np.ndarray  # bool [V] vertices that have no slots: never written


def make_slots(obj_name: str, names: list[str], joints: np.ndarray,
               skip: np.ndarray) -> Progress[Layout]:
    """Job: gives each slot of joints u16 [V,N] (an index into names) an entry in its bone's group.

    What is missing is made, with weight zero; the deformed shape stays what it was. Vertices that
    `skip` bool [V] names get nothing. May be called again at any time.
    """
    joints = np.asarray(joints)
    count, influences = joints.shape
    mesh_named(obj_name, count)
    found = yield from within(entries(obj_name), 0.0, 0.7)
    added = _make_groups(object_named(obj_name), names, joints[~skip])
    groups = group_names(object_named(obj_name))
    group_of, is_bone = _bones_of(groups, names)

    counts = np.zeros(count + 1, np.int64)
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for first in range(0, count, ARRAYS_AT_ONCE):
        vertices = np.arange(first, min(first + ARRAYS_AT_ONCE, count))
        wanted = _wanted(joints[vertices], skip[vertices], group_of)
        index, owners, _ = spread(found.offsets, vertices)
        owners, members, slots, missing = _match(found.groups[index], owners, wanted, is_bone)
        yield from add_entries(obj_name, members[missing], vertices[owners[missing]])
        counts[vertices + 1] = np.bincount(owners, minlength=len(vertices))
        parts.append((members, slots, missing))
        yield 0.7 + 0.3 * first / count
    members, slots, padding = (np.concatenate([np.zeros(0, dtype), *column]) for dtype, column
                               in zip((np.int32, np.int8, bool), zip(*parts)))
    return Layout(influences, groups, added, np.cumsum(counts), members, slots, padding,
                  np.array(skip, bool))


def _make_groups(obj: bpy.types.Object, names: list[str], joints: np.ndarray) -> list[str]:
    """Makes the groups that these bones lack; returns their names."""
    there = {group.name for group in obj.vertex_groups}
    used = np.zeros(NO_BONE + 1, bool)
    used[joints] = True
    added = [names[bone] for bone in np.flatnonzero(used[:NO_BONE]) if names[bone] not in there]
    active = obj.vertex_groups.active_index
    for name in added:
        obj.vertex_groups.new(name=name)
    if added and active >= 0:
        obj.vertex_groups.active_index = active  # a new group makes itself the active one
    return added


def _bones_of(groups: list[str], names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """The group of each bone, i32, -1 for none; and which groups are bones'."""
    index_of = {name: index for index, name in enumerate(groups)}
    group_of = np.array([index_of.get(name, -1) for name in names] or [-1], np.int32)
    return group_of, np.isin(np.arange(len(groups)), group_of)


def _wanted(bones: np.ndarray, skip: np.ndarray, group_of: np.ndarray) -> np.ndarray:
    """The group of each slot of bones u16 [n,N], -1 for none."""
    free = (bones == NO_BONE) | skip[:, None]
    return np.where(free, -1, group_of[np.where(free, 0, bones)])


def fit_slots(obj_name: str, layout: Layout, names: list[str], joints: np.ndarray,
              vertices: np.ndarray, read: bool = False) -> Layout:
    """The layout after some vertices have got other bones: joints u16 [V,N]. In one piece.

    Entries that they lack are made, with weight zero. `read`: what entries they have is looked up
    in the mesh, because Blender's undo has changed it. Raises MeshChanged.
    """
    obj = object_named(obj_name)
    vertices = np.unique(vertices[~layout.skip[vertices]])
    there = group_names(obj)
    if there[:len(layout.groups)] != layout.groups[:len(there)] or (
            not read and there != layout.groups):
        raise _stale()
    added = _make_groups(obj, names, joints[vertices])
    groups = group_names(obj)
    group_of, is_bone = _bones_of(groups, names)
    index, owners, _ = spread(layout.offsets, vertices)
    members, width = layout.members[index], len(groups) + len(layout.groups)
    known = owners * width + members
    if read:
        every = obj.data.vertices
        found, _, ends = _read(every[vertex] for vertex in vertices.tolist())
        members = np.array(found, np.int32)
        owners = np.repeat(np.arange(len(vertices)), np.diff(ends, prepend=0))
    owners, members, slots, missing = _match(
        members, owners, _wanted(joints[vertices], layout.skip[vertices], group_of), is_bone)
    for _ in add_entries(obj_name, members[missing], vertices[owners[missing]]):
        pass
    # What the old layout says of the same entries; those that it does not know are ours.
    order = np.argsort(known)
    keys = owners * width + members
    place = np.minimum(np.searchsorted(known[order], keys), max(len(known) - 1, 0))
    twin = index[order[place]] if len(known) else np.zeros(len(keys), np.int64)
    is_known = known[order[place]] == keys if len(known) else np.zeros(len(keys), bool)
    padding = np.where(is_known, layout.padding[twin], True)
    had_slot = is_known & (layout.slots[twin] != OUTSIDE)
    slots[(slots == OUTSIDE) & (had_slot | ~is_known)] = LEFT
    return _spliced(layout, vertices, owners, (members, slots, padding), groups,
                    [name for name in layout.added if name in groups] + added)


def _spliced(layout: Layout, vertices: np.ndarray, owners: np.ndarray,
             entries_of: tuple[np.ndarray, np.ndarray, np.ndarray], groups: list[str],
             added: list[str]) -> Layout:
    """The layout with other entries (groups, slots, padding; by owner) for some vertices."""
    counts = np.diff(layout.offsets)
    changed = np.zeros(len(layout.skip), bool)
    changed[vertices] = True
    kept = ~np.repeat(changed, counts)
    whose = np.concatenate([np.repeat(np.arange(len(changed)), counts)[kept], vertices[owners]])
    order = np.argsort(whose, kind="stable")
    counts[vertices] = np.bincount(owners, minlength=len(vertices))
    members, slots, padding = (
        np.concatenate([old[kept], new.astype(old.dtype)])[order]
        for old, new in zip((layout.members, layout.slots, layout.padding), entries_of))
    return Layout(layout.influences, groups, added, np.concatenate([[0], np.cumsum(counts)]),
                  members, slots, padding, layout.skip)


def make_slots_again(obj_name: str, old: Layout, names: list[str],
                     joints: np.ndarray) -> Progress[Layout]:
    """Job: make_slots after groups were changed outside; still knows what the old one added."""
    new = yield from make_slots(obj_name, names, joints, old.skip)
    for ours, those in _pairs(new, old.groups, old.offsets, old.members):
        new.padding[ours] |= np.isin(those.ours, those.theirs[old.padding[those.index]])
        left = np.isin(those.ours, those.theirs[old.slots[those.index] == LEFT])
        new.slots[ours] = np.where(left & (new.slots[ours] == OUTSIDE), LEFT, new.slots[ours])
        yield None
    new.added.extend(name for name in old.added if name in new.groups and name not in new.added)
    return new


def count_added_since(layout: Layout, names: list[str], group_names_then: list[str],
                      then: Entries) -> Progress[None]:
    """Job: what bones' groups hold now and did not then counts as added for the slots."""
    for ours, those in _pairs(layout, group_names_then, then.offsets, then.groups):
        of_bones = layout.slots[ours] != KEEP
        layout.padding[ours] |= of_bones & ~np.isin(those.ours, those.theirs)
        yield None
    known = {*group_names_then, *layout.added}
    layout.added.extend(name for name in names if name in layout.groups and name not in known)


@dataclass(frozen=True)
class _Pairs:
    """Entries of some vertices as numbers that are equal for the same vertex and group."""

    ours: np.ndarray
    theirs: np.ndarray
    index: np.ndarray  # which of all their entries those are


def _pairs(layout: Layout, names: list[str], offsets: np.ndarray,
           members: np.ndarray) -> Iterator[tuple[np.ndarray, _Pairs]]:
    """A layout's entries and others of the same vertices, in groups of these names, by slices."""
    index_of = {name: index for index, name in enumerate(layout.groups)}
    group_now = np.array([index_of.get(name, -1) for name in names] or [-1], np.int64)
    count, width = len(layout.skip), len(layout.groups) + 1
    for first in range(0, count, ARRAYS_AT_ONCE):
        vertices = np.arange(first, min(first + ARRAYS_AT_ONCE, count))
        index, their_owners, _ = spread(offsets, vertices)
        ours, owners, _ = spread(layout.offsets, vertices)
        # A group that is gone: a number that none of ours has.
        groups = np.where(group_now[members[index]] < 0, width - 1, group_now[members[index]])
        yield ours, _Pairs(owners * width + layout.members[ours], their_owners * width + groups,
                           index)


def _match(members: np.ndarray, owners: np.ndarray, wanted: np.ndarray,
           is_bone: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pairs entries with slots; what has no entry is appended to its vertex's, by group.

    `wanted` [n,N] has each slot's group, -1 for none. Returns owners, groups, slots, and which
    entries are new, in the order that the vertices' entries have once those are added.
    """
    slots = np.where(is_bone[members], OUTSIDE, KEEP).astype(np.int8)
    has = wanted < 0
    for slot in range(wanted.shape[1]):
        hit = members == wanted[owners, slot]
        slots[hit] = slot
        has[owners[hit], slot] = True
    new_owners, new_slots = np.nonzero(~has)
    new_members = wanted[new_owners, new_slots].astype(np.int32)
    order = np.lexsort((new_members, new_owners))
    missing = np.repeat([False, True], [len(members), len(order)])
    owners = np.concatenate([owners, new_owners[order]])
    members = np.concatenate([members, new_members[order]])
    slots = np.concatenate([slots, new_slots[order].astype(np.int8)])
    order = np.argsort(owners, kind="stable")
    return owners[order], members[order], slots[order], missing[order]


def _fresh(obj_name: str, layout: Layout) -> bpy.types.Object:
    """The object, if its groups are still those of the layout. Raises MeshChanged."""
    obj = object_named(obj_name)
    if len(obj.data.vertices) != len(layout.skip) or group_names(obj) != layout.groups:
        raise _stale()
    return obj


def prepare_rows(obj_name: str, layout: Layout, vertices: np.ndarray,
                 rows: np.ndarray) -> Progress[list[Batch]]:
    """Job: makes rows f32 [n,N] of weights ready for the slots of vertices u32 [n].

    Bones' entries without a slot become zero, other groups keep what they have now, and the
    layout's `skip` is left alone. Raises MeshChanged when the groups do not fit the layout any
    more: make_slots mends that.
    """
    vertices = np.asarray(vertices)
    rows = np.asarray(rows, np.float32)
    if layout.skip.any():
        kept = ~layout.skip[vertices]
        vertices, rows = vertices[kept], rows[kept]
    _fresh(obj_name, layout)
    batches = []
    for first in range(0, len(vertices), WRITE_AT_ONCE):
        part = vertices[first:first + WRITE_AT_ONCE]
        index, owners, ends = spread(layout.offsets, part)
        slots = layout.slots[index]
        of_bones = rows[first:first + WRITE_AT_ONCE][owners, slots]
        of_bones[slots < 0] = 0
        others = slots == KEEP
        if others.any():
            target = object_named(obj_name).data.vertices
            of_bones[others] = _get(target, part, ends)[others]
        batches.append(make_batch(part, ends, of_bones))
        yield first / len(vertices)
    return batches


def write_batch(obj_name: str, layout: Layout, batches: list[Batch]) -> None:
    """Writes what prepare_rows made, in one piece: half a microsecond a vertex.

    The caller tells Blender by mesh.update(). Raises MeshChanged as prepare_rows does.
    """
    target = _fresh(obj_name, layout).data.vertices
    for batch in batches:
        set_weights(target, batch)


def write_rows(obj_name: str, layout: Layout, vertices: np.ndarray,
               rows: np.ndarray) -> Progress[None]:
    """Job: prepare_rows and write_batch, in slices: for when nobody looks meanwhile."""
    for batch in (yield from within(prepare_rows(obj_name, layout, vertices, rows), 0.0, 0.3)):
        write_batch(obj_name, layout, [batch])
        yield None


def read_rows(obj_name: str, layout: Layout, vertices: np.ndarray) -> np.ndarray:
    """f32 [n,N]: what the slots of some vertices hold in Blender; free slots and skip: zero."""
    vertices = np.asarray(vertices)
    index, owners, ends = spread(layout.offsets, vertices)
    weights = _get(_fresh(obj_name, layout).data.vertices, vertices, ends)
    slots = layout.slots[index]
    taken = slots >= 0
    rows = np.zeros((len(vertices), layout.influences), np.float32)
    rows[owners[taken], slots[taken]] = weights[taken]
    return rows


def remove_padding(obj_name: str, layout: Layout) -> Progress[None]:
    """Job: takes away what make_slots added and nobody used: zero entries and empty groups.

    The layout is of no use afterwards.
    """
    _fresh(obj_name, layout)
    count = len(layout.skip)
    found = yield from within(entries(obj_name), 0.0, 0.7)
    left = np.zeros(len(layout.groups), np.int64)
    for first in range(0, count, ARRAYS_AT_ONCE):
        vertices = np.arange(first, min(first + ARRAYS_AT_ONCE, count))
        index, owners, _ = spread(found.offsets, vertices)
        members = found.groups[index]
        ours, our_owners, _ = spread(layout.offsets, vertices)
        ours_added = layout.padding[ours] | (layout.slots[ours] == LEFT)
        # By vertex and group rather than by place: others may have added and removed as well.
        keys = owners * len(left) + members
        added = np.isin(keys, (our_owners * len(left) + layout.members[ours])[ours_added])
        idle = added & (found.weights[index] == 0)
        yield from remove_entries(obj_name, members[idle], vertices[owners[idle]])
        left += np.bincount(members[~idle], minlength=len(left))
        yield 0.7 + 0.3 * first / count
    active = object_named(obj_name).vertex_groups.active
    chosen = active.name if active is not None else ""
    for name in layout.added:
        if left[layout.groups.index(name)] == 0:
            obj = object_named(obj_name)
            obj.vertex_groups.remove(obj.vertex_groups[name])
            yield None
    obj = object_named(obj_name)
    if chosen in obj.vertex_groups:
        obj.vertex_groups.active_index = obj.vertex_groups[chosen].index
    object_named(obj_name).data.update()
