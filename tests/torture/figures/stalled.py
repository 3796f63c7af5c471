"""A subscriber that never reads: what it costs the daemon, and what the others notice of it.

Others: an artist who waits for each answer, and a viewer who reads what changed. Blocks of strokes
with and without the deaf one alternate on one daemon, so that both see the same machine; nothing is
kept on the disk there, whose own jitter would decide about a 99th percentile. A moment in which the
machine is busy with others would do so too: the ratio is taken of some hundred strokes of each kind
at a time, and the median of these is told.

Memory is looked at in that session, and in a large one, whose changes would be far more than the
deaf one may cost.
"""

from __future__ import annotations

import select
import statistics
import time

import numpy as np
from core import Link

from .. import work
from ..yard import LEAN_ALLOCATOR, Daemon, Yard, expect

VERTICES, TOUCHED = 20_000, 2_000  # of the session and of a stroke: an update is some 50 KiB
LARGE_VERTICES, LARGE_TOUCHED = 200_000, 40_000  # and 1 MiB
# Strokes until all is other than before that the daemon keeps of the last changes.
WARM, LARGE_WARM = 700, 40
LOOKS, LOOK_STROKES = 7, 3  # at the memory, and between two of them
# Strokes until the deaf one's socket is full: before that it is a reader like others.
SETTLING = 10
BLOCK = 50  # strokes between two that the machine sees alike
GROUP = 500  # strokes of a kind whose 99th percentiles are compared
HISTORY_BYTES = 1 << 20


class Studio:
    """An artist and a viewer on a session; each stroke goes elsewhere than the last."""

    def __init__(self, daemon: Daemon, vertices: int, touched: int,
                 durability: str = "full") -> None:
        self.daemon = daemon
        self.artist = daemon.link()
        work.create(self.artist, "studio", vertices, history_bytes=HISTORY_BYTES,
                    durability=durability)
        self.viewer = self.attach()
        self.positions = work.rigs.sheet(vertices)["positions"]
        self.touched = touched
        self.turn = 0

    def attach(self) -> Link:
        link = self.daemon.link()
        link.call("session.attach", {"session": "studio"})
        return link

    def stroke(self) -> float:
        """Milliseconds until both have it."""
        self.turn += 1
        first = self.turn * self.touched // 2 % (len(self.positions) - self.touched)
        some = np.arange(first, first + self.touched, dtype=np.uint32)
        move = np.float32(0.05 if self.turn % 2 else -0.05)
        began = time.perf_counter()
        revision = self.artist.call("stroke.apply", {
            "session": "studio", "pose": "a", "vertices": some, "stream": False,
            "stiffness": 0, "positions": self.positions[some] + move})["revision"]
        seen = 0
        while seen < revision:
            ready, _, _ = select.select([self.viewer.socket], [], [], 20)
            expect(ready, "the viewer hears of nothing")
            self.viewer.pump()
            for message in self.viewer.notifications:
                seen = max(seen, message.params.get("revision", 0))
            self.viewer.notifications.clear()
        return (time.perf_counter() - began) * 1e3

    def strokes(self, count: int) -> list[float]:
        return [self.stroke() for _ in range(count)]

    def memory_kib(self) -> float:
        """The daemon's: the median of looks, because the journal makes short peaks."""
        looks = []
        for _ in range(LOOKS):
            self.strokes(LOOK_STROKES)
            time.sleep(0.01)
            looks.append(self.daemon.rss_kib())
        return statistics.median(looks)

    def cost_kib(self, times: int, warm: int) -> int:
        """The most that a deaf subscriber cost, of so many; each is there until nothing that it
        waits for is kept for others too."""
        cost = 0.0
        self.strokes(warm)
        for _ in range(times):
            alone = self.memory_kib()
            deaf = self.attach()
            self.strokes(warm)
            cost = max(cost, self.memory_kib() - alone)
            deaf.close()
        return round(cost)


def cost_in_large(yard: Yard) -> int:
    with yard.daemon(environment=LEAN_ALLOCATOR) as daemon:
        studio = Studio(daemon, LARGE_VERTICES, LARGE_TOUCHED)
        return studio.cost_kib(yard.pick(6, 1), LARGE_WARM)


def measure_times(studio: Studio, blocks: int, seconds: float) -> tuple[list[float], list[float]]:
    """Milliseconds of strokes (alone, with the deaf one), in blocks that take turns."""
    alone: list[float] = []
    stalled: list[float] = []
    began = time.monotonic()

    def play(times: list[float]) -> None:
        studio.strokes(SETTLING)
        times += studio.strokes(BLOCK)

    for block in range(blocks):
        if block % 2:
            play(alone)
        deaf = studio.attach()
        play(stalled)
        deaf.close()
        if block % 2 == 0:
            play(alone)
        if time.monotonic() - began > seconds:
            break
    return alone, stalled


def p99(times: list[float]) -> float:
    return float(np.percentile(times, 99))


def measure(yard: Yard, seconds: float) -> dict:
    large = cost_in_large(yard)
    with yard.daemon(environment=LEAN_ALLOCATOR) as daemon:
        studio = Studio(daemon, VERTICES, TOUCHED)
        small = studio.cost_kib(yard.pick(4, 1), WARM)
    with yard.daemon() as daemon:
        alone, stalled = measure_times(Studio(daemon, VERTICES, TOUCHED, "off"),
                                       yard.pick(200, 16), seconds)
    ratios = [p99(stalled[at:at + GROUP]) / p99(alone[at:at + GROUP])
              for at in range(0, max(len(alone) - GROUP, 0) + 1, GROUP)]
    yard.say(f"  {small} KiB, {large} in a large session; p99 of {len(alone)} strokes "
             f"{p99(alone):.2f} ms alone, {p99(stalled):.2f} with it; of {GROUP} at a time "
             f"{min(ratios):.2f} to {max(ratios):.2f} times that")
    return {"stalled_reader_kib": max(small, large),
            "stalled_reader_p99_ratio": round(statistics.median(ratios), 4)}
