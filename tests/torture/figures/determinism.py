"""One recording, played in every way that keeps its order, ends in the same bytes.

By one client and by 16 that take turns, while others work on sessions of their own; with 1 to N
workers; with the daemon killed and started again on the way.
"""

from __future__ import annotations

import os
import time

from core import SkindError

from .. import work
from ..yard import Daemon, Failed, Yard, expect

VERTICES = 900
CLIENTS = 16


def record(length: int, seed: int) -> list[tuple[str, dict]]:
    recipe = work.Recipe("played", VERTICES, seed)
    return [recipe.next() for _ in range(length)]


class Player:
    """Plays a recording on a daemon, by as many clients as there are."""

    def __init__(self, daemon: Daemon, clients: int, noise: bool) -> None:
        self.daemon = daemon
        self.clients = clients
        self.noise = work.Recipe("noise", VERTICES, 77) if noise else None
        self.links: list = []

    def connect(self) -> None:
        self.links = [self.daemon.link() for _ in range(self.clients)]

    def play(self, recording: list[tuple[str, dict]], kills: set[int]) -> str:
        self.connect()
        work.create(self.links[0], "played", VERTICES)
        if self.noise:
            work.create(self.links[0], "noise", VERTICES)
        for index, (method, params) in enumerate(recording):
            if index in kills:
                self.daemon.kill()
                self.daemon.start()
                self.connect()
            link = self.links[index % self.clients]
            disturbing = [other.send(*self.noise.stroke()) for other in self.links[:3]
                          ] if self.noise else []
            try:
                link.call(method, params)
            except SkindError as error:
                expect(error.name in work.NOTHING_TO_DO, f"{method}: {error}")
            for other, id in zip(self.links, disturbing):
                other.wait(id)
        found = work.digest(self.links[0], "played")
        for link in self.links:
            link.close()
        return found


def measure(yard: Yard, seconds: float) -> dict:
    cores = len(os.sched_getaffinity(0))
    length = yard.pick(160, 30)
    ways = [(1, 1, False, 0), (CLIENTS, cores, True, 0), (CLIENTS, 1, True, 2), (1, cores + 2, False, 0),
            (CLIENTS, 4, False, 3)]
    rounds, began = 0, time.monotonic()
    while rounds == 0 or (time.monotonic() - began < seconds * 0.8 and not yard.quick):
        recording = record(length, rounds)
        digests = {}
        for clients, workers, noise, kills in ways:
            with yard.daemon("--workers", workers) as daemon:
                points = {(index + 1) * length // (kills + 1) for index in range(kills)}
                digests[clients, workers, noise, kills] = Player(daemon, clients, noise).play(
                    recording, points)
        if len(set(digests.values())) != 1:
            raise Failed(f"recording {rounds}: {digests}")
        rounds += 1
    yard.say(f"  {rounds} recordings of {length} requests, played in {len(ways)} ways each")
    return {"determinism": "pass"}
