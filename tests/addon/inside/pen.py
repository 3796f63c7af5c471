"""Jobs with a pen: real strokes with real events, in a window, against the real daemon."""

from __future__ import annotations

import os
import signal
import time
from typing import Callable

import bpy

from inside import artist, rigs
from inside import thesis as thesis_loop
from inside.windows import Steps, Window


def make(character: int | str) -> tuple[bpy.types.Object, bpy.types.Object]:
    """A bent character: a tube of so many vertices, Rigify's basic human, or a glTF file's."""
    if isinstance(character, int):
        mesh, rig = rigs.tube(character, 6)
    elif character == "rigify":
        mesh, rig = rigs.rigify()
    else:
        (mesh, *_), rig = rigs.imported(character)
        rigs.rest(rig)
    rigs.bend(rig, 25)
    return mesh, rig


def begin(window: Window, character: int | str = 2000) -> Steps:
    """A bent character in a session, in Sculpt Mode with the Draw brush, seen from the front."""
    session, _ = artist.modules()
    rigs.clear()
    mesh, rig = make(character)
    for other in bpy.context.view_layer.objects:
        other.hide_set(other != mesh)
    bpy.context.scene.skind.reduce = True
    rigs.activate(mesh)
    yield from window.look(mesh)
    with window.context():
        bpy.ops.ed.undo_push(message="Rigged")
    refusals = session.start(bpy.context)
    assert refusals == [], refusals
    yield from window.wait_until(lambda: session.current() is None or session.current().layout)
    assert session.current() is not None, session.told()
    yield from window.sculpt(mesh, radius=60)
    with window.context():
        bpy.ops.ed.undo_push(message="Sculpt Mode")
    return session.current()


def settled(window: Window, seconds: float = 20.0) -> Steps:
    yield from window.wait_until(artist.is_settled, seconds)
    yield 0.05


def state() -> dict:
    """What must be equal, bit for bit, whenever the same state is shown."""
    session, _ = artist.modules()
    live = session.current()
    return {"co": rigs.co(live.object()), "mesh": artist.mesh_weights(),
            "mirror": live.sculpt.weights.copy(), "truth": live.sculpt.held.weights.copy(),
            "state": live.sculpt.steps.live}


def strokes(window: Window, count: int, character: int | str = 2000) -> Steps:
    """`count` strokes, one after the other; how many were seen, and what came of them."""
    live = yield from begin(window, character)
    rest = rigs.co(live.object())
    places = window.surface(live.object(), count)
    seen = []
    for x, y in places:
        yield from window.stroke([(x + 4 * k, y + 3 * k) for k in range(6)])
        yield from settled(window)
        seen.append(live.sculpt.strokes)
    return {"seen": seen, "rest": rest, **state()}


def undo_redo(window: Window, count: int, mode: str, character: int | str = 2000) -> Steps:
    """Strokes, then in a mode undo to the first and redo to the last; the states on each way."""
    live = yield from begin(window, character)
    ways = {"forth": [state()], "undo": [], "redo": []}
    for x, y in window.surface(live.object(), count):
        yield from window.stroke([(x + 4 * k, y + 3 * k) for k in range(6)])
        yield from settled(window)
        ways["forth"].append(state())
    if mode != bpy.context.mode:  # without a step of undo, which would be one to take back
        with window.context():
            bpy.ops.object.mode_set(mode=mode)
    for way, shift in (("undo", False), ("redo", True)):
        for _ in range(count):
            yield from window.key("Z", ctrl=True, shift=shift)
            yield from settled(window)
            ways[way].append(state())
    return ways


def symmetry(window: Window) -> Steps:
    """A stroke beside the middle with mirroring on; where vertices got other weights."""
    live = yield from begin(window)
    rigs.rest(bpy.data.objects["TubeRig"])
    live.object().data.use_mirror_x = True
    rest = rigs.co(live.object())
    solve, shapes = live.solve, []

    def watch() -> int:
        shapes.append(rigs.co(live.object()))
        return solve()

    live.solve = watch
    x, y = window.middle()
    yield from window.stroke([(x + 30 + 2 * k, y + 20) for k in range(6)])
    yield from settled(window)
    return {"changed": rest[(shapes[0] != rest).any(axis=1)]}


def outside(window: Window) -> Steps:
    """A stroke, undo to before Start, redo, another stroke."""
    session, _ = artist.modules()
    groups_before = rigs.weights(make(2000)[0])
    live = yield from begin(window)
    x, y = window.middle()
    flags, states = [live.is_outside], []
    yield from window.stroke([(x + 4 * k, y) for k in range(6)])
    yield from settled(window)
    states.append(state())
    flags.append(live.is_outside)
    for _ in range(3):  # the stroke, Sculpt Mode, Start
        yield from window.key("Z", ctrl=True)
        yield 0.1
    flags.append(live.is_outside)
    groups_outside = rigs.weights(bpy.data.objects["Tube"])
    for _ in range(3):
        yield from window.key("Z", ctrl=True, shift=True)
        yield 0.1
    yield from settled(window)
    flags.append(live.is_outside)
    states.append(state())
    yield from window.stroke([(x + 4 * k, y + 60) for k in range(6)])
    yield from settled(window)
    flags.append(live.is_outside)
    return {"outside": flags, "states": states, "groups_before": groups_before,
            "groups_outside": groups_outside, "strokes": live.sculpt.strokes, "end": state()}


