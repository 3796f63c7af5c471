"""The job that plays an artist's session and takes the documents' pictures of it on the way.

A real window, real strokes, the real daemon, and at the end a second Blender that shares a session.
The character is Rigify's basic human, a little stouter than in the tests, and a slip of the brush is
in its weights: a part of the upper arm follows the forearm, and caves in. Each picture is the
window as it is and a box of it in pixels; ../pictures.py makes the files.
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import Iterator

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector

from inside import artist, panels, rigs
from inside.windows import Pixel, Steps, Window

STOUTNESS = 1.5  # of the limbs, against rigs.BODY_RADII
FAULT, FAULT_RADIUS = 0.25, 0.09  # weight that is on the wrong bone, and around where, in metres
STIFFNESS = 0.001  # weights follow the strokes more closely than by default
TILT, STROKES_MAX = 40, 2  # degrees from which the fault is seen; what mends it
BENT = 100  # degrees of the elbow in which it is sculpted
FLAT = (0.13, 0.13, 0.14)  # of the viewport: one colour, and none of the panel's, is easy to crop
CLOSE = (-190, -200, 230, 150)  # the elbow's picture around the viewport's middle, in pixels
SECONDS = 60.0  # for what a busy machine with software GL may take
CLAIMED = ("DEF-thigh.L", "DEF-shin.L", "DEF-foot.L", "DEF-toe.L")  # by the other; and .001 of each
OVERLAYS = ("RESIDUAL", "CHANGE", "INFLUENCES", "REACH")


class Album:
    """The pictures taken so far: name -> file, box (left, bottom, right, top), trim."""

    def __init__(self, window: Window, folder: str) -> None:
        self.window, self.folder = window, Path(folder)
        self.taken: dict[str, dict] = {}

    def take(self, name: str, box: tuple, trim: bool = False) -> Steps:
        """`trim`: what lies below the first row of the background alone is cut off."""
        system, shading = bpy.context.preferences.system, self.window.space.shading
        system.viewport_aa, shading.show_cavity = '8', True  # for pictures alone: they cost time
        yield 0.4  # paintings and the panel are up to date by then
        path = self.folder / f"{name}.png"
        yield from self.window.screenshot(str(path))
        system.viewport_aa, shading.show_cavity = 'OFF', False
        self.taken[name] = {"file": str(path), "box": box, "trim": trim}

    def panel(self, name: str) -> Steps:
        """The tab Skind of the sidebar."""
        bar = next(each for each in self.window.area.regions if each.type == 'UI')
        yield from self.take(name, (bar.x + 4, bar.y + 4, bar.x + bar.width - 26,
                                    bar.y + bar.height), trim=True)

    def close(self, name: str) -> Steps:
        """The middle of the viewport, without the sidebar."""
        with self._alone():
            x, y = self.window.middle()
            yield from self.take(name, (x + CLOSE[0], y + CLOSE[1], x + CLOSE[2], y + CLOSE[3]))

    def middle(self, name: str) -> Steps:
        """The viewport around the character as a whole, with the legend."""
        with self._alone():
            region = self.window.region
            x, y = self.window.middle()
            yield from self.take(name, (x - 300, region.y, region.x + region.width, y + 340))

    def view(self, name: str) -> Steps:
        """The whole viewport, with its bars."""
        area = self.window.area
        yield from self.take(name, (area.x, area.y, area.x + area.width, area.y + area.height))

    def corner(self, name: str) -> Steps:
        """The lower right part of the viewport, where the legends are, without the sidebar."""
        with self._alone():
            region = self.window.region
            x, y = self.window.middle()
            right = region.x + region.width
            yield from self.take(name, (x - 330, region.y, right, y + 200))

    @contextmanager
    def _alone(self) -> Iterator[None]:
        space = self.window.space
        space.show_region_ui = space.show_region_toolbar = False
        yield
        space.show_region_ui = space.show_region_toolbar = True


def story(window: Window, folder: str, flag: str) -> Steps:
    """From the first look to the last comparison; returns the album."""
    album = Album(window, folder)
    body, rig = character()
    _prepare(window)
    pose(rig, BENT)
    yield from _look_at_elbow(window, rig)
    yield from album.close("elbow-posed")
    yield from window.last_tab()
    yield from _beginning(window, album, body)
    yield from _sculpting(window, album, rig)
    yield from _seeing(window, album, rig)
    yield from _sharing(window, album, flag)
    return album.taken


def other(flag: str) -> None:
    """The second tool, Ben's: holds a session with the same character, makes a stroke in it, and
    claims the left leg."""
    bpy.context.preferences.addons["skind"].preferences.person = "Ben"
    body, rig = character()
    pose(rig, BENT)
    artist.wait_outside(flag, "hold", 300)
    live = artist.start(body)
    artist.signal_outside(flag, "held")
    artist.wait_outside(flag, "joined")
    artist.shift(body, artist.bendable(np.random.default_rng(0)), 0.2, 0.5)
    live.solve()
    artist.until(artist.is_settled)
    live.sculpt.presence.claim(bones=[bone for bone in live.sculpt.bones
                                       if bone.startswith(CLAIMED)])
    artist.wait_outside(flag, "seen")
    artist.stop("finish")


def character() -> tuple[bpy.types.Object, bpy.types.Object]:
    """(body, rig) with FK limbs; the rig is hidden, the body active."""
    rigs.clear()
    for name in set(rigs.BODY_RADII) - {"spine.006"}:  # the head is big enough
        rigs.BODY_RADII[name] *= STOUTNESS
    body, rig = rigs.rigify(levels=3)
    for limb in ("upper_arm", "thigh"):
        for side in "LR":
            rig.pose.bones[f"{limb}_parent.{side}"]["IK_FK"] = 1.0
    rig.hide_set(True)
    _spoil(body, rig)
    return body, rig


def _spoil(body: bpy.types.Object, rig: bpy.types.Object) -> None:
    """Lets a part of the upper arm follow the forearm."""
    pose(rig, BENT)
    away = np.linalg.norm(rigs.posed(body) - _spot(rig)[0], axis=1)
    near = np.flatnonzero(away < FAULT_RADIUS)
    wrong = body.vertex_groups["DEF-forearm.L"]
    for vertex in near.tolist():
        share = FAULT * (1 - (away[vertex] / FAULT_RADIUS) ** 2) ** 2
        for entry in body.data.vertices[vertex].groups:
            entry.weight *= 1 - share
        wrong.add([vertex], share, 'ADD')
    rigs.activate(body, "WEIGHT_PAINT")
    bpy.ops.object.vertex_group_limit_total(group_select_mode='BONE_DEFORM', limit=4)
    bpy.ops.object.vertex_group_normalize_all(group_select_mode='BONE_DEFORM')
    rigs.activate(body)


def _spot(rig: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """In the middle of the fault, on the upper arm's inner side as it should be; the way out."""
    place, upper, fore = _arm(rig)
    out = (fore - upper.dot(fore) * upper).normalized()
    return np.array(place - 0.16 * upper + 0.075 * out), np.array(out)


