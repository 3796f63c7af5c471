"""Jobs of Blenders that share a rig session, over deaths of the daemon and of one of them, against the
real daemon. The test outside kills, and says when to stop."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from inside import artist, pen, rigs
from inside.sessions import Tape
from inside.windows import Steps, Window

CHANGES = {"stroke.apply", "weights.set", "weights.prune", "history.undo", "history.redo"}


class Diary:
    """What the daemon has answered to this Blender: each change by its revision."""

    def __init__(self, channel) -> None:
        self.answered: dict[int, str] = {}
        self.repeated = 0
        self._request = channel.request
        channel.request = self._watch

    def _watch(self, method: str, params: dict | None = None, done=None) -> int:
        def answer(result: dict | None, error: Exception | None) -> None:
            if result is not None and method in CHANGES and result["vertices"]:
                self.repeated += bool(result.get("repeated"))
                assert result["revision"] not in self.answered, "one answer for two changes"
                self.answered[result["revision"]] = method
            if done is not None:
                done(result, error)

        return self._request(method, params, answer)


class Flags:
    """How far this Blender is, as a file with a word for the test outside."""

    def __init__(self, folder: str, name: str) -> None:
        self._folder, self._name = Path(folder), name

    def say(self, word: object) -> None:
        part = self._folder / f"{self._name}.part"
        part.write_text(str(word))
        part.rename(self._folder / self._name)

    def is_told(self, word: str) -> bool:
        return (self._folder / word).exists()


def sculptor(folder: str, name: str, seed: int, kind: str, mesh_name: str,
             joins: str = "") -> dict:
    """One of several: starts or joins, and sculpts at random until the file `stop` is there.

    Says "ready", then what it waits for, and "settled"; ends when there is the file `end`, which
    says that all have settled.
    """
    flags, random = Flags(folder, name), np.random.default_rng(seed)
    mesh, rig = artist.rigged(kind, mesh_name)
    rigs.bend(rig, 25 - 50 * (seed % 2))
    live = begin(mesh, joins)
    session, pump = artist.modules()
    diary, rest, size = Diary(session.channel()), rigs.co(mesh), live.sculpt.length
    tape = Tape()
    flags.say("ready")
    begun = 0
    while not flags.is_told("stop"):
        what = random.choice(["stroke"] * 5 + ["undo", "redo", "prune"])
        if what == "stroke":
            artist.bump(mesh, int(random.integers(len(rest))), 0.15 * size, 0.03 * size)
            live.solve()
        elif what == "prune":
            live.edit("weights.prune", {"below": float(random.uniform(0, 0.01))}, lambda _: None)
        else:
            tape.go(int(np.clip(tape.at + (1 if what == "redo" else -1), 0, len(tape.states) - 1)))
        pump.tick()
        begun += 1
        flags.say(f"{what} {begun}")
        artist.until(artist.is_settled, 60)
        tape.record()
    flags.say("settled")
    artist.until(lambda: flags.is_told("end"), 60)
    artist.until(artist.is_settled)
    return found(live, diary)


def drawer(window: Window, folder: str, name: str, seed: int) -> Steps:
    """As sculptor() on a tube, in a window: a pen, and Blender's own undo."""
    flags, random = Flags(folder, name), np.random.default_rng(seed)
    live = yield from pen.begin(window)
    diary = Diary(artist.modules()[0].channel())
    flags.say("ready")
    begun = 0
    while not flags.is_told("stop"):
        what = random.choice(["stroke", "stroke", "undo", "redo"])
        if what == "stroke":
            ((x, y),) = window.surface(live.object(), 1, seed=begun)
            yield from window.stroke([(x + 4 * k, y + 3 * k) for k in range(6)])
        elif what == "redo" or live.sculpt.steps.live:  # not to before the session
            yield from window.key("Z", ctrl=True, shift=what == "redo")
        begun += 1
        flags.say(f"{what} {begun}")
        yield from pen.settled(window, 60)
    flags.say("settled")
    yield from window.wait_until(lambda: flags.is_told("end"), 60)
    yield from pen.settled(window)
    return found(live, diary)


def found(live, diary: Diary) -> dict:
    """What this Blender holds in the end, and what it was answered."""
    sculpt, session = live.sculpt, artist.modules()[0]
    return {"weights": artist.mesh_weights(), "shown": sculpt.weights, "held": sculpt.held.weights,
            "start": sculpt.start.weights, "revision": sculpt.revision, "phase": sculpt.phase,
            "answered": diary.answered, "repeated": diary.repeated, "client": sculpt.client,
            "generation": session.channel().generation, "told": session.told()}


def begin(mesh, joins: str):
    """A session of its own, or that of another."""
    if not joins:
        return artist.start(mesh)
    session, _ = artist.modules()
    artist.until(lambda: session.channel().state == "ready")
    rigs.activate(mesh)
    assert session.join(bpy.context, joins) == []
    artist.until(lambda: session.current() is None or session.current().layout is not None)
    assert session.current() is not None, session.told()
    return session.current()
