"""Jobs in a window that look at the overlays and at before and after, with the real daemon."""

from __future__ import annotations

from pathlib import Path
from typing import Callable

import bpy
import numpy as np

from inside import artist, pen, rigs
from inside.windows import Steps, Window

OVERLAYS = ("RESIDUAL", "CHANGE", "INFLUENCES", "REACH")


def _picture(window: Window, path: Path) -> Steps:
    """The viewport as it is drawn, u8 [height,width,3]; also left as a PNG."""
    yield 0.3  # a painting that did not fit into one redraw is ready by then
    yield from window.screenshot(str(path))
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    region = window.region
    pixels = (pixels.reshape(height, width, -1)[:, :, :3] * 255).round().astype(np.uint8)
    return pixels[region.y:region.y + region.height, region.x:region.x + region.width]


def _sculpted(window: Window, character: int | str) -> Steps:
    """A session with a few answered strokes, looked at out of Sculpt Mode, without a cursor."""
    live = yield from pen.begin(window, character)
    for x, y in window.surface(live.object(), 4):
        yield from window.stroke([(x + 5 * k, y + 4 * k) for k in range(6)])
        yield from pen.settled(window)
    with window.context():
        bpy.ops.object.mode_set(mode='OBJECT')
    yield from window.move((window.area.x + 5, window.area.y + window.area.height - 5))
    return live


def overlays(window: Window, folder: str, character: int | str = 2000) -> Steps:
    """A picture of each overlay, one without before and after them, and what they left behind."""
    live = yield from _sculpted(window, character)
    settings, thing = bpy.context.scene.skind, live.object()
    thing.vertex_groups.active_index = thing.vertex_groups.find(live.sculpt.bones[2])
    before = artist.facts(thing)
    seen = {}
    for name in ("none", *OVERLAYS, "none again"):
        settings.overlay = name if name in OVERLAYS else 'NONE'
        seen[name] = yield from _picture(window, Path(folder) / f"{name}.png")
    return {"pictures": seen, "left": artist.different(before, artist.facts(thing))}


def moved(window: Window, folder: str) -> Steps:
    """An overlay, the pose changed beneath it, and the pose again with a fresh painting."""
    yield from _sculpted(window, 2000)
    bpy.context.scene.skind.overlay = 'INFLUENCES'
    seen = []
    for angle in (25, -40, 25):
        rigs.bend(bpy.data.objects["TubeRig"], angle)
        seen.append((yield from _picture(window, Path(folder) / f"{len(seen)}.png")))
    return seen


def fault(window: Window, folder: str) -> Steps:
    """An overlay that raises while it is drawn; then another one, which does not."""
    from skind.blender import session
    from skind.core import colours

    yield from _sculpted(window, 2000)
    settings = bpy.context.scene.skind
    whole, colours.weight_change = colours.weight_change, None
    settings.overlay = 'CHANGE'
    yield 0.5
    seen = {"overlay": settings.overlay, "told": session.told()}
    colours.weight_change = whole
    settings.overlay = 'CHANGE'
    seen["after"] = yield from _picture(window, Path(folder) / "after.png")
    settings.overlay = 'NONE'
    seen["none"] = yield from _picture(window, Path(folder) / "none.png")
    return seen


def compare(window: Window, folder: str) -> Steps:
    """Y held and let go, held and Esc, the switch there and back: weights at each moment."""
    live = yield from _sculpted(window, 2000)
    seen = []

    def note(what: str) -> Steps:
        picture = yield from _picture(window, Path(folder) / f"{what}.png")
        seen.append({"what": what, "mesh": artist.mesh_weights(), "picture": picture})

    def switch() -> None:
        with window.context():
            bpy.ops.skind.show_before()

    yield from note("after")
    yield from window.move(window.middle())
    yield from window.press("Y")
    yield from note("held")
    yield from window.release("Y")
    yield from note("released")
    yield from window.press("Y")
    yield from window.press("ESC")
    yield from window.release("ESC")
    yield from window.release("Y")
    yield from note("escaped")
    switch()
    yield from note("switched")
    switch()
    yield from note("switched back")
    return {"start": live.sculpt.start.weights.copy(), "now": live.sculpt.held.weights.copy(),
            "seen": seen}


def clip(window: Window, folder: str) -> Steps:
    """The clip played and stopped by our button, then by Blender's own; the scene around it."""
    from skind.blender import compare

    yield from _sculpted(window, 2000)
    scene, rig = bpy.context.scene, bpy.data.objects["TubeRig"]
    for frame, angle in ((11, 0), (31, 40)):
        rigs.bend(rig, angle)
        for bone in rig.pose.bones:
            bone.keyframe_insert("rotation_euler" if bone.rotation_mode != 'QUATERNION'
                                 else "rotation_quaternion", frame=frame)
    scene.frame_set(5)

    def facts() -> tuple:
        return (scene.frame_current, scene.use_preview_range, scene.frame_preview_start,
                scene.frame_preview_end)

    def call(operator: Callable) -> None:
        with window.context():
            operator()

    seen = {"before": facts(), "frames": [], "after": []}
    for stop in (bpy.ops.skind.play_clip, bpy.ops.screen.animation_play):
        call(bpy.ops.skind.play_clip)
        for _ in range(10):
            yield 0.1
            seen["frames"].append(scene.frame_current)
        seen["range"] = facts()[1:]
        call(bpy.ops.skind.show_before)
        seen["picture"] = yield from _picture(window, Path(folder) / "playing.png")
        call(bpy.ops.skind.show_before)
        call(stop)
        yield 0.6
        seen["after"].append(facts())
        assert not compare.is_playing()
    return seen
