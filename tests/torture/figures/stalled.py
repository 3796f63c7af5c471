"""A subscriber that never reads: what it costs the daemon, and what the others notice of it.

Others: an artist who waits for each answer, and a viewer who reads what changed. Blocks of strokes
with and without the deaf one alternate on one daemon, so that both see the same machine; the ratio
is that of the 99th percentiles of all strokes of a kind, until the viewer has the change too.

Memory is the peak of the daemon's, with the deaf one against the peak of as much work without it:
in that session, and in a large one, whose changes would be far more than it may cost.
"""

from __future__ import annotations

import time

import numpy as np
from core import Link

from .. import work
from ..yard import LEAN_ALLOCATOR, Daemon, Yard, expect

VERTICES, TOUCHED = 20_000, 2_000  # of the session and of a stroke: an update is some 50 KiB
LARGE_VERTICES, LARGE_TOUCHED = 200_000, 40_000  # and 1 MiB
# Strokes until all is full that the daemon keeps of the last changes.
WARM, LARGE_WARM = 700, 40
BLOCK = 50  # strokes between two that the machine sees alike
HISTORY_BYTES = 1 << 20


class Studio:
    """An artist and a viewer on a session; each stroke goes elsewhere than the last."""

    def __init__(self, daemon: Daemon, vertices: int, touched: int) -> None:
        self.daemon = daemon
        self.artist = daemon.link()
        work.create(self.artist, "studio", vertices, history_bytes=HISTORY_BYTES)
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
        move = np.float32(0.001 if self.turn % 2 else -0.001)
        began = time.perf_counter()
        revision = self.artist.call("stroke.apply", {
            "session": "studio", "pose": "rest", "vertices": some, "stream": False,
            "stiffness": 0, "positions": self.positions[some] + move})["revision"]
        seen = 0
        while seen < revision:
            self.viewer.pump(0.1)
            expect(time.perf_counter() - began < 20, "the viewer hears of nothing")
            for message in self.viewer.notifications:
                seen = max(seen, message.params.get("revision", 0))
            self.viewer.notifications.clear()
        return (time.perf_counter() - began) * 1e3

    def strokes(self, count: int) -> list[float]:
        return [self.stroke() for _ in range(count)]

    def peak_kib(self, strokes: int) -> int:
        """The daemon's memory at its most while so many strokes are done."""
        self.daemon.forget_peak()
        self.strokes(strokes)
        return self.daemon.peak_kib()

    def cost_kib(self, strokes: int, passes: int) -> int:
        """How much higher the peak is with a deaf subscriber."""
        alone = max(self.peak_kib(strokes) for _ in range(passes))
        deaf = self.attach()
        with_it = max(self.peak_kib(strokes) for _ in range(passes))
        deaf.close()
        return max(0, with_it - alone)


def cost_in_large(yard: Yard) -> int:
    with yard.daemon(environment=LEAN_ALLOCATOR) as daemon:
        studio = Studio(daemon, LARGE_VERTICES, LARGE_TOUCHED)
        studio.strokes(LARGE_WARM)
        return studio.cost_kib(*yard.pick((40, 4), (15, 1)))


def measure_times(studio: Studio, blocks: int, seconds: float) -> tuple[list[float], list[float]]:
    """Milliseconds of strokes (alone, with the deaf one), in blocks that take turns."""
    alone: list[float] = []
    stalled: list[float] = []
    began = time.monotonic()
    for block in range(blocks):
        if block % 2:
            alone += studio.strokes(BLOCK)
        deaf = studio.attach()
        stalled += studio.strokes(BLOCK)
        deaf.close()
        if block % 2 == 0:
            alone += studio.strokes(BLOCK)
        if time.monotonic() - began > seconds:
            break
    return alone, stalled


def measure(yard: Yard, seconds: float) -> dict:
    large = cost_in_large(yard)
    with yard.daemon(environment=LEAN_ALLOCATOR) as daemon:
        studio = Studio(daemon, VERTICES, TOUCHED)
        studio.strokes(WARM)
        small = studio.cost_kib(BLOCK, yard.pick(8, 2))
        alone, stalled = measure_times(studio, yard.pick(200, 16), seconds)
    p99 = [float(np.percentile(times, 99)) for times in (alone, stalled)]
    yard.say(f"  {small} KiB, {large} in a large session; p99 of {len(alone)} strokes "
             f"{p99[0]:.2f} ms alone, {p99[1]:.2f} with it")
    return {"stalled_reader_kib": max(small, large),
            "stalled_reader_p99_ratio": round(p99[1] / p99[0], 4)}
