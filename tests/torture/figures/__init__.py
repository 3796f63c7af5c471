"""The figures to reach: what each is about, what is wanted, and which module measures it."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Callable

from . import (clients, descriptors, determinism, faults, fuzzing, kills, races, recovery, soak,
               stalled, torn)


@dataclass(frozen=True)
class Figure:
    key: str
    text: str
    at_least: float | None = None
    at_most: float | None = None
    quick: float | None = None  # in place of either with --quick

    def wanted(self, quick: bool) -> str:
        if self.at_least is not None:
            return f">= {self._bound(self.at_least, quick):,.10g}"
        if self.at_most is not None:
            return f"<= {self._bound(self.at_most, quick):,.10g}"
        return "pass"

    def _bound(self, bound: float, quick: bool) -> float:
        return self.quick if quick and self.quick is not None else bound

    def is_reached(self, value: float | str | None, quick: bool) -> bool:
        if value is None:
            return False
        if self.at_least is not None:
            return value >= self._bound(self.at_least, quick)
        if self.at_most is not None:
            return value <= self._bound(self.at_most, quick)
        return value == "pass"


@dataclass(frozen=True)
class Part:
    """Figures that one module measures: its measure(yard, seconds) returns their values by key."""

    module: ModuleType
    seconds: float        # its share of the whole run
    quick_seconds: float  # and of --quick
    figures: tuple[Figure, ...]

    @property
    def name(self) -> str:
        return self.module.__name__.rsplit(".", 1)[1]

    @property
    def measure(self) -> Callable:
        return self.module.measure


# How long all of it may take; the shares of the parts leave room for a slow day.
SECONDS, QUICK_SECONDS = 1800, 180
PARTS = (
    Part(kills, 180, 15, (
        Figure("kill9_rounds", "kill -9 under load and restart", at_least=500, quick=10),
        Figure("kill9_lost", "of these in which something was lost", at_most=0))),
    Part(torn, 90, 5, (
        Figure("torn_cases", "damaged journals read", at_least=5000, quick=200),
        Figure("torn_failed", "of these with wrong weights, or a failed start", at_most=0))),
    Part(faults, 600, 20, (
        Figure("fault_points", "calls made to fail, one after the other: all that there are",
               at_least=10_000, quick=50),
        Figure("fault_failed", "of these with a crash, or half a stroke", at_most=0))),
    Part(fuzzing, 240, 20, tuple(
        Figure(key, "inputs without a crash, leak or hang", at_least=1000, quick=1)
        for key in fuzzing.PROGRAMS)),
    Part(races, 45, 8, (
        Figure("race_starts", "rounds of 100 simultaneous starts", at_least=20, quick=2),)),
    Part(descriptors, 15, 6, (
        Figure("fd_exhausted", "descriptors used up"),)),
    Part(clients, 60, 12, (
        Figure("clients_active", "that work at once", at_least=64),
        Figure("clients_idle", "that are there at once", at_least=1000))),
    Part(stalled, 90, 12, (
        Figure("stalled_reader_kib", "memory that a deaf subscriber costs", at_most=4096),
        Figure("stalled_reader_p99_ratio", "others' p99 with it against none", at_most=1.1,
               quick=1.5))),
    Part(determinism, 45, 10, (
        Figure("determinism", "same bytes, whoever plays a recording, and after restarts"),)),
    Part(recovery, 30, 10, (
        Figure("recovery_ms", "200k vertices, 1,000 strokes", at_most=2000),)),
    Part(soak, 180, 12, (
        Figure("soak_strokes", "strokes one after the other", at_least=100_000, quick=3000),
        Figure("soak_rss_drift", "growth of memory after warm-up, share", at_most=0.01,
               quick=0.2),
        Figure("soak_fd_drift", "growth of descriptors", at_most=0))),
)
FIGURES = (*(figure for part in PARTS for figure in part.figures),
           Figure("seconds", "of the whole run", at_most=SECONDS, quick=QUICK_SECONDS))
