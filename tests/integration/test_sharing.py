"""Many tools on one rig session: every change reaches every tool, and never leaves it wrong.

The heart is a storm of tools of all kinds, each of which follows the session by the rule of the
protocol (tests/followers.py). Whenever two of them, or one and what the daemon itself answers, have
the same revision, they must have the same bits: weights, bones, rest positions, shapes.
"""

from __future__ import annotations

import os
import random
import signal
import time
from collections import Counter

import numpy as np
import pytest
import rigs
from core import Link
from followers import Follower

QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")
STEPS = 700 if QUICK else 2500
POSES = ["bent", "twist"]

# What a tool may be refused among others.
EXPECTED = {"nothing_to_undo", "nothing_to_redo", "unsupported", "conflict", "bad_params"}


def open_session(daemon, vertices: int, **more) -> int:
    """The session "sheet" with two poses; how many vertices it has."""
    with daemon.link() as link:
        made = link.call("session.create", {"name": "sheet", **rigs.sheet(vertices), **more})
        for pose, angle in zip(POSES, (0.4, -0.3)):
            link.call("pose.set", {"session": "sheet", "pose": pose,
                                   "matrices": rigs.bent(angle)})
    return made["vertices"]


def settle(tools: list[Follower], revision: int, seconds: float = 60) -> None:
    """Until all of them have that revision."""
    deadline = time.monotonic() + seconds
    while any(tool.have != revision or tool.asked for tool in tools):
        for tool in tools:
            tool.pump()
        assert time.monotonic() < deadline, [(tool.name, tool.have, revision, tool.asked)
                                             for tool in tools]
        time.sleep(0.002)


class Artist(Follower):
    """A tool that follows and changes things at random."""

    def __init__(self, *args, seed: int, **more) -> None:
        self.random = random.Random(seed)
        super().__init__(*args, **more)

    def change(self) -> None:
        if len(self.asked) >= 4:
            return
        kinds = {"stroke": 10, "sweep": 0 if self.lines else 2, "set": 3, "undo": 4, "redo": 3,
                 "prune": 1, "clear": 1, "weigh": 1, "reduce": 0.3}
        kind = self.random.choices(list(kinds), list(kinds.values()))[0]
        getattr(self, f"_{kind}")({"session": self.session})

    def _some(self, most: int) -> np.ndarray:
        count = self.random.randrange(1, most)
        start = self.random.randrange(self.state.vertices - count)
        return np.arange(start, start + count, dtype=np.uint32)

    def _stroke(self, who: dict, most: int = 120) -> None:
        pick = self.random
        some = self._some(most)
        how = pick.choice([{}, {}, {"slots": "evidence", "pin": "move"}, {"residual": "shape"},
                           {"stream": False}])
        towards = np.array([pick.uniform(0, 1) for _ in range(len(some) * 3)], np.float32)
        self.ask("stroke.apply", {**who, "pose": pick.choice(POSES), "vertices": some, **how,
                                  "positions": towards.reshape(-1, 3), "mix": 0.2})

    def _sweep(self, who: dict) -> None:
        self._stroke(who, self.state.vertices)

    def _set(self, who: dict) -> None:
        """Rows that it had once: sent as they are, they are kept to the bit."""
        if self.have is None:
            return
        some = self._some(100)
        rest = self.state.rest[some] + np.float32(self.random.uniform(0, 1e-3))
        more = {"rest": rest} if self.random.random() < 0.4 else {}
        self.ask("weights.set", {**who, "vertices": some, "weights": self.state.weights[some],
                                 "joints": self.state.joints[some], **more})

    def _undo(self, who: dict) -> None:
        self.ask("history.undo", {**who, "own": self.random.random() < 0.5})

    def _redo(self, who: dict) -> None:
        self.ask("history.redo", {**who, "own": self.random.random() < 0.5})

    def _prune(self, who: dict) -> None:
        self.ask("weights.prune", {**who, "below": 0.05, "vertices": self._some(100)})

    def _reduce(self, who: dict) -> None:
        self.ask("weights.reduce", {**who, "influences": 2, "by": "size",
                                    "vertices": self._some(100)})

    def _clear(self, who: dict) -> None:
        self.ask("pins.clear", {**who, "vertices": self._some(100)})

    def _weigh(self, who: dict) -> None:
        self.ask("pins.weigh", {**who, "pose": self.random.choice(POSES),
                                "weight": self.random.uniform(0, 5)})


