# SPDX-License-Identifier: GPL-3.0-or-later
"""Callbacks in the order in which they are due: `Calls`. What one raises does not stop the next.

Owns the queue. No thread; whoever makes the calls decides when.
"""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import Callable


class Calls:
    """A queue of calls to make, and of what they raised."""

    def __init__(self) -> None:
        self._due: deque[Callable[[], None]] = deque()
        self._failures: deque[Exception] = deque()

    def add(self, call: Callable | None, *arguments: object) -> None:
        """A call to make; None: nobody wants to be called."""
        if call is not None:
            self._due.append(partial(call, *arguments))

    def clear(self) -> None:
        self._due.clear()

    def make_one(self, on_error: Callable[[Exception], None] | None) -> bool:
        """Makes the next call; False: none is due. on_error is told what it raised."""
        if not self._due:
            return False
        try:
            self._due.popleft()()
        except Exception as error:  # whatever it was, the others must be called
            self._report(error, on_error)
        return True

    def raise_failure(self) -> None:
        """Raises what on_error was not there for, one each time, the oldest first."""
        if self._failures:
            raise self._failures.popleft()

    def _report(self, error: Exception, on_error: Callable[[Exception], None] | None) -> None:
        if on_error is None:
            self._failures.append(error)
            return
        try:
            on_error(error)
        except Exception as failure:
            self._failures.append(failure)