def across(window: Window) -> Steps:
    """Two sessions one after the other on a mesh, and undo back into the first."""
    session, _ = artist.modules()
    live = yield from begin(window)
    x, y = window.middle()
    yield from window.stroke([(x + 4 * k, y) for k in range(6)])
    yield from settled(window)
    name = live.sculpt.name
    live.finish()
    yield from window.wait_until(lambda: session.current() is None and not session.is_busy())
    assert session.start(bpy.context) == []
    yield from window.wait_until(lambda: session.current() is None or session.current().layout)
    live = session.current()
    yield from window.stroke([(x + 4 * k, y + 60) for k in range(6)])
    yield from settled(window)
    seen = [(live.is_outside, None)]
    end = state()
    for shift in (False, True):
        for _ in range(3):  # the stroke, Start, Finish
            yield from window.key("Z", ctrl=True, shift=shift)
            yield 0.2
            seen.append((live.is_outside, bpy.data.objects["Tube"].data.get("skind_session")))
    yield from settled(window)
    return {"same name": name == live.sculpt.name, "seen": seen, "end": end, "again": state()}


def daemon_pid() -> int:
    session, _ = artist.modules()
    return session.channel().hello["server"]["pid"]


def pending(window: Window) -> Steps:
    """Strokes, undo and redo while the daemon does not answer, and what is there when it does."""
    live = yield from begin(window)
    places = window.surface(live.object(), 3)
    pid, seen = daemon_pid(), []

    def see(what: str) -> None:
        seen.append({"what": what, "pending": len(live.sculpt.pending), **state()})

    see("begin")
    os.kill(pid, signal.SIGSTOP)
    try:
        for x, y in places:
            yield from window.stroke([(x + 4 * k, y + 3 * k) for k in range(6)])
            yield 0.1
            see("stroke")
        yield from window.key("Z", ctrl=True)
        yield 0.1
        see("undo")
        yield from window.key("Z", ctrl=True, shift=True)
        yield 0.1
        see("redo")
        yield from window.key("Z", ctrl=True)
        yield 0.1
        see("undo")
    finally:
        os.kill(pid, signal.SIGCONT)
    yield from settled(window)
    see("answered")
    for _ in range(2):
        yield from window.key("Z", ctrl=True)
        yield from settled(window)
        see("undo")
    for _ in range(2):
        yield from window.key("Z", ctrl=True, shift=True)
        yield from settled(window)
        see("redo")
    return seen


KINDS = (  # what is done with the pen: tool, keyword arguments of the stroke
    ("builtin_brush.Draw", {}),
    ("builtin_brush.Draw", {"ctrl": True}),
    ("builtin_brush.Draw", {"shift": True}),
    ("builtin_brush.Draw", {"hold": 0.5}),
    ("builtin_brush.Inflate", {}),
    ("builtin_brush.Grab", {}),
    ("builtin_brush.Smooth", {}),
    ("builtin_brush.Clay Strips", {}),
    ("builtin_brush.Crease", {}),
    ("builtin_brush.Pinch", {}),
    ("builtin_brush.Elastic Deform", {}),
    ("builtin_brush.Snake Hook", {}),
    ("builtin_brush.Pose", {}),
    ("builtin_brush.Cloth", {"pause": 0.03}),  # it simulates: a fast pen leaves it no time
)


def kinds(window: Window) -> Steps:
    """Every kind of stroke; how many strokes each gave, and whether the shape had changed."""
    live = yield from begin(window)
    solve, solved, seen = live.solve, [], []
    live.solve = lambda: solved.append(solve())
    for turn, (tool, how) in enumerate(KINDS):
        yield from window.tool(tool, radius=80)
        (x, y), = window.surface(live.object(), 1, seed=turn)
        solved.clear()
        yield from window.stroke([(x + 3 * k, y + k) for k in range(20)], **how)
        yield from settled(window)
        seen.append((tool, how, list(solved)))
    return {"seen": seen, **state()}


def dismiss(window: Window) -> Steps:
    """Leaves the popup in which Blender shows an operator's error; it would take the next press."""
    for place in ((100, 100), (400, 640), (100, 100)):
        yield from window.move(place)
        yield 0.1


