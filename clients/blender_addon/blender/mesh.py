# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh's rest coordinates, and the marks that a session leaves on it.

The marks are custom properties of the mesh, so Blender's undo and its files carry them: which
session it is in, and which state of the weights it shows. A state is numbered within one run of a
session: undo may lead back into an earlier run, which had the same name and numbers.
"""

from __future__ import annotations

import bpy
import numpy as np

SESSION = "skind_session"
STATE = "skind_state"
SNAPSHOT = "skind_snapshot"
INSTANCE = "skind_instance"  # which session of that name it was
SAVED = (SNAPSHOT, INSTANCE)  # only in files
MARKS = (SESSION, STATE, *SAVED)


def read_positions(mesh: bpy.types.Mesh) -> np.ndarray:
    """f32 [V,3]; right as soon as a stroke ends, in Sculpt Mode too."""
    positions = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.reshape(-1, 3)


def read_mask(mesh: bpy.types.Mesh) -> np.ndarray | None:
    """f32 [V]: what Sculpt Mode's mask keeps still, 1 wholly; None: nothing is masked."""
    if hasattr(mesh, "vertex_paint_masks"):  # before 4.1
        layer = mesh.vertex_paint_masks[0] if mesh.vertex_paint_masks else None
    else:
        layer = mesh.attributes.get(".sculpt_mask")
    if layer is None or len(layer.data) != len(mesh.vertices):
        return None
    mask = np.empty(len(mesh.vertices), np.float32)
    layer.data.foreach_get("value", mask)
    return np.clip(mask, 0, 1) if mask.any() else None


class Topology:
    """Whether a mesh is still the one that it was, vertex for vertex.

    Edit Mode and Dyntopo may change that, or put the same vertices into another order. Looking at
    all corners takes as long as a stroke's diff, so it is done only after one of them was seen.
    """

    def __init__(self, mesh: bpy.types.Mesh) -> None:
        self._vertices = len(mesh.vertices)
        self._corners = _read_corners(mesh)
        self._is_doubtful = False

    def doubt(self) -> None:
        """Something may have happened to it: Blender's undo, say."""
        self._is_doubtful = True

    def problem(self, obj: bpy.types.Object | None) -> str:
        """Why the object's mesh cannot be sculpted further now, as a sentence; or ""."""
        if obj is None:
            return "The object is gone: undo that."
        if obj.mode == 'EDIT':
            self._is_doubtful = True
            return "Leave Edit Mode to go on."
        if obj.use_dynamic_topology_sculpting:
            self._is_doubtful = True
            return "Dyntopo changes the mesh's topology: undo it to go on."
        if len(obj.data.vertices) != self._vertices:
            return "The mesh has other vertices than at the start: undo that."
        if self._is_doubtful:
            if not np.array_equal(_read_corners(obj.data), self._corners):
                return "The vertices are in another order than at the start: undo that."
            self._is_doubtful = False
        return ""

    @staticmethod
    def may_pass(obj: bpy.types.Object) -> bool:
        """Its problem is a mode that can be left."""
        return obj.mode == 'EDIT' or obj.use_dynamic_topology_sculpting


def _read_corners(mesh: bpy.types.Mesh) -> np.ndarray:
    """i32: the faces' vertices, one face after the other."""
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    return corners


def mark_state(mesh: bpy.types.Mesh, run: str, state: int) -> None:
    mesh[STATE] = f"{run}.{state}"


def marked_state(mesh: bpy.types.Mesh, run: str) -> int | None:
    """The state that the mesh shows, or None when it is not of this run."""
    marked, _, state = str(mesh.get(STATE, "")).partition(".")
    return int(state) if marked == run and state.isdigit() else None


def unmark(mesh: bpy.types.Mesh) -> None:
    for mark in MARKS:
        if mark in mesh:
            del mesh[mark]
