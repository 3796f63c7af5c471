"""Jobs that share a session with a script: who is here, who claims what, and what is seen of it."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import Iterator

import bpy
import numpy as np

from inside import artist, pen, rigs, seeing
from inside.windows import Steps, Window


@contextmanager
def script(user: str = "Ben") -> Iterator:
    """Another tool, attached to our session."""
    from skind.core import Link
    session, _ = artist.modules()
    with Link.connect(session.channel().path, name="skinctl", user=user) as link:
        link.call("session.attach", {"session": session.current().sculpt.name})
        yield link


def claim(link, **what: object) -> None:
    link.call("session.claim", {"session": artist.modules()[0].current().sculpt.name, **what})


def present(link) -> dict:
    """What the daemon tells of each tool, by its user."""
    name = artist.modules()[0].current().sculpt.name
    return {each["user"]: each
            for each in link.call("session.info", {"session": name})["present"]}


def told() -> dict:
    """A script comes, claims and goes; a stroke of ours goes into its claim."""
    from skind.blender import panel_sharing
    session, _ = artist.modules()
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    live = artist.start(mesh)
    presence = live.sculpt.presence
    alone = panel_sharing.SKIND_PT_sharing.poll(bpy.context)
    with script() as link:
        artist.until(lambda: presence.others)
        shown = panel_sharing.SKIND_PT_sharing.poll(bpy.context)
        (other,) = presence.others
        before = session.face()
        claim(link, vertices=np.arange(live.sculpt.vertices, dtype=np.uint32))
        artist.until(lambda: presence.claiming)
        noticed = session.face() != before
        artist.stroke(mesh, 1000, 0.3, 0.05)
        warning = session.told()
        claim(link)
        artist.until(lambda: not presence.claiming)
        artist.stroke(mesh, 1000, 0.3, 0.05)
        after = session.told()
    artist.until(lambda: not presence.others)
    artist.stop("cancel")
    return {"alone": alone, "shown": shown, "name": other.name, "tool": other.tool,
            "noticed": noticed, "warning": warning, "after": after}


def claiming() -> dict:
    """The button Claim for bones, the mask and vertices, each with nothing chosen and with some."""
    mesh, _ = artist.rigged("tube")
    armature = bpy.data.objects["TubeRig"]
    live = artist.start(mesh)
    seen: dict = {"claims": [], "refused": []}

    def press(what: str) -> None:
        try:
            result = bpy.ops.skind.claim(what=what)
        except RuntimeError as error:
            seen["refused"].append(str(error))
            return
        if result == {'CANCELLED'}:
            seen["refused"].append(what)
            return
        artist.until(artist.is_settled)
        mine = next(each for user, each in present(link).items() if user != "Ben")
        seen["claims"].append((mine["claim"], live.sculpt.presence.own.vertices.tolist()))
        seen["user"], seen["client"] = mine["user"], mine["client"]

    with script() as link:
        for bone in armature.pose.bones:
            _select(bone, False)
        mesh.data.vertices.foreach_set("select", np.zeros(len(mesh.data.vertices), bool))
        for what in ('BONES', 'MASK', 'VERTICES'):
            press(what)
        for name in ("bone.2", "bone.4"):
            _select(armature.pose.bones[name], True)
        press('BONES')
        rigs.activate(mesh)
        _mask(mesh)
        press('MASK')
        mesh.data.vertices.foreach_set("select", np.arange(len(mesh.data.vertices)) < 3)
        press('VERTICES')
        bpy.ops.object.mode_set(mode='EDIT')
        bpy.ops.mesh.select_all(action='SELECT')
        press('VERTICES')
        bpy.ops.object.mode_set(mode='OBJECT')
        bpy.ops.skind.release()
        artist.until(artist.is_settled)
        seen["released"] = {user: each["claim"] for user, each in present(link).items()}
        seen["may_release"] = bpy.ops.skind.release.poll()
    artist.stop("cancel")
    return seen


def _mask(thing: bpy.types.Object) -> None:
    """Masks every other vertex; before 4.1 a mask is made by Sculpt Mode alone, in a window."""
    from skind.blender import mesh as mesh_module
    wanted = (np.arange(len(thing.data.vertices)) % 2).astype(np.float32)
    if bpy.app.version >= (4, 1, 0):
        layer = thing.data.attributes.new(".sculpt_mask", "FLOAT", "POINT")
        layer.data.foreach_set("value", wanted)
    else:
        mesh_module.read_mask = lambda _mesh: wanted


def _select(bone: bpy.types.PoseBone, selected: bool) -> None:
    (bone if hasattr(bone, "select") else bone.bone).select = selected


def preferred(place: str, person: str) -> tuple[str, dict]:
    """A session at this place, in the name of this person: the channel's path, and who is there."""
    preferences = bpy.context.preferences.addons["skind"].preferences
    preferences.socket, preferences.person = place, person
    session, _ = artist.modules()
    mesh, _ = artist.rigged("tube")
    live = artist.start(mesh)
    (alone,) = artist.call("session.info", {"session": live.sculpt.name})["present"]
    artist.stop("finish")
    return session.channel().path, alone


