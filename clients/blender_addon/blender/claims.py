# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that tell the other tools in a session what this artist works on, and that it is done.

A claim stops nobody. Owns nothing; what is claimed is core/presence.py's.
"""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import EnumProperty

from . import mesh, rig, session
from .properties import redraw_views
from .sculpting import Session

MASKED = 0.5  # of Sculpt Mode's mask, from which a vertex counts as masked
NOTHING = {
    'BONES': "No bone of this session is selected: select bones that deform, in Pose Mode",
    'MASK': "Nothing is masked: paint the mask in Sculpt Mode",
    'VERTICES': "No vertex is selected: select vertices in Edit Mode",
}


def selected_bones(live: Session) -> list[str]:
    armature = rig.armature_of(live.object())
    if armature is None:
        return []
    # The selection moved from an armature's bones to those of its pose in 5.0.
    return [bone.name for bone in armature.pose.bones
            if getattr(bone, "select", None) or getattr(bone.bone, "select", False)
            if bone.name in live.sculpt.bones]


def _vertices_of(chosen: np.ndarray | None, live: Session) -> np.ndarray:
    """u32 of the vertices chosen; none where the mesh has others than the session."""
    if chosen is None or len(chosen) != live.sculpt.vertices:
        return np.empty(0, np.uint32)
    return np.flatnonzero(chosen).astype(np.uint32)


def masked_vertices(live: Session) -> np.ndarray:
    mask = mesh.read_mask(live.object().data)
    return _vertices_of(None if mask is None else mask >= MASKED, live)


def selected_vertices(live: Session) -> np.ndarray:
    obj = live.object()
    if obj.mode == 'EDIT':
        obj.update_from_editmode()
    selected = np.empty(len(obj.data.vertices), bool)
    obj.data.vertices.foreach_get("select", selected)
    return _vertices_of(selected, live)


class SKIND_OT_claim(bpy.types.Operator):
    """Show the others what you work on. It stops nobody: they see it greyed, and are told when a
    stroke of theirs goes into it"""

    bl_idname = "skind.claim"
    bl_label = "Claim"
    bl_options = {'REGISTER'}

    what: EnumProperty(
        name="What",
        items=(('BONES', "Selected Bones", "The bones selected in Pose Mode, and all vertices that "
                "follow them more than other bones", 'BONE_DATA', 0),
               ('MASK', "Masked Vertices", "What Sculpt Mode's mask covers", 'MOD_MASK', 1),
               ('VERTICES', "Selected Vertices", "What is selected in Edit Mode", 'VERTEXSEL', 2)),
        default='BONES',
    )

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return (live is not None and live.layout is not None and live.object() is not None
                and live.sculpt.phase == "ready" and "claims" in session.channel().capabilities)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        live = session.current()
        presence = live.sculpt.presence
        if self.what == 'BONES':
            chosen = selected_bones(live)
            claim = {"bones": chosen}
        else:
            chosen = masked_vertices(live) if self.what == 'MASK' else selected_vertices(live)
            claim = {"vertices": chosen}
        if len(chosen) == 0:
            self.report({'WARNING'}, f"{NOTHING[self.what]}.")
            return {'CANCELLED'}
        presence.claim(**claim)
        redraw_views()
        return {'FINISHED'}


class SKIND_OT_release(bpy.types.Operator):
    """Tell the others that you are done with what you claimed"""

    bl_idname = "skind.release"
    bl_label = "Release"
    bl_options = {'REGISTER'}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        live = session.current()
        return live is not None and live.layout is not None and bool(live.sculpt.presence.own)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        session.current().sculpt.presence.release()
        redraw_views()
        return {'FINISHED'}


register, unregister = bpy.utils.register_classes_factory((SKIND_OT_claim, SKIND_OT_release))
