# SPDX-License-Identifier: GPL-3.0-or-later
"""Who else is in a session, what they say that they work on, and what we do: claims.

A claim names bones or vertices. It stops nobody: it is for people to see. Fed by the answer to
session.attach and by the notifications session.presence and session.claims; forgotten with the
connection, but for our own claim, which is told again. Knows no modelling program.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Callable, Sequence

import numpy as np

from .channel import Request
from .skin import NO_BONE
from .state import NONE, State
from .wire import GONE, Message, SkindError



def tool_name(client: str) -> str:
    """What a tool is called in hello, without what tells it from its like, as in "X (a1b2c3)"."""
    return re.sub(r" \([0-9a-f]{6}\)$", "", client) or "another tool"


def called(client: str, user: str) -> str:
    """Who does something: "Ben (skinctl)", or the tool alone."""
    return f"{user} ({tool_name(client)})" if user else tool_name(client)


@dataclass(frozen=True)
class Other:
    """Another tool that is attached, and how much it claims."""

    connection: int
    client: str
    user: str
    version: str
    since: int  # unix time, seconds
    bones: tuple[str, ...]
    vertices: int  # a count

    @property
    def tool(self) -> str:
        """Its name for people."""
        return tool_name(self.client)

    @property
    def name(self) -> str:
        """The person's, or else the tool's."""
        return self.user or self.tool

    @property
    def claims(self) -> bool:
        return bool(self.bones or self.vertices)


@dataclass(frozen=True, eq=False)
class Claim:
    """bones by name; vertices u32 [n]."""

    bones: tuple[str, ...] = ()
    vertices: np.ndarray = field(default_factory=lambda: NONE)

    def __bool__(self) -> bool:
        return bool(self.bones) or len(self.vertices) > 0

    def params(self) -> dict:
        """As session.claim takes it."""
        return {**({"bones": list(self.bones)} if self.bones else {}),
                **({"vertices": self.vertices} if len(self.vertices) else {})}


class Presence:
    """`request` sends one about the session; `say` tells a refusal."""

    def __init__(self, request: Request, say: Callable[[str], None]) -> None:
        self._request, self._say = request, say
        self.others: list[Other] = []  # the one who came first comes first
        self.own = Claim()
        self.version = 0  # + 1 whenever anything in here changes
        self._connection = -1  # ours
        self._claims: dict[int, Claim] = {}  # of the others, by their connection

    # ---- what the daemon says ----

    def attached(self, answer: dict) -> None:
        """session.attach was answered. Claims of the others follow as notifications."""
        self._connection = answer.get("connection", -1)
        self._claims.clear()
        self._take(answer.get("present", []))
        if self.own:
            self._tell(self.own)

    def notice(self, message: Message) -> bool:
        """A notification about the session; False: it is not about who is here."""
        if message.method == "session.presence":
            self._take(message.params["present"])
        elif message.method == "session.claims":
            params = message.params
            self._claims[params["connection"]] = Claim(
                tuple(params["bones"]), params.get("vertices", NONE))
            self.version += 1
        else:
            return False
        return True

    def _take(self, present: list[dict]) -> None:
        self.others = [
            Other(each["connection"], each["client"], each["user"], each["version"],
                  each["since"], tuple(each["claim"]["bones"]), each["claim"]["vertices"])
            for each in present if each["connection"] != self._connection]
        claiming = {other.connection for other in self.others if other.claims}
        self._claims = {connection: claim for connection, claim in self._claims.items()
                        if connection in claiming}
        self.version += 1

    def lost(self) -> None:
        """The connection is gone, and with it the others. Our own claim waits for the next."""
        self.others = []
        self._claims.clear()
        self.version += 1

    def end(self) -> None:
        """The session is over for this tool."""
        self.own = Claim()
        self.lost()

    # ---- what others claim ----

    @property
    def claiming(self) -> list[Other]:
        """Those who claim something."""
        return [other for other in self.others if other.claims]

    def claimed(self, state: State, bones: Sequence[str],
                part: slice = slice(None)) -> np.ndarray:
        """bool [n]: which vertices (of these) others claim; `bones` are what joints count.

        A bone claims the vertices that follow it more than any other; of bones that they follow
        alike the first in their row counts. So the daemon has it.
        """
        mask = np.zeros(len(state.joints), bool)
        names = set()
        for claim in self._claims.values():
            mask[claim.vertices] = True
            names.update(claim.bones)
        mask = mask[part]
        if names:
            is_claimed = np.zeros(NO_BONE + 1, bool)
            is_claimed[[bone for bone, name in enumerate(bones) if name in names]] = True
            joints, weights = state.joints[part], state.weights[part]
            mask |= is_claimed[joints[np.arange(len(joints)), weights.argmax(axis=1)]]
        return mask

    # ---- what we claim ----

    def claim(self, bones: Sequence[str] = (), vertices: np.ndarray = NONE) -> None:
        """Says that we work on these, instead of what we said before."""
        self._own(Claim(tuple(bones), vertices))

    def release(self) -> None:
        self._own(Claim())

    def _own(self, claim: Claim) -> None:
        self.own = claim
        self.version += 1
        self._tell(claim)

    def _tell(self, claim: Claim) -> None:
        def done(result: dict | None, error: SkindError | None) -> None:
            if error is not None and error.name not in GONE:
                self._say(str(error))
                if self.own is claim:
                    self.own = Claim()
                    self.version += 1

        self._request("session.claim", claim.params(), done)