@pytest.mark.parametrize("seed, durability", [(1, "full"), (2, "off"), (3, "second")])
def test_every_tool_has_the_same_bits_at_every_revision(start, seed, durability) -> None:
    daemon = start()
    vertices = open_session(daemon, 2500, durability=durability)
    seen: dict[tuple[str, int], str] = {}
    pick = random.Random(seed)

    def tool(name: str, kind: type = Artist, **more) -> Follower:
        if kind is Artist:
            more["seed"] = 100 * seed + len(name)
        return kind(daemon.socket, "sheet", vertices, POSES, seen, name=name, checked=name == "fast",
                    **more)

    fast, slow, deaf = tool("fast"), tool("slow artist"), tool("deaf", Follower)
    lines, writer = tool("lines", Follower, lines=True), tool("line artist", lines=True)
    restless, fetcher = tool("restless artist"), tool("fetcher", Follower)
    tools = [fast, slow, deaf, lines, writer, restless, fetcher]
    deaf_until = 0
    for number in range(STEPS):
        for eager in (fast, lines):
            eager.pump()
        for artist, share in ((fast, 0.3), (slow, 0.1), (writer, 0.1), (restless, 0.15)):
            if pick.random() < share:
                artist.change()
                while artist.stream.send():
                    pass
        if pick.random() < 0.05:
            slow.pump()
        if pick.random() < 0.3:
            writer.pump()
            restless.pump()
        if pick.random() < 0.02:
            restless.reconnect()
        if pick.random() < 0.02 and fetcher.fetched is None:
            fetcher.fetch()  # what the daemon itself says of a revision
        if number > deaf_until:
            deaf.pump()
            if pick.random() < 0.01:
                deaf_until = number + STEPS // 5
        fetcher.pump()
        time.sleep(0.001)
    with daemon.link() as link:
        deadline = time.monotonic() + 60
        while any(tool.asked for tool in tools):
            for each in tools:
                each.pump()
            assert time.monotonic() < deadline
        revision = link.call("session.info", {"session": "sheet"})["revision"]
    settle(tools, revision)
    fetcher.fetch()
    settle(tools, revision)
    counts: Counter = sum((each.counts for each in tools), Counter())
    errors: Counter = sum((each.errors for each in tools), Counter())
    assert set(errors) <= EXPECTED, errors
    assert revision > STEPS / 20 and len(seen) > revision / 3
    for path in ("merged", "caught up", "own", "reconnects", "fetched"):
        assert counts[path] > 0, counts
    for each in tools:
        each.stream.close()


@pytest.mark.parametrize("durability", ["full", "second", "off"])
def test_what_a_tool_was_told_holds_when_the_daemon_dies(start, durability) -> None:
    """Nobody hears of a revision that a dead daemon's successor gives to something else."""
    daemon = start()
    vertices = open_session(daemon, 400, durability=durability)
    seen: dict[tuple[str, int], str] = {}
    pick = random.Random(durability)
    tools: list[Follower] = []
    for number in range(4 if QUICK else 12):
        for tool in tools:
            tool.reconnect()
        if not tools:
            tools = [Artist(daemon.socket, "sheet", vertices, POSES, seen, name=f"artist {i}", seed=i)
                     for i in range(2)]
            tools += [Follower(daemon.socket, "sheet", vertices, POSES, seen, name="follower"),
                      Follower(daemon.socket, "sheet", vertices, POSES, seen, name="fetcher")]
        until = time.monotonic() + pick.uniform(0.2, 0.6)
        while time.monotonic() < until:
            for tool in tools[:2]:
                tool.change()
            if tools[3].fetched is None and tools[3].have is not None:
                tools[3].fetch()
            for tool in tools:
                tool.pump()
        daemon.stop(signal.SIGKILL)
        for tool in tools:
            with pytest.raises(ConnectionError):
                while True:
                    tool.pump()
        daemon = start(socket=daemon.socket)
        if durability == "off":
            open_session(daemon, 400, durability=durability)
    if durability == "full":
        assert len({instance for instance, _ in seen}) == 1
    for tool in tools:
        tool.stream.close()


def paced(link: Link, count: int, vertices: int, pose: str = "bent") -> dict:
    """Strokes one after the other, each of the first vertices; the last one's answer."""
    generator = np.random.default_rng(count)
    posed = link.call("pose.evaluate", {"session": "sheet", "pose": pose})["positions"][:vertices]
    for _ in range(count):
        noise = generator.uniform(-0.01, 0.01, posed.shape).astype(np.float32)
        answer = link.call("stroke.apply", {
            "session": "sheet", "pose": pose, "vertices": np.arange(vertices, dtype=np.uint32),
            "positions": posed + noise, "stream": False, "pin": "none"})
    return answer


def follower(daemon, vertices: int, **more) -> Follower:
    made = Follower(daemon.socket, "sheet", vertices, POSES, {}, **more)
    settle([made], made_revision(daemon))
    return made


def made_revision(daemon) -> int:
    with daemon.link(checked=False) as link:
        return link.call("session.info", {"session": "sheet"})["revision"]


def test_who_reads_in_time_gets_each_change_by_itself(daemon) -> None:
    vertices = open_session(daemon, 400)
    with daemon.link(name="Anna") as link:
        eager = follower(daemon, vertices, checked=True)
        for number in range(1, 8):
            paced(link, 1, vertices)
            settle([eager], number)
        assert eager.counts["updates"] == 7 and eager.counts["merged"] == 0


def test_the_newest_value_wins_before_it_is_sent(daemon) -> None:
    """What a tool that stops reading finds when it goes on is far less than what happened."""
    vertices = open_session(daemon, 2500)
    with daemon.link(name="Anna") as link:
        deaf = follower(daemon, vertices, checked=True)
        count = 60
        revision = paced(link, count, vertices)["revision"]
        settle([deaf], revision)
        truth = follower(daemon, vertices)
        assert deaf.state.digest() == truth.state.digest()
        assert deaf.counts["merged"] >= 1 and deaf.counts["updates"] < count / 2
        assert deaf.counts["resyncs"] == 0