def pose(rig: bpy.types.Object, degrees: float) -> None:
    """The left elbow bent, a leg lifted."""
    rigs.pose(rig, {"forearm_fk.L": (degrees, 0, 0), "thigh_fk.L": (-0.8 * degrees, 0, 0),
                    "shin_fk.L": (0.9 * degrees, 0, 0)})


def _prepare(window: Window) -> None:
    """A viewport that shows the character and nothing that one must look past."""
    gradients = bpy.context.preferences.themes[0].view_3d.space.gradients
    gradients.background_type, gradients.high_gradient = 'SINGLE_COLOR', FLAT
    overlay = window.space.overlay
    for what in ("show_cursor", "show_floor", "show_axis_x", "show_axis_y", "show_text",
                 "show_object_origins", "show_outline_selected"):
        setattr(overlay, what, False)
    window.space.show_gizmo = False


def _arm(rig: bpy.types.Object) -> tuple[Vector, Vector, Vector]:
    """The elbow's place, and the ways of upper arm and forearm."""
    upper, fore = (rig.pose.bones[f"ORG-{name}.L"] for name in ("upper_arm", "forearm"))
    return (upper.tail.copy(), (upper.tail - upper.head).normalized(),
            (fore.tail - fore.head).normalized())


def _look_at_elbow(window: Window, rig: bpy.types.Object, distance: float = 0.75,
                   tilt: float = 0) -> Steps:
    """At right angles to the plane in which the arm bends, or tilted, degrees, to its inner side."""
    place, upper, fore = _arm(rig)
    axis = upper.cross(fore).normalized()
    back = -axis if axis.z < 0 else axis
    back.rotate(Quaternion(upper, np.radians(tilt) * np.sign(upper.cross(back).dot(fore))))
    eye = window.space.region_3d
    eye.view_perspective = 'ORTHO'
    eye.view_rotation = Matrix((upper, back.cross(upper), back)).transposed().to_quaternion()
    eye.view_location, eye.view_distance = place - 0.1 * upper, distance
    yield from window.drawn()


def _beginning(window: Window, album: Album, body: bpy.types.Object) -> Steps:
    """With a daemon: ready, the options, refused, begun."""
    session, _ = artist.modules()
    session.connect()
    yield from window.wait_until(lambda: session.channel().state == "ready", SECONDS)
    yield from album.panel("panel-ready")
    from skind.blender import panel_options
    with panels.opened(panel_options.SKIND_PT_options):
        yield from window.drawn()
        yield from album.panel("panel-options")
    modifier = body.modifiers["Armature"]
    modifier.use_deform_preserve_volume = True
    with window.context():
        try:
            bpy.ops.skind.start()
        except RuntimeError:
            pass  # what a refusal is to a script; the panel shows the sentence
    yield from album.panel("panel-refused")
    modifier.use_deform_preserve_volume = False
    artist.stiffen(STIFFNESS)
    with window.context():
        bpy.ops.skind.start()
    yield from _begun(window)


def _begun(window: Window) -> Steps:
    session, _ = artist.modules()
    yield from window.wait_until(lambda: session.current() is None or session.current().layout,
                                 SECONDS)
    assert session.current() is not None, session.told()


