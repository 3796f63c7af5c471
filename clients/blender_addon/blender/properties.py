# SPDX-License-Identifier: GPL-3.0-or-later
"""The artist's settings, `scene.skind`; they are saved with the file. Owns nothing else.

Which of them the daemon can do is told by core/options.py, and shown by panel.py.
"""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty


def redraw_views() -> None:
    """Asks for every 3D view to be drawn again."""
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            for area in window.screen.areas:
                if area.type == 'VIEW_3D':
                    area.tag_redraw()


def _seen_differently(_settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    redraw_views()


def _kept_differently(_settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    from . import session  # which needs what is here
    live = session.current()
    if live is not None:
        live.want_guard()


class SKIND_PG_settings(bpy.types.PropertyGroup):
    """See core/options.py for what goes to the daemon, and under which condition."""

    influences: EnumProperty(
        name="Influences",
        description="How many bones may move one vertex; the most that your game engine takes",
        items=(("4", "4", "At most four bones a vertex: what every engine takes"),
               ("8", "8", "At most eight bones a vertex")),
        default="4",
    )
    reduce: BoolProperty(
        name="Reduce to Fit",
        description="Where a vertex has more influences than that, keep its largest ones. "
                    "Otherwise such a mesh is refused",
        default=False,
    )
    durability: EnumProperty(
        name="Kept",
        description="What is left of a session when skind dies or the power fails",
        items=(("full", "All", "All that was answered: each stroke is on the disk before that"),
               ("second", "To 1 s", "All but the last second: for slow disks"),
               ("off", "Nothing", "Nothing: the session is on no disk")),
        default="full",
    )
    automatic: BoolProperty(
        name="Automatic",
        description="Stiffness is chosen for each stroke from what it asks for: small where "
                    "weights can follow, larger where they cannot",
        default=True,
    )
    stiffness: FloatProperty(
        name="Stiffness",
        description="How strongly the weights hold on to what they were (kappa). Small values "
                    "follow the stroke closely; large ones change less. Try 0.0001, 0.001, 0.01",
        min=0.0, soft_min=1e-5, soft_max=1.0, max=10.0, default=0.008, precision=5, step=0.1,
    )
    method: EnumProperty(
        name="Method",
        description="How a vertex's weights are found",
        items=(("exact", "Exact", "The weights that bring the vertex nearest, never farther away"),
               ("thesis", "Thesis", "The method of Rubino's thesis of 2020, for comparison")),
        default="exact",
    )
    slots: EnumProperty(
        name="Bones",
        description="Which bones a stroke may use for a vertex",
        items=(("KEEP", "Keep", "Those that the vertex has places for"),
               ("EVIDENCE", "Choose", "Others too, where those that it has cannot do what you "
                "sculpted: vertex groups change. Sculpt in several poses, which tell bones apart")),
        default="KEEP",
    )
    keep: BoolProperty(
        name="Keep Other Poses",
        description="Other poses keep their shape while this one is corrected, as far as that goes",
        default=False,
        update=_kept_differently,
    )
    keep_strength: FloatProperty(
        name="Strength",
        description="How much keeping other poses counts against this one (lambda)",
        min=0.0, soft_max=3.0, max=1000.0, default=0.3, step=5,
    )
    keep_from: EnumProperty(
        name="Poses From",
        description="Which poses are kept, besides those that you kept by hand",
        items=(("ACTIONS", "Actions", "Frames of all actions of this armature"),
               ("MARKERS", "Markers", "The frames that have a timeline marker"),
               ("CHOSEN", "Frames", "The frames that are named below"),
               ("HAND", "By Hand", "None but those that you keep with Keep This Pose")),
        default="ACTIONS",
        update=_kept_differently,
    )
    keep_frames: StringProperty(
        name="Frames",
        description="Frames to keep, for instance 1, 12, 20-30",
        default="",
        update=_kept_differently,
    )
    smoothing: FloatProperty(
        name="Smoothing",
        description="Smooths the change of the weights over the surface, not the weights (mu). Try "
                    "0.03",
        min=0.0, soft_max=0.1, max=10.0, default=0.0, precision=3, step=0.5,
    )
    mix: FloatProperty(
        name="Mix",
        description="How far a stroke goes: 1 all the way to what you sculpted, 0.5 half of it",
        min=0.0, max=1.0, default=1.0, subtype='FACTOR',
    )
    use_mask: BoolProperty(
        name="Sculpt Mask",
        description="Where Sculpt Mode's mask is, weights follow that much less",
        default=False,
    )
    residual: EnumProperty(
        name="Out of Reach",
        description="What happens with the rest of a stroke, where weights cannot follow",
        items=(("REPORT", "Report", "Only show it: the heat-map, and the count in the panel"),
               ("REST", "Rest", "Move the rest shape too"),
               ("SHAPE", "Shape", "Keep it as a corrective shape key of this pose")),
        default="REPORT",
    )
    overlay: EnumProperty(
        name="Overlay",
        description="What is painted over the mesh while you sculpt",
        items=(("NONE", "None", "The mesh as it is", 'X', 0),
               ("RESIDUAL", "Residual", "How far each vertex is from where you sculpted it",
                'MOD_WARP', 1),
               ("CHANGE", "Change", "Where weights have changed since the start",
                'MOD_VERTEX_WEIGHT', 2),
               ("INFLUENCES", "Influences", "How many bones move each vertex: red 1, orange 2, "
                "yellow 3, green 4, blue more", 'GROUP_VERTEX', 3),
               ("REACH", "One Bone", "Which vertices one bone moves, and how much",
                'BONE_DATA', 4)),
        default="NONE",
        update=_seen_differently,
    )
    overlay_bone: StringProperty(
        name="Bone",
        description="The bone whose reach is shown; empty: that of the active vertex group",
        default="",
        update=_seen_differently,
    )


def register() -> None:
    bpy.utils.register_class(SKIND_PG_settings)
    bpy.types.Scene.skind = PointerProperty(type=SKIND_PG_settings)


def unregister() -> None:
    del bpy.types.Scene.skind
    bpy.utils.unregister_class(SKIND_PG_settings)
