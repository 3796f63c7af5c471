# SPDX-License-Identifier: GPL-3.0-or-later
"""What a tool has asked a session to change and has no answer to, over lost connections too. Pure.

A change has a number by which the daemon knows it when it comes again (protocol/PROTOCOL.md,
Sharing). So what has no answer when a connection breaks is sent once more, in the same order and
with the same numbers, and is done once.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Callable

import numpy as np

from .state import Change
from .wire import SkindError

Done = Callable[["dict | None", "SkindError | None"], None]


@dataclass(eq=False)
class Stroke:
    """A stroke on its way. vertices u32 [n], targets f32 [n,3] in mesh space; pose f64 [B,4,4].

    `result` is there when it is answered, `error` when it was refused. `host` is the tool's own.
    """

    vertices: np.ndarray
    targets: np.ndarray
    pose: np.ndarray
    pose_name: str
    options: dict
    host: Any = None
    ask: Ask | None = None  # by which it was asked for last
    chunks: list[Change] = field(default_factory=list)
    solved: int = 0
    result: dict | None = None
    error: SkindError | None = None
    dropped: bool = False
    begun: float = field(default_factory=time.monotonic)
    seconds: float = 0.0

    @property
    def is_answered(self) -> bool:
        return self.result is not None or self.error is not None


@dataclass(eq=False)
class Ask:
    """A request that changes a session. `vertices`: which, as far as one knows it beforehand.

    `replays`: it is still wanted in a session that was made again, or in which others were at work
    meanwhile. An undo, or rows to set, are not: they follow from what the tool shows.
    """

    method: str
    params: dict
    done: Done
    vertices: np.ndarray
    stroke: Stroke | None = None
    replays: bool = True
    sequence: int = 0  # 0: it has none
    request: int | None = None  # None: not sent, or its connection was lost
    in_doubt: bool = False  # its connection was lost before the answer: it was done or not
    is_cancelled: bool = False
    hidden: list[tuple[np.ndarray, str]] = field(default_factory=list)  # shown when it is answered

    @property
    def poses(self) -> list[str]:
        """Those that it names."""
        named = [self.params[key] for key in ("pose", "shape") if self.params.get(key)]
        return named + list(self.params.get("poses", ()))
