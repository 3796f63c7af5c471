# SPDX-License-Identifier: GPL-3.0-or-later
"""The daemon's history of undo, as far as a tool saw it grow. Pure.

It is there to tell which of the tool's own steps history.undo or history.redo would take next: only
then may the daemon follow the tool's undo with these. A tool that joined later, or missed
something, knows less than the daemon does, or nothing; then it sets the rows instead.
"""

from __future__ import annotations

from dataclasses import dataclass

from .steps import Step

OPPOSITE = {"undo": "redo", "redo": "undo"}


@dataclass(eq=False)
class Entry:
    """A step of the daemon's history; `step` is ours that shows it, once it is shown."""

    step: Step | None = None
    dropped: bool = False  # its stroke was undone before its answer came


class History:
    """Two stacks, by the verb that takes from them: "undo" and "redo"."""

    def __init__(self) -> None:
        self._stacks: dict[str, list[Entry]] = {"undo": [], "redo": []}

    def add(self, entry: Entry) -> Entry:
        """Something was done; what was undone cannot be redone any more."""
        self._stacks["undo"].append(entry)
        self._stacks["redo"].clear()
        return entry

    def next(self, verb: str) -> Entry | None:
        """What the daemon would undo or redo next, as far as it is known."""
        stack = self._stacks[verb]
        return stack[-1] if stack else None

    def take(self, verb: str) -> None:
        """It was undone or redone; a step from before we listened, too."""
        stack = self._stacks[verb]
        self._stacks[OPPOSITE[verb]].append(stack.pop() if stack else Entry())

    def keep_dropped(self) -> None:
        """Entries whose strokes were dropped stay: what was left of them is put right otherwise."""
        for entry in self._stacks["undo"]:
            entry.dropped = False

    def forget(self) -> None:
        """More was done than we were told."""
        for stack in self._stacks.values():
            stack.clear()
