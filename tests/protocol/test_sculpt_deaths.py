"""core.sculpt when the daemon dies: what was answered is kept, what waits is solved."""

from __future__ import annotations

import os
import signal
import time

import numpy as np
import pytest
from core import Launcher, Link
from core.asks import Stroke
from daemons import BIN
from tools import SECONDS, Mortal, Other, Tool, V, agree, same, sent_and_solved, some


class Model:
    """What each stroke makes of which weights, by a session of its own in a daemon that lives."""

    def __init__(self, daemon, params: dict) -> None:
        self.link = daemon.link("model", checked=False)
        self.link.call("session.create", {"name": "m", **params})
        self.weights = self.link.call("weights.get", {"session": "m"})["weights"].copy()

    def solve(self, weights: np.ndarray, stroke: Stroke) -> np.ndarray:
        everything = np.arange(V, dtype=np.uint32)
        self.link.call("weights.set", {"session": "m", "vertices": everything, "weights": weights})
        self.link.call("pose.set", {"session": "m", "pose": "p", "matrices": stroke.pose})
        self.link.call("stroke.apply", {"session": "m", "pose": "p", "vertices": stroke.vertices,
                                        "positions": stroke.targets})
        return self.link.call("weights.get", {"session": "m"})["weights"].copy()


MOMENTS = ["before sending", "unanswered", "solved", "answered", "undoing", "setting", "redoing"]
RESUMING = ["attaching"]  # dies again: when it is asked for the session, which it has
REMAKING = ["creating again", "telling", "told"]  # dies again: while the session is made again


def kill_at(moment: str, tool: Tool, mortal: Mortal, random: np.random.Generator) -> list[Stroke]:
    """One thing is done and the daemon dies over it. Returns the strokes that should be there."""
    strokes = []
    if moment == "before sending":
        mortal.die()
        strokes = [tool.stroke(int(random.integers(V))) for _ in range(2)]
    elif moment == "unanswered":
        mortal.pause()
        strokes = [tool.stroke(int(random.integers(V))) for _ in range(2)]
        tool.until(lambda: not tool.channel.unsent_bytes)
        mortal.die()
    elif moment == "solved":
        strokes = [tool.stroke(int(random.integers(V)))]
        with_others = Other(mortal.daemon)
        sent_and_solved(tool, with_others)
        mortal.die()
    elif moment == "answered":
        strokes = [tool.stroke(int(random.integers(V)))]
        tool.until(lambda: strokes[0].is_answered, showing=False)
        mortal.die()
    elif moment in ("undoing", "redoing", "setting"):
        mortal.pause()
        if moment == "setting":
            tool.paint(some(random, V), random)
        else:
            getattr(tool, moment.removesuffix("ing"))()
        tool.until(lambda: not tool.channel.unsent_bytes)
        mortal.die()
    else:
        die_while_resuming(moment, tool, mortal)
    return strokes


def die_while_resuming(moment: str, tool: Tool, mortal: Mortal) -> None:
    """Dead twice: the second time in the middle of the resuming."""
    method = {"attaching": "session.attach", "creating again": "session.create",
              "telling": "weights.set", "told": "weights.get"}[moment]
    asked = tool.methods.count(method)
    mortal.die()
    tool.until(lambda: tool.methods.count(method) > asked)
    mortal.die()