def _settled(window: Window) -> Steps:
    yield from window.wait_until(artist.is_settled, SECONDS)
    yield 0.05


def _way(begin: Pixel, end: Pixel, count: int = 12) -> list[Pixel]:
    return [tuple(np.array(begin) + (np.array(end) - begin) * step / (count - 1))
            for step in range(count)]


def _sculpting(window: Window, album: Album, rig: bpy.types.Object) -> Steps:
    """Pulls out what caved in: strokes while nobody answers, and a last one."""
    live = artist.modules()[0].current()
    yield from window.sculpt(live.object(), "builtin_brush.Grab", radius=85, strength=1.0)
    with window.context():
        bpy.ops.ed.undo_push(message="Sculpt Mode")
    spot, out = _spot(rig)

    def pull() -> Steps:
        yield from _look_at_elbow(window, rig, tilt=TILT)
        edge = _edge(live.object(), spot, out)
        begin = edge - 0.01 * out
        yield from window.stroke(_way(window.pixel(begin), window.pixel(begin + spot - edge)))
        yield from window.move((window.area.x + 5, window.area.y + 5))
        yield from _look_at_elbow(window, rig)

    with artist.halted():  # the sculpted shape, as long as the answer takes
        for _ in range(STROKES_MAX):
            if (spot - _edge(live.object(), spot, out)) @ out < 0.006:
                break
            yield from pull()
            yield 0.3
        yield from album.panel("panel-pending")
        yield from album.close("elbow-sculpted")
    yield from _settled(window)
    yield from pull()
    yield from _settled(window)
    yield from album.close("elbow-after")
    yield from album.panel("panel-sculpting")
    yield from album.view("overview")
    yield from _poses(window, album, live)


def _poses(window: Window, album: Album, live: object) -> Steps:
    """The box Poses, with a pose kept by hand; and without it again."""
    from skind.blender import panel, panel_options
    settings = bpy.context.scene.skind
    settings.keep_from, settings.keep = 'HAND', True
    with window.context():
        bpy.ops.skind.keep_pose()
    yield from window.wait_until(lambda: live.sculpt.guard.kept and live.sculpt.pins, SECONDS)
    with panels.opened(panel_options.SKIND_PT_poses), panels.away(panel.SKIND_PT_seeing):
        yield from window.drawn()
        yield from album.panel("panel-poses")
    settings.keep = False
    yield from window.wait_until(lambda: not live.sculpt.guard.is_set, SECONDS)
    yield from _settled(window)
    live.kept.clear()


def _edge(body: bpy.types.Object, spot: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Where the upper arm ends today on the line through a spot, inwards of it."""
    from_spot = rigs.posed(body) - spot
    along = from_spot @ out
    beside = np.linalg.norm(from_spot - along[:, None] * out, axis=1)
    return spot + along[(beside < 0.03) & (along < 0.02)].max() * out


def _seeing(window: Window, album: Album, rig: bpy.types.Object) -> Steps:
    """Each overlay, and before and after in other poses."""
    with window.context():
        bpy.ops.object.mode_set(mode='OBJECT')
        bpy.ops.ed.undo_push(message="Object Mode")
    live, settings = artist.modules()[0].current(), bpy.context.scene.skind
    settings.overlay_bone = "DEF-forearm.L"
    yield from _look_at_elbow(window, rig, 0.55, TILT)
    for overlay in OVERLAYS:
        settings.overlay = overlay
        yield from album.corner(f"overlay-{overlay.lower()}")
    settings.overlay = 'NONE'
    for degrees in (70, 120):
        pose(rig, degrees)
        yield from _look_at_elbow(window, rig)
        for before in (True, False):
            live.show(before)
            yield from album.close(f"{'before' if before else 'after'}-{degrees}")
    live.show(True)
    yield from album.view("before-word")
    live.show(False)


def _sharing(window: Window, album: Album, flag: str) -> Steps:
    """A session that another Blender holds: offered, joined, changed from there."""
    session, _ = artist.modules()
    session.current().finish()
    yield from window.wait_until(lambda: session.current() is None, SECONDS)
    yield from window.wait_until(lambda: not session.is_busy(), SECONDS)
    artist.signal_outside(flag, "hold")
    yield from window.wait_until((Path(flag) / "held").exists, SECONDS)
    session.ask_sessions()
    yield from window.wait_until(lambda: not session.is_busy() and session.available(), SECONDS)
    yield from album.panel("panel-join")
    assert session.join(bpy.context, session.available()[0]["session"]) == []
    yield from _begun(window)
    yield from _settled(window)
    strokes = session.current().sculpt.revision
    artist.signal_outside(flag, "joined")
    yield from window.wait_until(lambda: session.current().sculpt.revision > strokes, SECONDS)
    presence = session.current().sculpt.presence
    yield from window.wait_until(lambda: presence.claiming, SECONDS)
    yield from _settled(window)
    yield from album.panel("panel-shared")
    yield from window.look(session.current().object(), "corner", zoom=1.45)
    yield from album.middle("claimed")
    artist.signal_outside(flag, "seen")
