# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses that should look as they do while others are sculpted. Of those that it is given the daemon
picks some that are far from each other. They are no part of the session's history, and are told
again to a daemon that has not heard of them, or has forgotten them.
"""

from __future__ import annotations

from typing import Callable

import numpy as np

from .channel import Request
from .wire import GONE, SkindError


class Guard:
    """`kept`: what the daemon has picked. `request` sends one about the session; `say` tells a
    refusal."""

    def __init__(self, request: Request, say: Callable[[str], None]) -> None:
        self._request, self._say = request, say
        self._matrices: np.ndarray | None = None
        self._count = 0
        self.kept: list[dict] = []
        self.is_told = True

    @property
    def is_set(self) -> bool:
        return self._matrices is not None

    def set(self, matrices: np.ndarray | None, count: int, on_done: Callable[[], None]) -> None:
        """Keeps `count` of these poses f64 [Q*B,4,4], which are the session's. None: no poses."""
        self._matrices, self._count = matrices, count
        self.is_told = False  # it is told again when resumed

        def done(result: dict | None, error: SkindError | None) -> None:
            self.is_told = error is None or error.name not in GONE
            if result is not None:
                self.kept = result["poses"]
            elif self.is_told:
                self._matrices, self.kept = None, []
                self._say(str(error))
            on_done()

        self._request("guard.set", self.params(), done)

    def params(self) -> dict:
        """As guard.set takes it."""
        return {} if self._matrices is None else {"matrices": self._matrices, "count": self._count}
