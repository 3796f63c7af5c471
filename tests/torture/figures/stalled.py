"""A subscriber that never reads: what it costs the daemon, and what the others notice of it.

Blocks of strokes with and without it alternate on one daemon, so that both see the same machine;
the ratio is the median over rounds of many blocks.
"""

from __future__ import annotations

import statistics
import time

import numpy as np
from core import Link

from .. import work
from ..yard import Daemon, Yard

VERTICES = 20_000
TOUCHED = 2_000  # a stroke's, so that an update is some 50 KiB
BLOCK = 50  # strokes between two that the machine sees alike
WARM_STROKES = 700  # until all is full that the daemon keeps of the last changes


class Artist:
    """Strokes to and fro on one session, each answered before the next."""

    def __init__(self, daemon: Daemon) -> None:
        self.link = daemon.link()
        work.create(self.link, "deaf", VERTICES)
        positions = work.rigs.sheet(VERTICES)["positions"]
        self.vertices = np.arange(TOUCHED, dtype=np.uint32)
        self.targets = [positions[:TOUCHED] + np.float32(offset) for offset in (0.001, -0.001)]

    def stroke(self, turn: int) -> float:
        """Milliseconds until the answer."""
        began = time.perf_counter()
        self.link.call("stroke.apply", {
            "session": "deaf", "pose": "rest", "vertices": self.vertices, "stream": False,
            "stiffness": 0, "positions": self.targets[turn % 2]})
        self.link.call("history.undo", {"session": "deaf"})
        self.link.notifications.clear()
        return (time.perf_counter() - began) * 1e3

    def strokes(self, count: int) -> list[float]:
        return [self.stroke(turn) for turn in range(count)]


def attach(daemon: Daemon) -> Link:
    link = daemon.link()
    link.call("session.attach", {"session": "deaf"})
    return link


def play_round(daemon: Daemon, artist: Artist, blocks: int) -> tuple[float, float, int]:
    """(p99 alone, p99 with the deaf one, KiB that it cost), in blocks that take turns."""
    alone: list[float] = []
    stalled: list[float] = []
    cost = 0
    for block in range(blocks):
        if block % 2:
            alone += artist.strokes(BLOCK)
        before = daemon.rss_kib()
        deaf = attach(daemon)
        stalled += artist.strokes(BLOCK)
        cost = max(cost, daemon.rss_kib() - before)
        deaf.close()
        if block % 2 == 0:
            alone += artist.strokes(BLOCK)
    return float(np.percentile(alone, 99)), float(np.percentile(stalled, 99)), cost


def measure(yard: Yard, seconds: float) -> dict:
    rounds, blocks = yard.pick(25, 7), yard.pick(12, 4)
    with yard.daemon() as daemon:
        artist = Artist(daemon)
        artist.strokes(WARM_STROKES)
        played, began = [], time.monotonic()
        while len(played) < rounds and time.monotonic() - began < 2 * seconds:
            played.append(play_round(daemon, artist, blocks))
    ratios = [stalled / alone for alone, stalled, _ in played]
    costs = [cost for _, _, cost in played]
    yard.say(f"  p99 {statistics.median(one[0] for one in played):.2f} ms alone, ratios "
             f"{min(ratios):.2f} to {max(ratios):.2f} in {len(ratios)} rounds, memory {min(costs)} "
             f"to {max(costs)} KiB")
    return {"stalled_reader_kib": max(costs),
            "stalled_reader_p99_ratio": round(statistics.median(ratios), 4)}
