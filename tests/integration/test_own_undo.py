"""Undo and redo of a tool's own steps, among those of others.

The model knows nothing of how the daemon does it: every vertex must have what the step that was made
last, of those that are done and touch it, left there - weights, bones, rest position, pins and
shapes, to the bit.
"""

from __future__ import annotations

import os
import random
import signal

import numpy as np
import pytest
import rigs
from core import SkindError

QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")
VERTICES = 400
POSES = {"bent": 0.4, "back": -0.3}
TOOLS = ["ann", "bob", "cat"]


def make(daemon, **options) -> None:
    with daemon.link() as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(VERTICES), **options})
        for pose, angle in POSES.items():
            link.call("pose.set", {"session": "sheet", "pose": pose, "matrices": rigs.bent(angle)})


def join(daemon, tools: list[str] = TOOLS) -> dict:
    return {tool: daemon.link(f"{tool}'s tool", id=tool, checked=tool == tools[0])
            for tool in tools}


def rows(link) -> np.ndarray:
    """All that each vertex has, one row of bytes a vertex."""
    who = {"session": "sheet"}
    weights = link.call("weights.get", who)
    columns = [weights["weights"], weights["joints"], link.call("mesh.get", who)["rest"]]
    for kind, values in (("pins", ("positions", "weights")), ("shapes", ("offsets",))):
        for pose in POSES:
            told = link.call(f"{kind}.get", {**who, "pose": pose})
            has = np.zeros((VERTICES, 1), np.uint8)
            has[told["vertices"]] = 1
            columns.append(has)
            for value in values:
                width = 1 if value == "weights" else 3
                column = np.zeros((VERTICES, width), np.float32)
                column[told["vertices"]] = told[value].reshape(-1, width)
                columns.append(column)
    return np.concatenate([np.ascontiguousarray(column).view(np.uint8).reshape(VERTICES, -1)
                           for column in columns], axis=1)


class Step:
    """What a tool did: the vertices that it touched, and what they had then."""

    def __init__(self, number: int, tool: str, vertices: np.ndarray, after: np.ndarray) -> None:
        self.number, self.tool, self.after = number, tool, after[vertices]
        self.vertices = vertices
        self.touched = set(vertices.tolist())


class Model:
    """What the session must be."""

    def __init__(self, base: np.ndarray) -> None:
        self.base = base
        self.done: list[Step] = []
        self.undone: list[Step] = []  # the next to be redone is last
        self.made = 0

    def add(self, tool: str, vertices: np.ndarray, after: np.ndarray) -> None:
        self.made += 1
        self.undone.clear()
        self.done.append(Step(self.made, tool, vertices, after))

    def move(self, method: str, own: str | None) -> tuple[str, set[str]]:
        """Undoes or redoes: "" or the error's name, and the tools that are in the way."""
        undo = method == "history.undo"
        source, other = (self.done, self.undone) if undo else (self.undone, self.done)
        mine = [step for step in source if own in (None, step.tool)]
        if not mine:
            return ("nothing_to_undo" if undo else "nothing_to_redo"), set()
        passed = source[source.index(mine[-1]) + 1:]
        blocking = {step.tool for step in passed if step.touched & mine[-1].touched}
        if blocking:
            return "conflict", blocking
        source.remove(mine[-1])
        other.append(mine[-1])
        return "", set()

    def rows(self) -> np.ndarray:
        now = self.base.copy()
        for step in sorted(self.done, key=lambda each: each.number):
            now[step.vertices] = step.after
        return now


class Storm:
    """Tools that take turns at random, each change held against the model."""

    def __init__(self, daemon, seed: int) -> None:
        self.pick = random.Random(seed)
        self.links = join(daemon)
        self.model = Model(rows(self.links["ann"]))
        self.revision = 0
        self.refused = self.moved = 0

    def patch(self, tool: str) -> np.ndarray:
        """Mostly of the tool's own third of the vertices, sometimes of everybody's."""
        third = VERTICES // len(TOOLS)
        start = TOOLS.index(tool) * third
        first, last = (start, start + third) if self.pick.random() < 0.5 else (0, VERTICES)
        count = self.pick.randrange(1, 25)
        return np.array(sorted(self.pick.sample(range(first, last), count)), np.uint32)

    def change(self, tool: str) -> None:
        link, vertices = self.links[tool], self.patch(tool)
        who = {"session": "sheet", "vertices": vertices}
        kind = self.pick.choice(["stroke", "stroke", "stroke", "shape", "evidence", "set", "clear"])
        before = rows(link)
        if kind == "set":
            weights = link.call("weights.get", who)["weights"]
            told = link.call("weights.set", {**who, "weights": weights[:, ::-1].copy(), "joints":
                                             link.call("weights.get", who)["joints"][:, ::-1]})
        elif kind == "clear":
            vertices = self.pinned(link, vertices)
            told = link.call("pins.clear", who)
        else:
            pose = self.pick.choice(list(POSES))
            shown = link.call("pose.evaluate", {**who, "pose": pose})["positions"]
            shift = np.float32([self.pick.uniform(-0.05, 0.05) for _ in range(3)])
            how = {"stroke": {"pin": self.pick.choice(["set", "move", "none"])},
                   "shape": {"residual": "shape"}, "evidence": {"slots": "evidence"}}[kind]
            told = link.call("stroke.apply", {**who, "pose": pose, "positions": shown + shift,
                                              **how})
        after = rows(link)
        changed = set(np.flatnonzero((before != after).any(1)).tolist())
        assert changed <= set(vertices.tolist())
        if kind == "clear" and not len(vertices):
            assert told["revision"] == self.revision
            return
        self.revision += 1
        assert told["revision"] == self.revision
        self.model.add(tool, vertices, after)

    def pinned(self, link, vertices: np.ndarray) -> np.ndarray:
        pinned = [link.call("pins.get", {"session": "sheet", "pose": pose})["vertices"]
                  for pose in POSES]
        return np.intersect1d(vertices, np.concatenate(pinned))

    def move(self, tool: str, own: bool) -> None:
        method = self.pick.choice(["history.undo", "history.undo", "history.redo"])
        expected, blocking = self.model.move(method, tool if own else None)
        try:
            told = self.links[tool].call(method, {"session": "sheet", "own": own})
        except SkindError as error:
            assert error.name == expected, error
            assert not blocking or any(f"by {other}'s tool" in str(error) for other in blocking)
            self.refused += error.name == "conflict"
            return
        assert expected == "", f"{method} of {tool} should have been refused: {expected}"
        self.revision += 1
        self.moved += own
        assert told["revision"] == self.revision
        assert told["undo_steps"] == len(self.model.done)
        assert told["redo_steps"] == len(self.model.undone)

    def act(self) -> None:
        tool, choice = self.pick.choice(TOOLS), self.pick.random()
        if choice < 0.4:
            self.change(tool)
        else:
            self.move(tool, own=choice < 0.88)
        self.check(tool)

    def check(self, tool: str = "ann") -> None:
        assert np.array_equal(rows(self.links[tool]), self.model.rows())
        info = self.links[tool].call("session.info", {"session": "sheet"})
        assert info["revision"] == self.revision