@pytest.mark.parametrize("forgets", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_daemon_dies(start, folder, make_tool, params, seed, forgets):
    """Many deaths each: what was answered is kept to the bit, what waited is solved."""
    random = np.random.default_rng(seed)
    model = Model(start(socket=folder / "model.sock"), params)
    mortal = Mortal(start, forgets)
    tool = make_tool().create()
    for moment in random.permutation(MOMENTS + (REMAKING if forgets else RESUMING)):
        for _ in range(2):  # something to undo, to keep and to redo
            tool.stroke(int(random.integers(V)))
            tool.settle()
        if moment == "redoing":
            tool.undo()
            tool.settle()
        began = time.monotonic()
        strokes = kill_at(moment, tool, mortal, random)
        expected = tool.sculpt.weights.copy()
        for stroke in strokes:
            expected = model.solve(expected, stroke)
        tool.settle()
        assert time.monotonic() - began < SECONDS
        assert np.array_equal(tool.sculpt.weights, expected), moment
        assert tool.sculpt.phase == "ready" and not tool.refused
        with mortal.daemon.link() as link:
            tool.check(link)


def test_undo_across_a_death(start, make_tool):
    mortal = Mortal(start)
    tool = make_tool().create()
    for centre in (20, 50, 80):
        tool.stroke(centre)
        tool.settle()
    mortal.die()
    tool.undo()
    tool.settle()
    tool.undo()
    tool.settle()
    tool.redo()
    tool.settle()
    assert same(tool.sculpt.shown, tool.seen[tool.stack[2]])  # not of the third
    with mortal.daemon.link() as link:
        tool.check(link)


def test_stopped_politely_with_strokes_waiting(start, make_tool):
    """Found: a daemon that stops refuses what waits; that was taken for a refusal for good."""
    mortal = Mortal(start)
    tool = make_tool().create()
    mortal.pause()
    strokes = [tool.stroke(centre) for centre in (20, 50, 80)]
    tool.until(lambda: not tool.channel.unsent_bytes)
    mortal.daemon.process.send_signal(signal.SIGTERM)
    mortal.daemon.process.send_signal(signal.SIGCONT)
    assert mortal.daemon.process.wait(SECONDS) == 0
    mortal.daemon = start()
    tool.settle()
    assert tool.sculpt.strokes == len(strokes) and not tool.refused
    with mortal.daemon.link() as link:
        tool.check(link)


@pytest.mark.parametrize("seed", range(4))
def test_two_tools_and_deaths(start, make_tool, seed):
    """Whoever is there first makes the session again; both end with what the daemon has."""
    random = np.random.default_rng(seed)
    mortal = Mortal(start)
    tools = [make_tool(name="first").create(), make_tool(name="second").join()]
    for round in range(40):
        tool = tools[random.integers(2)]
        getattr(tool, random.choice(["undo", "redo"]))() if random.random() < 0.4 else \
            tool.stroke(int(random.integers(V)))
        if random.random() < 0.3:
            tools[random.integers(2)].cut_if_ready()
        for _ in range(random.integers(6)):
            tools[random.integers(2)].step()
        if round % 10 == 9:
            mortal.die()
    agree(*tools)
    with mortal.daemon.link() as link:
        for tool in tools:
            tool.check(link)


def test_what_two_tools_did_survives(start, make_tool):
    mortal = Mortal(start)
    first, second = make_tool(name="first").create(), make_tool(name="second").join()
    for tool, centre in ((first, 20), (second, 80), (first, 50)):
        tool.stroke(centre)
        agree(first, second)
    kept = first.sculpt.weights.copy()
    mortal.die()
    second.settle()
    agree(first, second)
    for tool in (first, second):
        assert np.array_equal(tool.sculpt.weights, kept)
    with mortal.daemon.link() as link:
        first.check(link)
        second.check(link)


def test_told_once(start, make_tool):
    """After a death the tool tells what it knows; after a mere cut others may know better."""
    mortal = Mortal(start)
    tool = make_tool().create()
    tool.stroke(50)
    tool.settle()
    mortal.die()
    tool.settle()
    other = Other(mortal.daemon)
    tool.cut()
    other.stroke(50)
    other.wait()
    theirs = other.call("weights.get")["weights"]
    tool.settle()
    assert np.array_equal(tool.sculpt.weights, theirs)
    tool.check(other.link)


def test_the_launcher_brings_it_back(folder, make_tool):
    path = folder / "skind.sock"
    tool = make_tool(launcher=Launcher(path, [BIN], 60)).create()
    tool.stroke(50)
    tool.settle()
    kept = tool.sculpt.weights.copy()
    os.kill(tool.channel.hello["server"]["pid"], signal.SIGKILL)
    tool.stroke(20)
    tool.settle()
    with Link.connect(path) as link:
        tool.check(link)
        tool.undo()
        tool.settle()
        tool.check(link)
        link.call("shutdown")
    assert np.array_equal(tool.sculpt.weights, kept)


@pytest.mark.parametrize("seed", range(4))
def test_bones_rest_and_shapes_survive(start, make_tool, seed):
    """All that was answered is told again, and undone to the bit after that."""
    random = np.random.default_rng(seed)
    mortal = Mortal(start)
    tool = make_tool().create()
    tool.sculpt.keep(np.array([tool.pose(angle) for angle in (0.2, -0.3, 0.6)]), 2)
    tool.settle()
    for _ in range(3):
        for _ in range(8):
            tool.any_stroke(random)
            tool.settle()
        assert not tool.refused
        kept = tool.sculpt.shown.copy()
        mortal.die()
        tool.settle()
        assert same(tool.sculpt.shown, kept)
        with mortal.daemon.link() as link:
            tool.check(link)
            guard = link.call("guard.get", {"session": "s"})
            assert (guard["candidates"], len(guard["poses"])) == (3, 2)
    sculpt = tool.sculpt
    assert (sculpt.joints != sculpt.start.joints).any()
    assert (sculpt.rest != sculpt.start.rest).any() and sculpt.shown.shapes
    while tool.live > 0:
        tool.undo()
    tool.settle()
    assert same(sculpt.shown, sculpt.start)
    with mortal.daemon.link() as link:
        tool.check(link)
