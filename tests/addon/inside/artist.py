"""An artist's session without a window: begins, sculpts by moving vertices, waits, compares.

The timer does not run in the background, so what waits turns the pump by hand.
"""

from __future__ import annotations

import os
import signal
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Callable, Iterator

import bpy
import numpy as np

from inside import rigs


def modules():
    """The add-on's modules, under the name that they are enabled by."""
    import skind.blender.pump
    import skind.blender.session
    return skind.blender.session, skind.blender.pump


def until(true: Callable[[], object], seconds: float = 20.0) -> None:
    """Turns the pump until it is so."""
    _, pump = modules()
    end = time.monotonic() + seconds
    while not true():
        pump.tick()
        if time.monotonic() > end:
            session, _ = modules()
            raise TimeoutError(f"still not so after {seconds:g} s; the panel says: "
                               f"{session.told()!r}, {session.channel().problem!r}")
        time.sleep(0.001)


def rigged(kind: str, mesh_name: str = "") -> tuple[bpy.types.Object, bpy.types.Object]:
    """(mesh, armature) alone in the scene: "tube", "rigify", or the path of a file.

    "thin" is a tube with two influences a vertex and no group of one bone: a session adds more.
    """
    rigs.clear()
    if kind == "thin":
        mesh, rig = rigs.tube(2000, 6)
        for vertex in mesh.data.vertices:
            light = sorted(vertex.groups, key=lambda entry: entry.weight)[:-2]
            for group in [entry.group for entry in light]:
                mesh.vertex_groups[group].remove([vertex.index])
        mesh.vertex_groups.remove(mesh.vertex_groups["bone.3"])
        return mesh, rig
    if kind == "tube":
        return rigs.tube(2000, 6)
    if kind == "rigify":
        return rigs.rigify()
    meshes, rig = rigs.imported(kind)
    return next(mesh for mesh in meshes if mesh_name in ("", mesh.name)), rig


def settings():
    return bpy.context.scene.skind


def stiffen(stiffness: float) -> None:
    """Sets the stiffness by hand."""
    settings().automatic, settings().stiffness = False, stiffness


def is_settled() -> bool:
    """Nothing is under way, and what came is shown."""
    session, _ = modules()
    live = session.current()
    return session.channel().state == "ready" and not session.is_busy() and (
        live is None or live.sculpt is not None and live.sculpt.phase in ("ready", "ended")
        and live.sculpt.is_settled and not live.sculpt.pending and not live.sculpt.arrived)


def start(thing: bpy.types.Object):
    """Starts a session on an object; returns it when strokes are taken."""
    session, _ = modules()
    rigs.activate(thing)
    refusals = session.start(bpy.context)
    assert refusals == [], refusals
    until(lambda: session.current() is None or session.current().layout is not None)
    assert session.current() is not None, session.told()
    return session.current()


def stop(how: str) -> None:
    """Ends the session by "finish" or "cancel", and waits for it."""
    session, _ = modules()
    getattr(session.current(), how)()
    until(lambda: session.current() is None)
    until(lambda: not session.is_busy())


def daemon_pid() -> int:
    session, _ = modules()
    return session.channel().hello["server"]["pid"]


@contextmanager
def halted() -> Iterator[None]:
    """The daemon stands still meanwhile: what is sent to it waits."""
    pid = daemon_pid()
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def stroke(thing: bpy.types.Object, vertex: int, radius: float, out: float) -> np.ndarray:
    """A bump, and its answer. Returns what bump() does."""
    target = bump(thing, vertex, radius, out)
    assert modules()[0].current().solve() > 0
    until(is_settled)
    return target


def bump(thing: bpy.types.Object, vertex: int, radius: float, out: float) -> np.ndarray:
    """Sculpts as a brush does: moves rest vertices around one, seen in the pose. [V,3] as shown."""
    posed, away = _around(thing, vertex)
    moved = away < radius
    centre = posed.mean(0)
    direction = (posed[vertex] - centre) / np.linalg.norm(posed[vertex] - centre)
    target = posed.copy()
    target[moved] += direction * out * (1 - (away[moved, None] / radius) ** 2) ** 2
    sculpt_to(thing, target, moved)
    return target