OVERLAYS = ('NONE', 'INFLUENCES', 'RESIDUAL')


def overlays(window: Window, folder: str) -> Steps:
    """Each overlay without a claim, with one of the tube's upper half, and without it again."""
    live = yield from pen.begin(window)
    with window.context():
        bpy.ops.object.mode_set(mode='OBJECT')
    yield from window.move((window.area.x + 5, window.area.y + window.area.height - 5))
    presence, settings = live.sculpt.presence, bpy.context.scene.skind
    thing = live.object()
    before, seen = artist.facts(thing), {}
    upper = np.flatnonzero(rigs.co(thing)[:, 2] > np.median(rigs.co(thing)[:, 2]))
    with script() as link:
        yield from window.wait_until(lambda: presence.others)
        for when, vertices in (("free", []), ("claimed", upper), ("released", [])):
            claim(link, vertices=np.array(vertices, np.uint32))
            yield from window.wait_until(lambda: presence.claimed(
                live.sculpt.shown, live.sculpt.bones).sum() == len(vertices))
            for overlay in OVERLAYS:
                settings.overlay = overlay
                seen[overlay, when] = yield from seeing._picture(
                    window, Path(folder) / f"{overlay}-{when}.png")
    settings.overlay = 'NONE'
    posed = rigs.posed(thing)
    pixels = {half: [_in_view(window, posed[vertex]) for vertex in _seen(window, thing, which)]
              for half, which in (("upper", upper),
                                  ("lower", np.setdiff1d(np.arange(len(posed)), upper)))}
    return {"pictures": seen, "pixels": pixels, "told": artist.modules()[0].told(),
            "left": artist.different(before, artist.facts(thing))}


def playing(window: Window) -> Steps:
    """What the painting of a claim depends on: in a pose, in another while a clip plays, after."""
    from skind.blender import overlays as module

    live = yield from pen.begin(window)
    seen = []

    def look() -> Steps:
        yield 0.3
        yield from window.drawn()
        seen.append(module._state.shown.key)

    def switch() -> None:
        with window.context():
            bpy.ops.screen.animation_play()

    with script() as link:
        claim(link, bones=["bone.2"])
        yield from window.wait_until(lambda: live.sculpt.presence.claiming)
        yield from look()
        switch()
        rigs.bend(bpy.data.objects["TubeRig"], -25)
        yield from look()
        switch()
        yield from look()
    return seen


def _in_view(window: Window, place: np.ndarray) -> tuple[int, int]:
    x, y = window.pixel(place)
    return x - window.region.x, y - window.region.y


def _seen(window: Window, thing: bpy.types.Object, vertices: np.ndarray) -> list[int]:
    """Some of these that nothing hides."""
    found = []
    for vertex in vertices[::7].tolist():
        try:
            window.over(thing, vertex, near=0.01)
        except AssertionError:
            continue
        found.append(vertex)
    return found