def odd(window: Window) -> Steps:
    """Strokes that are cancelled, refused, or change nothing."""
    session, _ = artist.modules()
    live = yield from begin(window)
    (x, y), elsewhere = window.surface(live.object(), 2)
    rest = rigs.co(live.object())
    result = {}

    yield from window.move((x, y))
    yield from window.press()
    yield from window.move((x + 8, y + 8))
    yield from window.key("ESC")
    yield from window.release()
    yield from window.move((x + 20, y))
    yield from settled(window)
    result["escaped"] = (live.is_stroking, live.sculpt.strokes,
                         (rigs.co(live.object()) == rest).all())

    yield from window.stroke([(window.region.x + 70, window.region.y + 70)] * 3)
    yield from settled(window)
    result["beside"] = (live.is_stroking, live.sculpt.strokes)

    yield from window.tool("builtin_brush.Simplify")
    yield from window.stroke([(x + 4 * k, y) for k in range(4)])
    yield from settled(window)
    result["simplify"] = (live.is_stroking, live.sculpt.strokes, session.told())
    yield from dismiss(window)

    yield from window.tool("builtin_brush.Mask")
    yield from window.stroke([(x + 4 * k, y) for k in range(4)])
    yield from settled(window)
    result["mask"] = (live.is_stroking, live.sculpt.strokes)

    yield from window.tool("builtin_brush.Draw", radius=60)
    yield from window.stroke([(elsewhere[0] + 4 * k, elsewhere[1]) for k in range(4)])
    yield from settled(window)
    result["after"] = (live.is_stroking, live.sculpt.strokes)

    with window.context():
        bpy.ops.ed.undo_push(message="Before Dyntopo")
        bpy.ops.sculpt.dynamic_topology_toggle()
        bpy.ops.ed.undo_push(message="Dyntopo")
    yield from window.stroke([(x + 4 * k, y) for k in range(4)])
    yield from settled(window)
    result["dyntopo"] = (live.is_stroking, live.sculpt.strokes, session.told())
    yield from dismiss(window)
    with window.context():
        bpy.ops.sculpt.dynamic_topology_toggle()
        bpy.ops.ed.undo_push(message="Dyntopo off")
    yield 0.2
    result["reordered"] = (live.is_stroking, live.solve(), session.told())
    yield from window.key("Z", ctrl=True)
    yield from window.key("Z", ctrl=True)
    yield 0.2
    result["mended"] = (live.is_whole, live.solve(), session.told())
    return {**result, **state()}


def timed(call: Callable, spent: list[float]) -> Callable:
    """The call, adding the seconds that it takes to `spent`."""
    def wrapper(*arguments, **named):
        begun = time.perf_counter()
        try:
            return call(*arguments, **named)
        finally:
            spent.append(time.perf_counter() - begun)
    return wrapper


def cost(window: Window, vertices: int, radius: int, rounds: int) -> Steps:
    """What strokes cost the main thread, in seconds, in ours and in the thesis's way.

    `whole`: all that runs because of the stroke once it ends, with Blender's evaluation. `slices`:
    the pieces of our own code, without Blender's undo and evaluation in them.
    """
    from skind.blender import undo
    live = yield from begin(window, vertices)
    thing, rig = live.object(), bpy.data.objects["TubeRig"]
    _, pump = artist.modules()
    yield from window.tool("builtin_brush.Draw", radius=radius)
    x, y = window.middle()
    rows = []
    for turn in range(rounds):
        slices, blenders, solves, whole = [], [], [], []
        real = pump.tick, undo.take_back, undo.push, live.solve

        def tick() -> float:
            blenders.clear()
            begun = time.perf_counter()
            pause = real[0]()
            took = time.perf_counter() - begun
            slices.append(took - sum(blenders))
            whole.append(took)
            return pause

        bpy.app.timers.unregister(real[0])
        bpy.app.timers.register(tick, persistent=True)
        undo.take_back, undo.push = timed(undo.take_back, blenders), timed(undo.push, blenders)
        live.solve = timed(live.solve, solves)
        yield from window.stroke([(x + 6 * k - 30, y + 20 * (turn % 5) - 40) for k in range(10)])
        yield from window.wait_until(lambda: live.sculpt.strokes == turn + 1)
        begun = time.perf_counter()
        bpy.context.view_layer.update()
        evaluated = time.perf_counter() - begun
        undo.take_back, undo.push, live.solve = real[1:]
        bpy.app.timers.unregister(tick)
        bpy.app.timers.register(real[0], persistent=True)
        rows.append({"changed": live.sculpt.last["vertices"], "slices": slices + solves,
                     "parts": {"blender": list(blenders), "evaluated": evaluated},
                     "whole": sum(whole) + sum(solves) + evaluated})
    # The same kind of stroke, solved as the thesis does it, in the same Blender.
    session, _ = artist.modules()
    yield from settled(window)
    live.finish()
    yield from window.wait_until(lambda: session.current() is None)
    thing, rig = bpy.data.objects["Tube"], bpy.data.objects["TubeRig"]
    before = rigs.co(thing)
    yield from window.stroke([(x + 6 * k - 30, y - 40) for k in range(10)])
    begun = time.perf_counter()
    changed = thesis_loop.stroke(thing, rig, before)
    thing.data.update()
    bpy.context.view_layer.update()
    return {"rows": rows, "thesis": time.perf_counter() - begun, "thesis_changed": changed}