@pytest.mark.parametrize("seed, durability", [(1, "full"), (2, "off"), (3, "full"), (4, "second")])
def test_any_order_gives_what_is_done(start, seed, durability) -> None:
    daemon = start()
    make(daemon, durability=durability)
    storm = Storm(daemon, seed)
    for _ in range(250 if QUICK else 1000):
        storm.act()
    assert storm.moved > 10 and storm.refused > 5, "the storm says nothing"
    if durability != "full":
        return
    # Whose steps they are, and in which order they stand, outlives the daemon.
    assert daemon.stop(signal.SIGKILL) == -signal.SIGKILL
    daemon = start()
    storm.links = join(daemon)
    storm.check()
    for _ in range(60 if QUICK else 200):
        storm.act()
    # All that is done can be undone in the history's order, to where the session began.
    while storm.model.done:
        assert storm.model.move("history.undo", None) == ("", set())
        storm.links["ann"].call("history.undo", {"session": "sheet"})
    assert np.array_equal(rows(storm.links["ann"]), storm.model.base)


def nudge(link, vertices: list[int], pose: str = "bent") -> dict:
    who = {"session": "sheet", "pose": pose, "vertices": np.array(vertices, np.uint32)}
    shown = link.call("pose.evaluate", who)["positions"]
    return link.call("stroke.apply", {**who, "positions": shown + np.float32(0.03)})


def refusal(link, method: str, **params) -> SkindError:
    with pytest.raises(SkindError) as caught:
        link.call(method, {"session": "sheet", **params})
    return caught.value


def test_a_later_step_of_another_is_in_the_way(daemon) -> None:
    make(daemon)
    links = join(daemon)
    ann, bob = links["ann"], links["bob"]
    nudge(ann, [1, 2, 3])
    nudge(bob, [3, 4])
    before = rows(ann)
    error = refusal(ann, "history.undo", own=True)
    assert error.name == "conflict"
    assert "by bob's tool" in str(error) and "stroke" in str(error) and "done" in str(error)
    assert np.array_equal(rows(ann), before)
    assert ann.call("session.info", {"session": "sheet"})["revision"] == 2
    bob.call("history.undo", {"session": "sheet", "own": True})
    ann.call("history.undo", {"session": "sheet", "own": True})
    # Now the other way: what bob did was on top of it.
    error = refusal(bob, "history.redo", own=True)
    assert error.name == "conflict" and "by ann's tool" in str(error) and "undone" in str(error)
    assert refusal(links["cat"], "history.redo", own=True).name == "nothing_to_redo"
    assert refusal(links["cat"], "history.undo", own=True).name == "nothing_to_undo"
    ann.call("history.redo", {"session": "sheet", "own": True})
    bob.call("history.redo", {"session": "sheet", "own": True})
    assert np.array_equal(rows(ann), before)


def test_pins_are_in_the_way_too(daemon) -> None:
    make(daemon)
    links = join(daemon)
    ann, bob = links["ann"], links["bob"]
    nudge(ann, [1, 2])
    nudge(bob, [7, 8])
    bob.call("pins.clear", {"session": "sheet", "pose": "bent", "vertices": [2, 7]})
    assert refusal(ann, "history.undo", own=True).name == "conflict"
    assert "pins" in str(refusal(ann, "history.undo", own=True))
    bob.call("history.undo", {"session": "sheet", "own": True})
    assert ann.call("history.undo", {"session": "sheet", "own": True})["revision"] == 5


def test_own_is_by_the_client_s_id(daemon) -> None:
    """Over reconnects; who gives none has one for each connection."""
    make(daemon)
    with daemon.link("first", id="same") as link:
        nudge(link, [1])
    with daemon.link("first") as link:
        nudge(link, [2])
    with daemon.link("second") as link:
        assert refusal(link, "history.undo", own=True).name == "nothing_to_undo"
        nudge(link, [3])
        link.call("history.undo", {"session": "sheet", "own": True})
        assert refusal(link, "history.undo", own=True).name == "nothing_to_undo"
    with daemon.link("another name", id="same") as link:
        told = link.call("history.undo", {"session": "sheet", "own": True})
        assert (told["vertices"], told["undo_steps"], told["redo_steps"]) == (1, 1, 2)
        assert refusal(link, "history.undo", own=True).name == "nothing_to_undo"
