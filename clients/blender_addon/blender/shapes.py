# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrective shapes as shape keys: one a pose, "skind <pose>", seen in that pose alone.

Main thread; this module alone makes, writes and removes shape keys. The Basis is the rest shape and
stays the active key, because Sculpt Mode writes into the active one. Blender evaluates keys and not
the mesh's own coordinates, so whoever writes those has to move the keys along: write_positions().
"""

from __future__ import annotations

import bpy
import numpy as np

PREFIX = "skind "


def ours(data: bpy.types.Mesh) -> dict[str, bpy.types.ShapeKey]:
    """Pose name -> its key."""
    if data.shape_keys is None:
        return {}
    return {key.name[len(PREFIX):]: key for key in data.shape_keys.key_blocks
            if key.name.startswith(PREFIX)}


def are_ours_alone(data: bpy.types.Mesh) -> bool:
    """There is no key but the Basis and those of poses."""
    return data.shape_keys is None or len(ours(data)) == len(data.shape_keys.key_blocks) - 1


def _read(key: bpy.types.ShapeKey) -> np.ndarray:
    values = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", values)
    return values.reshape(-1, 3)


def write(obj: bpy.types.Object, pose: str, rest: np.ndarray, offsets: np.ndarray) -> None:
    """The pose's key, made where there is none: rest f32 [V,3] and offsets f32 [V,3]."""
    if obj.data.shape_keys is None:
        if not offsets.any():
            return
        obj.shape_key_add(name="Basis", from_mix=False)
    key = ours(obj.data).get(pose)
    if key is None:
        key = obj.shape_key_add(name=PREFIX + pose, from_mix=False)
        key.value = 1.0
    key.data.foreach_set("co", (rest + offsets).ravel())
    obj.active_shape_key_index = 0
    obj.show_only_shape_key = False


def switch(obj: bpy.types.Object, pose: str) -> None:
    """Only this pose's key is seen; "": none of ours is."""
    for name, key in ours(obj.data).items():
        value = float(name == pose)
        if key.value != value:
            key.value = value


def remove(obj: bpy.types.Object) -> None:
    """All of ours, and the Basis when nothing but that is left."""
    for key in ours(obj.data).values():
        obj.shape_key_remove(key)
    keys = obj.data.shape_keys
    if keys is not None and len(keys.key_blocks) == 1:
        obj.shape_key_clear()


def write_positions(data: bpy.types.Mesh, positions: np.ndarray) -> None:
    """The rest shape f32 [V,3], with all keys moved along. Never during a stroke: its next dab
    would overwrite it."""
    if data.shape_keys is not None:
        basis = data.shape_keys.reference_key
        before = _read(basis)
        for key in data.shape_keys.key_blocks:
            if key != basis:
                key.data.foreach_set("co", (positions + (_read(key) - before)).ravel())
        basis.data.foreach_set("co", positions.ravel())
    data.vertices.foreach_set("co", positions.ravel())
    data.update()