def test_who_is_too_far_behind_is_told_to_fetch(daemon) -> None:
    vertices = open_session(daemon, 100)
    with daemon.link(checked=False) as link:
        held = follower(daemon, vertices)
        settle([held], 0)
        held.stream.close()
        some = np.arange(3, dtype=np.uint32)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent",
                                            "vertices": some})["positions"]
        stroke = {"session": "sheet", "pose": "bent", "vertices": some, "positions": posed,
                  "stream": False, "pin": "none"}
        for _ in range(1024):
            link.call("stroke.apply", stroke)
        who = {"session": "sheet", "instance": held.instance}
        with daemon.link() as other:
            assert other.call("session.attach", {**who, "revision": 0})["resync"] is False
        link.call("stroke.apply", stroke)
        with daemon.link() as other:
            assert other.call("session.attach", {**who, "revision": 0})["resync"] is True
            assert other.call("session.attach", {**who, "revision": 1})["resync"] is False
            other.pump(0.2)
            (update,) = [note.params for note in other.notifications
                         if note.method == "session.update"]
            assert (update["since"], update["revision"]) == (1, 1025)
            assert len(update["changes"]) == 1024
            assert len(update["vertices"]) == 3


def test_a_revision_means_nothing_in_another_instance(daemon) -> None:
    vertices = open_session(daemon, 100)
    with daemon.link() as link:
        paced(link, 3, vertices)
        who = {"session": "sheet"}
        info = link.call("session.info", who)
        ours = {**who, "instance": info["instance"]}
        other = {**who, "instance": "0" * 16}
        for params, resync in (({**ours, "revision": 3}, False), ({**ours, "revision": 1}, False),
                               ({**ours, "revision": 4}, True), ({**other, "revision": 3}, True),
                               ({**who, "revision": 3}, False), ({**who, "revision": 2}, True),
                               (who, True), (ours, True)):
            assert link.call("session.attach", params)["resync"] is resync, params


def test_arrays_that_cannot_be_merged_come_one_after_the_other(daemon) -> None:
    """Weights alone, then bones too, then weights alone: three messages, each of them true."""
    vertices = open_session(daemon, 400)
    with daemon.link(checked=False) as link:
        first = follower(daemon, vertices)
        first.stream.close()
        paced(link, 2, vertices)
        got = link.call("weights.get", {"session": "sheet"})
        link.call("weights.set", {"session": "sheet", "vertices": np.arange(10, dtype=np.uint32),
                                  "weights": got["weights"][:10], "joints": got["joints"][:10]})
        paced(link, 2, vertices)
        first.reconnect()
        settle([first], 5)
        assert first.counts["updates"] == 3 and first.counts["merged"] == 2
        assert first.state.digest() == follower(daemon, vertices).state.digest()


def test_more_than_everything_is_not_sent(daemon) -> None:
    """Changes that cannot be merged and are more than all weights together."""
    vertices = open_session(daemon, 40_000)
    with daemon.link(checked=False) as link:
        reader = follower(daemon, vertices, checked=True)
        reader.stream.close()
        everyone = np.arange(vertices, dtype=np.uint32)
        got = link.call("weights.get", {"session": "sheet"})
        rows = {"session": "sheet", "vertices": everyone, "weights": got["weights"]}
        for turn in range(8):
            more = {"joints": got["joints"]} if turn % 2 else {}
            last = link.call("weights.set", {**rows, **more})["revision"]
        reader.reconnect()
        settle([reader], last)
        assert reader.counts["resyncs"] == 1 and reader.counts["updates"] == 1
        assert reader.state.digest() == follower(daemon, vertices).state.digest()


def test_a_line_is_not_made_too_long(daemon) -> None:
    vertices = open_session(daemon, 20_000)
    with daemon.link(checked=False) as link:
        reader = follower(daemon, vertices, lines=True)
        paced(link, 1, 16_384)
        settle([reader], 1)
        assert reader.counts["resyncs"] == 0
        paced(link, 1, 16_385)
        settle([reader], 2)
        assert reader.counts["resyncs"] == 1


def test_what_a_session_does_while_it_is_closed_is_not_waited_for(daemon) -> None:
    """A worker merges for a listener while its session goes."""
    for number in range(15):
        vertices = open_session(daemon, 2500)
        with daemon.link(checked=False) as link:
            reader = follower(daemon, vertices, lines=True)
            posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
            for _ in range(4):
                link.send("stroke.apply", {"session": "sheet", "pose": "bent", "stream": False,
                                           "vertices": np.arange(vertices, dtype=np.uint32),
                                           "positions": posed})
            link.pump(0.002 * number)
            link.call("session.delete", {"session": "sheet"})
            deadline = time.monotonic() + 10
            while not reader.closed:
                reader.pump()
                assert time.monotonic() < deadline
            reader.stream.close()
