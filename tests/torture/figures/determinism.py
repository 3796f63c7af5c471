"""One recording, played in every way that keeps its order, ends in the same bytes.

By one client and by 16 that take turns, while others work on sessions of their own; with 1 to N
workers; with the daemon killed and started again on the way. What was played is undone to its
beginning after one more restart.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

from core import Link, SkindError

from .. import work
from ..yard import Daemon, Yard, expect

VERTICES = 900
CLIENTS = 16


def record(length: int, seed: int) -> list[tuple[str, dict]]:
    recipe = work.Recipe("played", VERTICES, seed)
    return [recipe.next() for _ in range(length)]


@dataclass(frozen=True)
class Way:
    """How a recording is played."""

    clients: int
    workers: int
    noise: bool = False  # others at work on a session of their own
    kills: int = 0  # of the daemon, on the way


class Player:
    """Plays a recording on a daemon, by as many clients as there are."""

    def __init__(self, daemon: Daemon, way: Way) -> None:
        self.daemon, self.way = daemon, way
        self.noise = work.Recipe("noise", VERTICES, 77) if way.noise else None
        self.links: list = []

    def connect(self) -> None:
        self.links = [self.daemon.link() for _ in range(self.way.clients)]

    def play(self, recording: list[tuple[str, dict]]) -> tuple[str, str]:
        """What the session holds in the end and after a restart, and once all is undone then."""
        parts = self.way.kills + 1
        kills = {part * len(recording) // parts for part in range(1, parts)}
        self.connect()
        work.create(self.links[0], "played", VERTICES)
        if self.noise:
            work.create(self.links[0], "noise", VERTICES)
        for index, (method, params) in enumerate(recording):
            if index in kills:
                self.daemon.kill()
                self.daemon.start()
                self.connect()
            link = self.links[index % self.way.clients]
            disturbing = [other.send(*self.noise.stroke()) for other in self.links[:3]
                          ] if self.noise else []
            try:
                link.call(method, params)
            except SkindError as error:
                expect(error.name in work.NOTHING_TO_DO, f"{method}: {error}")
            for other, id in zip(self.links, disturbing):
                other.wait(id)
        held = work.digest(self.links[0], "played")
        for link in self.links:
            link.close()
        self.daemon.stop()
        with self.daemon.start().link() as link:
            expect(work.digest(link, "played") == held, "a restart changed something")
            return held, self.undo_all(link)

    @staticmethod
    def undo_all(link: Link) -> str:
        while link.call("session.info", {"session": "played"})["undo_steps"] > 0:
            link.call("history.undo", {"session": "played"})
        return work.digest(link, "played")


def ways(cores: int) -> list[Way]:
    """One client and 16, each number of workers up to more than there are cores, and kills."""
    return [Way(1, 1), Way(CLIENTS, cores, noise=True), Way(CLIENTS, 1, noise=True, kills=2),
            Way(CLIENTS, cores + 2, kills=3),
            *(Way(1, workers) for workers in range(2, cores + 2))]


def measure(yard: Yard, seconds: float) -> dict:
    length = yard.pick(160, 30)
    rounds, began = 0, time.monotonic()
    chosen = ways(len(os.sched_getaffinity(0)))
    while rounds == 0 or (time.monotonic() - began < seconds * 0.8 and not yard.quick):
        recording = record(length, rounds)
        ends = {}
        for way in chosen:
            with yard.daemon("--workers", way.workers) as daemon:
                ends[way] = Player(daemon, way).play(recording)
        expect(len(set(ends.values())) == 1, f"recording {rounds}: {ends}")
        rounds += 1
    yard.say(f"  {rounds} recordings of {length} requests, played in {len(chosen)} ways each")
    return {"determinism": "pass"}
