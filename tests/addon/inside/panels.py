"""A job in a window that shows the panel in its states."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import Iterator

import bpy

from inside import artist, rigs
from inside.windows import Steps, Window
from skind.blender import panel


def _open(panel: type) -> None:
    """Has a panel that begins closed begin open; to be called before it is first drawn."""
    bpy.utils.unregister_class(panel)
    panel.bl_options = set()
    bpy.utils.register_class(panel)


@contextmanager
def opened(closed: type) -> Iterator[None]:
    """A box that begins closed, unfolded: in its place one that is open from the beginning."""
    unfolded = type(f"{closed.__name__}_open", (panel.Panel, bpy.types.Panel),
                    {"bl_label": closed.bl_label, "bl_parent_id": closed.bl_parent_id,
                     **{name: vars(closed)[name] for name in vars(closed)
                        if name == "draw" or name.startswith("_") and callable(
                            getattr(closed, name)) and not name.startswith("__")}})
    bpy.utils.unregister_class(closed)
    bpy.utils.register_class(unfolded)
    yield
    bpy.utils.unregister_class(unfolded)
    bpy.utils.register_class(closed)


def states(window: Window, folder: str) -> Steps:
    """Idle, refused, connected, sculpting after a stroke with the options open; then the poses.

    A picture of each; returns what was refused, and the last answer.
    """
    from skind.blender import operators, panel_options, session

    def picture(name: str) -> Steps:
        panel.tag_redraw()
        yield from window.screenshot(str(Path(folder) / f"{name}.png"))

    rigs.clear()
    mesh, armature = rigs.tube(2000, 6)
    rigs.pose(armature, {"bone.2": (40, 0, 0)})
    rigs.activate(mesh)
    yield from window.look(mesh)
    _open(panel_options.SKIND_PT_options)
    _open(panel.SKIND_PT_notes)
    yield from window.last_tab()
    yield from picture("idle")

    mesh.shape_key_add(name="Basis")
    with window.context():
        try:
            bpy.ops.skind.start()
        except RuntimeError as error:
            reported = str(error)
        shown = operators.refusals(bpy.context)
    yield from picture("refused")
    mesh.shape_key_clear()

    session.connect()
    yield from window.wait_until(lambda: session.channel().state == "ready")
    mesh.vertex_groups[0].lock_weight = True
    mesh.vertex_groups[0].add([0], 0.3, 'REPLACE')  # no longer sums to one: something to mend
    yield from picture("connected")

    with window.context():
        bpy.ops.skind.start()
        forgotten = operators.refusals(bpy.context)
    yield from window.wait_until(lambda: session.current().layout is not None)
    artist.bump(mesh, 1000, 0.3, 0.1)
    with window.context():
        bpy.ops.skind.solve()
    yield from window.wait_until(artist.is_settled)
    yield from picture("sculpting")
    live = session.current()
    bpy.utils.unregister_class(panel_options.SKIND_PT_options)  # room for the other box
    settings = bpy.context.scene.skind
    settings.keep, settings.keep_from = True, 'HAND'
    with window.context():
        bpy.ops.skind.keep_pose()
    yield from window.wait_until(lambda: live.sculpt.guarded and live.sculpt.pins)
    yield from window.wait_until(artist.is_settled)
    with opened(panel_options.SKIND_PT_poses):
        yield from picture("poses")
    pins, kept = len(live.sculpt.pins), len(live.sculpt.guarded)
    bpy.utils.register_class(panel_options.SKIND_PT_options)
    live.cancel()
    yield from window.wait_until(lambda: session.current() is None)
    return {"reported": reported, "shown": shown, "forgotten": forgotten,
            "pins": pins, "kept": kept, "last": dict(live.sculpt.last),
            "notes": [note["name"] for note in live.sculpt.notes]}
