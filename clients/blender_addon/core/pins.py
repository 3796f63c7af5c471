# SPDX-License-Identifier: GPL-3.0-or-later
"""The targets that the daemon keeps for each pose that was sculpted in: which there are.

Only counted here, for people to see; the daemon alone has the targets, and says nothing when they
change with a stroke. So they are asked for when the tool has time, at most once a revision.
"""

from __future__ import annotations

from typing import Iterator

from .channel import Request
from .wire import SkindError


class Pins:
    """As pins.list told them last: a dict a pose. `revision`: of which they were asked for."""

    def __init__(self, request: Request) -> None:
        self._request = request
        self._listed: list[dict] = []
        self.revision = -1

    def __len__(self) -> int:
        return len(self._listed)

    def __getitem__(self, index):
        return self._listed[index]

    def __iter__(self) -> Iterator[dict]:
        return iter(self._listed)

    def ask(self, revision: int) -> None:
        """Has them told anew if something was done since."""
        if self.revision == revision:
            return
        self.revision = revision

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None:
                self._listed = result["pins"]

        self._request("pins.list", {}, done)

    def lost(self) -> None:
        """The connection is gone, and maybe with it the answer."""
        self.revision = -1
