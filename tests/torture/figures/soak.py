"""Strokes for as long as the time allows: what the daemon keeps of memory and descriptors.

Eight clients on four sessions, with everything that comes and goes on the way: connections,
sessions, listeners. Every second or so all rests, and the daemon's memory is looked at. After a
warm-up (every history has reached its limit), the median of the last half of these looks is held
against that of the first. The allocator is told to give free memory back, so that what is seen is
what the daemon holds.
"""

from __future__ import annotations

import random
import statistics
import time

from core import Link

from .. import work
from ..yard import LEAN_ALLOCATOR, Daemon, Yard, expect

CLIENTS, SESSIONS, DEPTH, VERTICES = 8, 4, 8, 300
HISTORY_BYTES = 1 << 20
WARM_SHARE = 0.25
LOOKS = 60


class Soak:
    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        self.random = random.Random(9)
        self.strokes = 0
        self.recipes = [work.Recipe(f"s{index}", VERTICES, index) for index in range(SESSIONS)]
        # Making strokes costs the client more than the daemon: they are made once.
        self.made = [[recipe.stroke(stiffness=0.008) for _ in range(200)]
                     for recipe in self.recipes]
        self.links: list[Link] = []
        self.asked: dict[Link, list[int]] = {}
        self.listeners: list[Link] = []
        with daemon.link() as link:
            limited = {}
            if "session.save" in link.hello["capabilities"]:
                limited = {"history_bytes": HISTORY_BYTES}
            for recipe in self.recipes:
                work.create(link, recipe.session, VERTICES, **limited)
        while len(self.links) < CLIENTS:
            self.connect()
        self.listeners = [self.listen(index) for index in range(2)]

    def connect(self) -> None:
        link = self.daemon.link()
        self.links.append(link)
        self.asked[link] = []

    def listen(self, index: int) -> Link:
        link = self.daemon.link()
        link.call("session.attach", {"session": self.recipes[index].session})
        return link

    def turn(self) -> None:
        """Every client has some strokes under way."""
        for index, link in enumerate(self.links):
            made = self.made[index % SESSIONS]
            link.pump()
            asked = self.asked[link]
            while asked and link.exchange.take(asked[0]) is not None:
                asked.pop(0)
                self.strokes += 1
            while len(asked) < DEPTH:
                asked.append(link.send(*made[self.random.randrange(len(made))]))
            link.notifications.clear()
        for listener in self.listeners:
            listener.pump()
            listener.notifications.clear()

    def rest(self) -> None:
        for link in self.links:
            for id in self.asked[link]:
                link.wait(id)
                self.strokes += 1
            self.asked[link].clear()

    def come_and_go(self) -> None:
        """A client, a listener and a session end, and others begin."""
        link = self.links[0]
        for id in self.asked.pop(link):
            link.wait(id)
            self.strokes += 1
        link.close()
        self.links.pop(0)
        self.connect()
        self.listeners.pop(0).close()
        self.listeners.append(self.listen(self.random.randrange(SESSIONS)))
        link = self.links[-1]
        link.call("session.create", {"name": "guest", **work.rigs.sheet(200)})
        link.call("session.close", {"session": "guest"})

    def state(self) -> tuple[int, int]:
        """(KiB, descriptors) when nothing is under way."""
        self.rest()
        time.sleep(0.05)
        return self.daemon.rss_kib(), self.daemon.descriptors()

    def finish(self) -> None:
        with self.daemon.link() as link:
            for recipe in self.recipes:
                work.check_simplex(link, recipe.session)
        for link in [*self.links, *self.listeners]:
            link.close()


def measure(yard: Yard, seconds: float) -> dict:
    least = yard.pick(100_000, 3000)
    with yard.daemon("--workers", "2", environment=LEAN_ALLOCATOR) as daemon:
        soak = Soak(daemon)
        looks: list[tuple[int, int]] = []
        began, next_visit, next_look = time.monotonic(), 0.0, WARM_SHARE * seconds
        while True:
            spent = time.monotonic() - began
            if spent >= seconds and soak.strokes >= least:
                break
            expect(spent < 3 * seconds, f"only {soak.strokes} strokes in {spent:.0f} s")
            soak.turn()
            if spent >= next_visit:
                soak.come_and_go()
                next_visit = spent + 0.25
            if spent >= next_look:
                looks.append(soak.state())
                next_look = spent + (1 - WARM_SHARE) * seconds / LOOKS
        looks.append(soak.state())
        soak.finish()
    half = len(looks) // 2
    first, last = (statistics.median(kib for kib, _ in part)
                   for part in (looks[:half], looks[half:]))
    yard.say(f"  {soak.strokes} strokes, {first:.0f} KiB after the warm-up, {last:.0f} later, "
             f"{min(looks)[0]} to {max(looks)[0]} in all")
    return {"soak_strokes": soak.strokes, "soak_rss_drift": round(max(0.0, last / first - 1), 5),
            "soak_fd_drift": max(fds for _, fds in looks[half:]) - looks[0][1]}
