# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that takes longer than a tick: generators, a piece at a time, one job after the other.

A job yields often: None, its progress from 0 to 1, or WAIT when there is nothing to do before the
next tick. Only the timer's thread, which is Blender's main one.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Callable, Generator

WAIT = object()


class Refused(Exception):
    """A job that cannot go on; the text is for the user."""


class Cancelled(Refused):
    """A job that somebody ended."""


class Job:
    """`label` says what is done; `progress` 0 to 1, or None while it is not known."""

    def __init__(self, work: Generator, label: str, ended: Callable[[Exception | None], None]):
        self.work = work
        self.label = label
        self.progress: float | None = None
        self.is_over = False
        self._ended = ended

    def step(self) -> bool:
        """One piece. False when there is nothing to do before the next tick."""
        try:
            said = next(self.work)
        except StopIteration:
            self._end(None)
        except Exception as error:  # whatever it was, the next job must have its turn
            self._end(error)
        else:
            if isinstance(said, float):
                self.progress = said
            return said is not WAIT
        return False

    def cancel(self) -> None:
        """Ends it where it stands; its `finally` clauses clean up."""
        if not self.is_over:
            self.work.close()
            self._end(Cancelled("cancelled"))

    def _end(self, error: Exception | None) -> None:
        self.is_over = True
        if self in _queue:
            _queue.remove(self)
        self._ended(error)


_queue: deque[Job] = deque()


def run(work: Generator, label: str,
        ended: Callable[[Exception | None], None] = lambda error: None) -> Job:
    """Does the work after what is queued already; `ended` hears of the error, or None."""
    job = Job(work, label, ended)
    _queue.append(job)
    return job


def current() -> Job | None:
    return _queue[0] if _queue else None


def advance(budget_s: float) -> None:
    """Goes on with the first job until the budget is used, or until it waits."""
    deadline = time.perf_counter() + budget_s
    while _queue and _queue[0].step() and time.perf_counter() < deadline:
        pass


def drain() -> None:
    """Goes on until the first job waits: what touches the mesh is never left half done."""
    while _queue and _queue[0].step():
        pass


def clear() -> None:
    while _queue:
        _queue[0].cancel()