def shift(thing: bpy.types.Object, vertex: int, radius: float, share: float) -> np.ndarray:
    """Sculpts what weights can do: towards where other weights on the same slots would take it.

    Around a vertex, up to `share` of each vertex's heaviest slot goes to its second. [V,3].
    """
    _, away = _around(thing, vertex)
    moved = away < radius
    target = _shifted(np.where(moved, share * (1 - (away / radius) ** 2) ** 2, 0))
    sculpt_to(thing, target, moved)
    return target


def bendable(random: np.random.Generator) -> int:
    """One of the vertices that a shift of weights moves most in this pose."""
    moves = np.linalg.norm(_shifted(np.full(modules()[0].current().sculpt.vertices, 0.3))
                           - _shifted(np.zeros(1)), axis=1)
    return int(random.choice(np.argsort(moves)[-max(1, len(moves) // 20):]))


def _shifted(shares: np.ndarray) -> np.ndarray:
    """f64 [V,3]: the pose if a share of each vertex's heaviest slot were its second's."""
    from skind.core import skin
    live = modules()[0].current()
    sculpt = live.sculpt
    rows, every = sculpt.weights.astype(np.float64), np.arange(sculpt.vertices)
    second, first = np.argsort(np.where(sculpt.joints == skin.NO_BONE, -1, rows), axis=1)[:, -2:].T
    taken = np.where(sculpt.joints[every, second] == skin.NO_BONE, 0, shares * rows[every, first])
    rows[every, first] -= taken
    rows[every, second] += taken
    return skin.blend(sculpt.rest, sculpt.joints, rows,
                      skin.deformations(live.pose(), sculpt.rig.binds))


def _around(thing: bpy.types.Object, vertex: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the vertices are in the pose, f64 [V,3], and how far each is from one of them."""
    live = modules()[0].current()
    posed = live.sculpt.posed(slice(None), live.pose(), positions=rigs.co(thing))
    return posed, np.linalg.norm(posed - posed[vertex], axis=1)


def sculpt_to(thing: bpy.types.Object, target: np.ndarray, moved: np.ndarray) -> None:
    """Moves rest vertices so that they are seen at their targets, as Sculpt Mode does it: back
    through each vertex's own blended matrix."""
    from skind.core import skin
    live = modules()[0].current()
    sculpt = live.sculpt
    matrices = skin.deformations(live.pose(), sculpt.rig.binds)
    rows = sculpt.weights[moved].astype(np.float64)
    joints = np.where(sculpt.joints == skin.NO_BONE, 0, sculpt.joints)[moved]
    blended = np.einsum("vn,vnij->vij", rows / rows.sum(1, keepdims=True), matrices[joints])
    blended[sculpt.rig.unweighted[moved]] = np.eye(4)
    back = np.linalg.inv(blended)
    rest = rigs.co(thing)
    rest[moved] = (np.einsum("nij,nj->ni", back[:, :3, :3], target[moved]) + back[:, :3, 3])
    put(thing, rest)


def put(thing: bpy.types.Object, positions: np.ndarray) -> None:
    """Gives the mesh this rest shape."""
    thing.data.vertices.foreach_set("co", positions.ravel())
    thing.data.update()


def call(method: str, params: dict) -> dict:
    """A request on the add-on's own connection, and its result."""
    session, _ = modules()
    answers: list = []
    session.channel().request(method, params, lambda *answer: answers.append(answer))
    until(lambda: answers)
    result, error = answers[0]
    if error is not None:
        raise error
    return result


def edit(method: str, params: dict) -> dict:
    """A step that is no stroke, shown; its answer."""
    answers: list[dict] = []
    modules()[0].current().edit(method, params, answers.append)
    until(is_settled)
    assert answers, modules()[0].told()
    return answers[0]


def daemon_weights() -> np.ndarray:
    """What the daemon holds: f32 [V,N]."""
    return call("weights.get", {"session": modules()[0].current().sculpt.name})["weights"]


def mesh_weights() -> np.ndarray:
    """What the mesh holds in the session's slots: f32 [V,N]."""
    from skind.blender import weights
    session, _ = modules()
    live = session.current()
    return weights.read_rows(live.object_name, live.layout, np.arange(live.sculpt.vertices))


def equal() -> bool:
    """Mesh, mirror and daemon hold the same weights, bit for bit, where a bone moves the vertex."""
    sculpt = modules()[0].current().sculpt
    mesh, held = mesh_weights(), daemon_weights()
    moved = ~sculpt.rig.unweighted
    alike = len(sculpt.shown.differing(sculpt.held)) == 0 and not sculpt.shown.reshaped(sculpt.held)
    return alike and (mesh[moved].tobytes() == held[moved].tobytes()
            == sculpt.weights[moved].tobytes() == sculpt.held.weights[moved].tobytes())


def signal_outside(flag: str, name: str) -> None:
    """Tells the test, or another job, how far this one is: `flag` is a folder of both."""
    (Path(flag) / name).touch()


def wait_outside(flag: str, name: str, seconds: float = 60.0) -> None:
    """Goes on working until the test, or another job, says so."""
    until((Path(flag) / name).exists, seconds)


# What a mesh object is made of, as values to compare: floats by their bits.


def facts(thing: bpy.types.Object) -> dict:
    """All that Start and Cancel must leave as it was."""
    bpy.context.view_layer.update()  # the object's box is of what was evaluated last
    data = thing.data
    return {
        "co": rigs.co(thing).tobytes(),
        "entries": [[(entry.group, np.float32(entry.weight).tobytes()) for entry in vertex.groups]
                    for vertex in data.vertices],
        "groups": [(group.name, group.lock_weight) for group in thing.vertex_groups],
        "active": thing.vertex_groups.active_index,
        "modifiers": [properties(modifier) for modifier in thing.modifiers],
        "object": properties(thing), "mesh": properties(data),
        "custom": (custom(thing), custom(data)),
    }


def custom(block: bpy.types.ID) -> dict:
    """Its custom properties."""
    return {name: repr(getattr(block[name], "to_dict", lambda: block[name])())
            for name in block.keys()}


def properties(block: bpy.types.bpy_struct) -> dict[str, str]:
    """All its RNA properties; of collections the length, of pointers the name."""
    found = {}
    for each in block.bl_rna.properties:
        value = getattr(block, each.identifier)
        if each.type == "COLLECTION":
            found[each.identifier] = str(len(value))
        elif each.type == "POINTER":
            found[each.identifier] = getattr(value, "name", str(value is None))
        elif getattr(each, "is_array", False):
            found[each.identifier] = repr(np.array(value).tolist())
        else:
            found[each.identifier] = repr(value)
    return found


def different(before: dict, after: dict, within: str = "") -> list[str]:
    """What is not the same, each with both values."""
    found = []
    for name in {**before, **after}:
        old, new = before.get(name), after.get(name)
        if isinstance(old, dict) and isinstance(new, dict):
            found += different(old, new, f"{within}{name}.")
        elif old != new:
            found.append(f"{within}{name}: {old!r:.200} -> {new!r:.200}")
    return found


def added_zeros(before: dict, thing: bpy.types.Object) -> int:
    """How many entries of weight zero are in groups that their vertices were not in before."""
    theirs = [{before["groups"][group][0] for group, _ in row} for row in before["entries"]]
    names = [group.name for group in thing.vertex_groups]
    return sum(entry.weight == 0 and names[entry.group] not in theirs[vertex.index]
               for vertex in thing.data.vertices for entry in vertex.groups)


def apart(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points.astype(np.float64) - others, axis=1)
