# SPDX-License-Identifier: GPL-3.0-or-later
"""The last thing worth telling the artist, shown in the panel; it outlives what it is about."""

from __future__ import annotations

import traceback

_message = ""


def tell(message: str) -> None:
    global _message
    _message = message


def told() -> str:
    return _message


def fault(error: BaseException) -> None:
    """Something that must not happen did: for the console whole, for the panel in a sentence."""
    traceback.print_exception(error)
    tell(f"a fault of skind's add-on: {error!r}; please report it")
