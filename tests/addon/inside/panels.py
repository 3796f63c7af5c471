"""A job in a window that shows the panel in its states."""

from __future__ import annotations

import resource
from contextlib import contextmanager
from pathlib import Path
from typing import Callable, Iterator

import bpy
import numpy as np

from inside import artist, claims, rigs
from inside.windows import Steps, Window
from skind.blender import panel, panel_options, panel_sharing


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
    _put_in_order()


def _put_in_order() -> None:
    """Boxes stand in the order in which they were registered."""
    boxes = [box for box in (*panel.CLASSES[1:], *panel_sharing.CLASSES, *panel_options.CLASSES)
             if hasattr(bpy.types, box.__name__)]
    for box in boxes:
        bpy.utils.unregister_class(box)
    for box in boxes:
        bpy.utils.register_class(box)


@contextmanager
def away(box: type) -> Iterator[None]:
    """Room for another: without this box."""
    bpy.utils.unregister_class(box)
    yield
    bpy.utils.register_class(box)
    _put_in_order()


def shared(window: Window, picture: Callable[[str], Steps]) -> Steps:
    """Another tool is here and claims; we do; it is gone, and we still do."""
    from skind.blender import session
    presence = session.current().sculpt.presence
    with claims.script() as link:
        yield from window.wait_until(lambda: presence.others)
        yield from picture("alone with one")
        bones = [f"bone.{index}" for index in range(6)]
        claims.claim(link, bones=bones, vertices=np.arange(12, dtype=np.uint32))
        yield from window.wait_until(lambda: presence.claiming)
        presence.claim(bones=bones[:1])
        yield from picture("shared")
    yield from window.wait_until(lambda: not presence.others)
    yield from picture("left")
    presence.release()


def full_disk(window: Window, mesh: bpy.types.Object, picture: Callable[[str], Steps]) -> Steps:
    """The daemon's files may not grow for a while."""
    sculpt, pid = artist.modules()[0].current().sculpt, artist.daemon_pid()
    limits = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (4096, limits[1]))
    artist.bump(mesh, 300, 0.3, 0.1)
    with window.context():
        bpy.ops.skind.solve()
    yield from window.wait_until(lambda: sculpt.unkept and artist.is_settled())
    yield from picture("not kept")
    resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)
    yield from window.wait_until(lambda: not sculpt.unkept)


def states(window: Window, folder: str) -> Steps:
    """Idle, refused, connected, sculpting after a stroke with the options open; then the poses.

    A picture of each; returns what was refused, and the last answer.
    """
    from skind.blender import operators, session

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
    settings = bpy.context.scene.skind
    settings.keep, settings.keep_from = True, 'HAND'
    with window.context():
        bpy.ops.skind.keep_pose()
    yield from window.wait_until(lambda: live.sculpt.guard.kept and live.sculpt.pins)
    yield from window.wait_until(artist.is_settled)
    with opened(panel_options.SKIND_PT_poses), away(panel_options.SKIND_PT_options):
        yield from picture("poses")
    pins, kept = len(live.sculpt.pins), len(live.sculpt.guard.kept)
    yield from shared(window, picture)
    yield from full_disk(window, mesh, picture)
    live.cancel()
    yield from window.wait_until(lambda: session.current() is None)
    return {"reported": reported, "shown": shown, "forgotten": forgotten,
            "pins": pins, "kept": kept, "last": dict(live.sculpt.last),
            "notes": [note["name"] for note in live.sculpt.notes]}
