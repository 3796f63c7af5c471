"""Jobs of a clumsy artist with a pen: whatever is held, dragged, left or deleted at a bad moment."""

from __future__ import annotations

import os
import signal

import bpy

from inside import artist, pen, rigs
from inside.windows import Pixel, Steps, Window


def drag(window: Window, at: Pixel, steps: int) -> Steps:
    """The pressed pen goes on; 50 ms a step, in which timers run."""
    for turn in range(steps):
        yield from window.move((at[0] + 8 * turn, at[1] + 4))
        yield 0.05


def changed(rest) -> int:
    """How many vertices are not at rest."""
    return int((rigs.co(bpy.data.objects["Tube"]) != rest).any(axis=1).sum())


def held(window: Window) -> Steps:
    """The pen is down while a session begins, while an answer lands on a filter, while it ends."""
    session, _ = artist.modules()
    live = yield from pen.begin(window)
    rest, found = rigs.co(live.object()), {}
    (x, y), (a, b) = window.surface(live.object(), 2)
    pid = artist.daemon_pid()

    os.kill(pid, signal.SIGSTOP)
    try:
        yield from window.stroke([(x + 4 * k, y) for k in range(6)])
        yield from window.tool("builtin.mesh_filter")
        yield from window.move((a, b))
        yield from window.press()
        yield from drag(window, (a, b), 4)
    finally:
        os.kill(pid, signal.SIGCONT)
    yield from drag(window, (a + 32, b), 10)
    found["dragged"] = len(live.sculpt.pending), changed(rest)
    yield from window.release()
    yield 0.1
    yield from pen.settled(window)
    found["filtered"] = live.sculpt.strokes, changed(rest), pen.state()

    yield from window.tool("builtin_brush.Draw", radius=60)
    os.kill(pid, signal.SIGSTOP)
    try:
        yield from window.stroke([(x + 4 * k, y) for k in range(6)])
        live.finish()
        yield from window.move((a, b))
        yield from window.press()
        yield from drag(window, (a, b), 3)
    finally:
        os.kill(pid, signal.SIGCONT)
    yield from drag(window, (a, b), 10)
    yield from window.release()
    yield from window.wait_until(lambda: session.current() is None)
    found["finished"] = live.sculpt.strokes, changed(rest)

    assert session.start(bpy.context) == []
    yield from window.move((a, b))
    yield from window.press()
    found["early"] = session.current().layout is None
    yield from drag(window, (a, b), 10)
    yield from window.release()
    yield from window.wait_until(lambda: session.current().layout)
    yield from window.stroke([(x + 4 * k, y) for k in range(6)])
    yield from pen.settled(window)
    found["begun"] = changed(rest), pen.state()
    return found


def strayed(window: Window) -> Steps:
    """The mode is changed before the answer, undo goes back slowly; then the mesh is deleted."""
    session, _ = artist.modules()
    live = yield from pen.begin(window)
    rest, found = rigs.co(live.object()), {}
    (x, y), = window.surface(live.object(), 1)
    pid = artist.daemon_pid()
    os.kill(pid, signal.SIGSTOP)
    try:
        yield from window.stroke([(x + 4 * k, y) for k in range(6)])
        with window.context():
            bpy.ops.object.mode_set(mode="OBJECT")
            bpy.ops.ed.undo_push(message="Object Mode")
    finally:
        os.kill(pid, signal.SIGCONT)
    yield 0.1
    yield from pen.settled(window)
    found["landed"] = live.sculpt.strokes, changed(rest)
    found["undone"] = []
    for _ in range(3):  # the weights, the mode, the stroke
        yield from window.key("Z", ctrl=True)
        yield 0.3
        found["undone"].append((live.sculpt.strokes, changed(rest) > 0))
    found["state"] = pen.state()

    armature = bpy.data.objects["TubeRig"]
    armature.data.bones["bone.3"].name = "other"
    found["renamed"] = (live.solve(), session.told())
    armature.data.bones["other"].name = "bone.3"
    with window.context():
        bpy.ops.object.mode_set(mode="OBJECT")
        bpy.ops.object.delete()
    yield from window.wait_until(lambda: "gone" in session.told())
    found["gone"] = session.told()
    live.finish()
    yield from window.wait_until(lambda: session.current() is None)
    return found
