"""Jobs about sessions to which something happens: a daemon that dies, a Blender that quits, a mesh
that is saved or undone in the middle. Without a window, against the real daemon."""

from __future__ import annotations

import os
import signal
import time

import bpy
import numpy as np

from inside import artist, rigs


def killed(times: int) -> list[dict]:
    """The daemon is killed again and again: between strokes, mid-stroke, mid-answer."""
    rigs.clear()
    mesh, rig = rigs.tube(20_000, 6)
    rigs.bend(rig, 25)
    session, pump = artist.modules()
    live = artist.start(mesh)
    artist.stiffen(1e-4)
    random, rest, seen, strokes = np.random.default_rng(3), rigs.co(mesh), [], 0
    for turn in range(times):
        when = ("between", "mid-stroke", "mid-answer")[turn % 3]
        # What comes in the middle of an answer must not fit into the socket: a stroke on all.
        artist.bump(mesh, int(random.integers(20_000)), 9.0 if when == "mid-answer" else 0.3, 0.03)
        answered = artist.mesh_weights()
        live.solve()
        (stroke,) = live.sculpt.pending
        solved = 0
        if when == "between":
            artist.until(artist.is_settled)
            answered = artist.mesh_weights()
            os.kill(artist.daemon_pid(), signal.SIGKILL)
        elif when == "mid-stroke":
            with artist.halted():
                for _ in range(5):
                    session.channel().pump(0.004)
                os.kill(artist.daemon_pid(), signal.SIGKILL)
        else:
            end = time.monotonic() + 20
            while not stroke.chunks and time.monotonic() < end:
                session.channel().pump(0.0)
            solved = stroke.solved
            os.kill(artist.daemon_pid(), signal.SIGKILL)
        artist.until(lambda: session.channel().state != "ready")
        if turn % 5:
            session.channel().open()  # at once; else after the pause, which grows
        kept = artist.mesh_weights().tobytes() == answered.tobytes()
        waits = len(live.sculpt.pending)
        artist.until(artist.is_settled, 30)
        strokes += 1
        untouched = np.setdiff1d(np.arange(20_000), stroke.vertices)
        seen.append({"when": when, "kept": kept, "waits": waits, "solved": solved,
                     "strokes": live.sculpt.strokes == strokes, "equal": artist.equal(),
                     "others": artist.mesh_weights()[untouched].tobytes()
                     == answered[untouched].tobytes(),
                     "rest": bool((rigs.co(mesh) == rest).all()), "phase": live.sculpt.phase})
    artist.stop("finish")
    return seen


def left(how: str) -> dict:
    """One answered stroke and one on its way; then the add-on is disabled, or Blender quits."""
    import addon_utils
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    before = artist.facts(mesh)
    live = artist.start(mesh)
    rest = rigs.co(mesh)
    artist.stroke(mesh, 1030, 0.3, 0.05)
    answered = rigs.weights(mesh)
    artist.bump(mesh, 300, 0.3, 0.05)
    live.solve()
    pid, name = artist.daemon_pid(), live.sculpt.name
    facts = {"pid": pid, "started": artist.modules()[0].channel().launcher.started}
    if how == "halted":
        os.kill(pid, signal.SIGSTOP)
    if how != "disable":
        return facts  # the harness quits
    begun = time.monotonic()
    addon_utils.disable("skind")
    facts["seconds"] = time.monotonic() - begun
    facts["rest"] = bool((rigs.co(mesh) == rest).all())
    facts["kept"] = bool((rigs.weights(mesh) == answered).all())
    facts["remembered"] = mesh.data.get("skind_session") == name
    addon_utils.enable("skind", default_set=True)
    again = bpy.context.object
    session, _ = artist.modules()
    assert session.rejoin(bpy.context) == [], again
    artist.until(lambda: session.current() is None or session.current().layout is not None)
    artist.stroke(mesh, 1030, 0.3, 0.05)
    facts["equal"] = artist.equal()
    artist.stop("cancel")
    facts["different"] = artist.different(before, artist.facts(mesh))
    return facts


class Halves:
    """A mesh on which Start and Cancel have work to do, and both stopped in the middle."""

    def __init__(self) -> None:
        rigs.clear()
        self.mesh, rig = rigs.tube(6000, 6)
        for bone in ("bone.0", "bone.3"):
            self.mesh.vertex_groups[bone].remove([*range(0, 6000, 2)])
        rigs.bend(rig, 25)
        self.before = artist.facts(self.mesh)
        self.entries = self.count()

    def count(self) -> int:
        return sum(len(vertex.groups) for vertex in self.mesh.data.vertices)

    def changed(self) -> list[str]:
        return artist.different(self.before, artist.facts(self.mesh))

    def start(self) -> None:
        """Until the first of the missing entries are there."""
        from skind.blender import jobs
        session, _ = artist.modules()
        rigs.activate(self.mesh)
        assert session.start(bpy.context) == []
        while self.count() == self.entries:
            session.channel().pump(0.004)
            jobs.advance(0.0)
        assert session.current().layout is None

    def cancel(self) -> None:
        """A stroke, and until more than half of taking it back is done."""
        from skind.blender import jobs
        session, _ = artist.modules()
        artist.stroke(self.mesh, 3000, 0.3, 0.05)
        session.current().cancel()
        while (jobs.current().progress or 0) < 0.6:
            jobs.advance(0.0)
        assert session.current() is not None


