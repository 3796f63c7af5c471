"""Jobs that prove the harness itself."""

from __future__ import annotations

import os
import time
from typing import Iterator

import bpy
import numpy as np

from inside import rigs
from inside.windows import Window


def version() -> dict:
    return {"version": tuple(bpy.app.version), "background": bpy.app.background,
            "config": bpy.utils.user_resource("CONFIG"), "socket": os.environ["SKIND_SOCKET"]}


def double(values: np.ndarray) -> dict:
    return {"doubled": values * 2, "nested": [values.shape, None]}


def fail() -> None:
    raise ValueError("this is why")


def hang() -> None:
    time.sleep(600)


def mutter() -> int:
    """Returns, with a traceback that nobody caught beside it."""
    import traceback
    try:
        fail()
    except ValueError:
        traceback.print_exc()
    return 1


def preference(name: str) -> object:
    """One of the add-on's preferences."""
    return getattr(bpy.context.preferences.addons["skind"].preferences, name)


def facts(mesh: bpy.types.Object, rig: bpy.types.Object) -> dict:
    """A skinned mesh at rest, and when its rig is bent."""
    rigs.rest(rig)
    still = rigs.posed(mesh)
    rigs.bend(rig, 20)
    deform = [bone for bone in rig.data.bones if bone.use_deform]
    return {"co": rigs.co(mesh), "rest": still, "posed": rigs.posed(mesh),
            "weights": rigs.weights(mesh), "bones": len(rig.data.bones), "deform": len(deform),
            "bendy": sum(bone.bbone_segments > 1 for bone in deform), "users": mesh.data.users,
            "modifiers": [modifier.type for modifier in mesh.modifiers],
            "keys": mesh.data.shape_keys is not None}


def tube(vertices: int, bones: int) -> dict:
    rigs.clear()
    return facts(*rigs.tube(vertices, bones))


def rigify(**options: bool) -> dict:
    rigs.clear()
    return facts(*rigs.rigify(**options))


def imported(characters: list[tuple[str, str]]) -> list[dict]:
    """Facts about a mesh, by name, of each file."""
    found = []
    for path, name in characters:
        rigs.clear()
        meshes, rig = rigs.imported(path)
        mesh = next(mesh for mesh in meshes if mesh.name == name)
        found.append({**facts(mesh, rig), "clips": len(bpy.data.actions)})
    return found


def played(path: str, clip: str, frames: list[int]) -> list[np.ndarray]:
    """Where an imported character's vertices are in frames of one of its clips."""
    rigs.clear()
    (mesh, *_), rig = rigs.imported(path)
    # 3.4 appends the armature's name to the clip's.
    action = next(action for action in bpy.data.actions if action.name.startswith(clip))
    shapes = []
    for frame in frames:
        rigs.play(rig, action, frame)
        shapes.append(rigs.posed(mesh))
    return shapes


def strokes(window: Window, count: int, picture: str) -> Iterator[float]:
    """Draws `count` strokes on a tube, one more, and takes that back.

    Returns how far each of `count` moved the farthest vertex, how far the last pressed its
    vertex in, whether undo brought that back, and the size of a picture of it.
    """
    rigs.clear()
    mesh, _ = rigs.tube(10_000, 8)
    yield from window.look(mesh)
    yield from window.sculpt(mesh, "builtin_brush.Draw")
    moved = []
    for at in window.surface(mesh, count):
        before = rigs.co(mesh)
        yield from window.stroke([(at[0] + step, at[1] + step) for step in range(0, 12, 2)])
        moved.append(float(np.abs(rigs.co(mesh) - before).max()))
    # Over a vertex that looks at the eye, with Ctrl: it moves away from the eye, inwards.
    vertex = int(np.argmin(np.abs(rigs.co(mesh) - (0, -0.3, 1.8)).sum(1)))
    before = rigs.co(mesh)
    yield from window.stroke([window.over(mesh, vertex)] * 4, ctrl=True)
    pressed = float(rigs.co(mesh)[vertex, 1] - before[vertex, 1])
    yield from window.screenshot(picture)
    sculpted = rigs.co(mesh)
    yield from window.key("Z", ctrl=True)
    yield from window.wait_until(
        lambda: np.abs(rigs.co(bpy.data.objects["Tube"]) - sculpted).max() > 0)
    return {"moved": moved, "pressed": pressed, "undone": np.array_equal(rigs.co(bpy.data.objects["Tube"]), before),
            "size": tuple(bpy.data.images.load(picture).size)}
