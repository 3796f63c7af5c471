# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversations with the daemon, written in one piece: generators that yield requests.

What takes several requests, each of which depends on the answer to the one before, reads from top
to bottom so, although nothing waits: it goes on in the callbacks of a channel.
"""

from __future__ import annotations

from typing import Callable, Generator

from .channel import Request
from .wire import SkindError

Talk = Generator[tuple[str, dict], dict, None]  # yields requests, is sent their results


def hold(talk: Talk, request: Request, on_refused: Callable[[SkindError], None]) -> None:
    """Each request that it yields is sent, its result sent back in, and an error thrown in;
    on_refused is told of one that it did not catch."""

    def go_on(result: dict | None, error: SkindError | None) -> None:
        try:
            method, params = talk.throw(error) if error is not None else talk.send(result)
        except StopIteration:
            return
        except SkindError as refused:
            on_refused(refused)
            return
        request(method, params, go_on)

    go_on(None, None)