def interrupted(path: str) -> dict:
    """Saving, stopping and disabling while Start and Cancel are half done."""
    import addon_utils
    halves, found = Halves(), {}
    session, _ = artist.modules()
    halves.start()
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    found["saved at start"] = session.current().layout is not None, artist.equal()
    halves.cancel()
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    found["saved at cancel"] = session.current() is None, halves.changed()

    artist.start(halves.mesh)
    halves.cancel()
    session.current().cancel_pending()
    found["stopped at cancel"] = session.current() is None, halves.changed()
    halves.start()
    session.current().cancel_pending()
    found["stopped at start"] = session.current() is None, halves.changed()
    artist.until(lambda: not session.is_busy())
    found["sessions"] = len(artist.call("session.list", {})["sessions"])

    halves.start()
    addon_utils.disable("skind")
    found["disabled at start"] = True, halves.changed()
    addon_utils.enable("skind", default_set=True)
    session, _ = artist.modules()
    artist.start(halves.mesh)
    artist.stroke(halves.mesh, 3000, 0.3, 0.05)
    bpy.ops.wm.open_mainfile(filepath=path)
    halves.mesh = bpy.data.objects["Tube"]
    found["opened"] = session.current() is None, halves.changed()
    artist.until(lambda: not session.is_busy())
    return found


def bereft() -> dict:
    """With a stroke pending another tool closes the session, or the daemon is gone for good."""
    from skind.core import Link
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    rest, before = rigs.co(mesh), artist.facts(mesh)
    session, pump = artist.modules()
    found = {}
    for how in ("finish", "cancel"):
        live = artist.start(mesh)
        artist.stroke(mesh, 1030, 0.3, 0.05)
        answered = rigs.weights(mesh)
        with Link.connect(session.channel().path, name="another tool") as other:
            with artist.halted():
                artist.bump(mesh, 300, 0.3, 0.05)
                closing = other.send("session.close", {"session": live.sculpt.name})
                time.sleep(0.05)  # so that it is read first
                live.solve()
                session.channel().pump(0.0)
            other.wait(closing)
        artist.until(lambda: live.sculpt.phase == "ended")
        told = session.told()
        artist.stop(how)
        found[f"closed, {how}"] = (bool((rigs.co(mesh) == rest).all()),
                                   bool((rigs.weights(mesh) == answered).all()) if how == "finish"
                                   else artist.different(before, artist.facts(mesh)) == [], told)
        before = artist.facts(mesh)
    path = os.environ["PATH"]
    for how in ("finish", "cancel"):
        live = artist.start(mesh)
        artist.stroke(mesh, 1030, 0.3, 0.05)
        answered = rigs.weights(mesh)
        os.environ["PATH"] = "/nowhere"
        artist.bump(mesh, 300, 0.3, 0.05)
        live.solve()
        os.kill(artist.daemon_pid(), signal.SIGKILL)
        artist.until(lambda: "not found" in session.channel().problem)
        pending = len(live.sculpt.pending)
        if how == "finish":
            live.cancel_pending()  # or Finish would wait for it
        artist.stop(how)
        found[f"gone, {how}"] = (bool((rigs.co(mesh) == rest).all()),
                                 bool((rigs.weights(mesh) == answered).all()) if how == "finish"
                                 else artist.different(before, artist.facts(mesh)) == [], pending)
        before = artist.facts(mesh)
        os.environ["PATH"] = path
        session.channel().open()
    return found


def outside() -> dict:
    """Undone to before Start, and redone; renamed; ended while outside."""
    from skind.blender import history, mesh as marks
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    live = artist.start(mesh)
    artist.stroke(mesh, 1030, 0.3, 0.05)
    mesh.name = "Renamed"
    artist.stroke(mesh, 300, 0.3, 0.05)
    found = {"renamed": (live.sculpt.strokes, artist.equal())}
    kept = {name: mesh.data[name] for name in (marks.SESSION, marks.STATE)}
    marks.unmark(mesh.data)
    history.follow(live)
    for _ in range(5):
        artist.modules()[1].tick()
    found["outside"] = live.is_outside, live.is_ready
    for name, value in kept.items():
        mesh.data[name] = value
    history.follow(live)
    artist.until(artist.is_settled)
    artist.stroke(mesh, 300, 0.3, 0.05)
    found["back"] = live.is_outside, live.sculpt.strokes, artist.equal()
    marks.unmark(mesh.data)
    history.follow(live)
    untouched = artist.facts(mesh)
    artist.stop("cancel")
    found["cancelled"] = artist.different(untouched, artist.facts(mesh))
    return found
