"""A tool that follows a rig session: the rule of protocol/PROTOCOL.md, and nothing cleverer.

`have` is the revision that the tool has whole. An update counts if it ends behind `have` and begins
at or before it. What the tool knows of its own change counts when the answer comes, if its revision is
one more than `have`; otherwise an update that covers it comes. What cannot be followed is fetched.
"""

from __future__ import annotations

import hashlib
import socket
import time
from collections import Counter
from pathlib import Path

import numpy as np
import schemas
from core import Link
from core.stream import Stream
from core.wire import Decoder, Message, encode_request

# What a tool fetches to have all of a session: shapes of these poses too.
FETCH = ["weights.get", "mesh.get", "shapes.get", "weights.get"]


def next_update(link: Link, seconds: float = 20) -> dict:
    """The next session.update of a connection. It may come behind the answer to what was asked
    after the change; notifications before it are dropped."""
    deadline = time.monotonic() + seconds
    while True:
        while link.notifications:
            message = link.notifications.popleft()
            if message.method == "session.update":
                return message.params
        assert time.monotonic() < deadline, "no session.update"
        link.pump(0.01)


class State:
    """Weights, bones, rest positions and corrective shapes of a session."""

    def __init__(self, vertices: int) -> None:
        self.weights = self.joints = self.rest = None
        self.shapes: dict[str, np.ndarray] = {}
        self.vertices = vertices

    def write(self, told: dict) -> None:
        """Puts the arrays of session.update or stroke.weights in their places."""
        where = np.asarray(told["vertices"], np.uint32)
        assert len(np.unique(where)) == len(where), "a vertex is told twice"
        for name, dtype in (("weights", np.float32), ("joints", np.uint16), ("rest", np.float32)):
            if name in told and len(where):
                getattr(self, name)[where] = np.asarray(told[name], dtype)
        if "offsets" in told and len(where):
            self.shape(told["shape"])[where] = np.asarray(told["offsets"], np.float32)

    def shape(self, pose: str) -> np.ndarray:
        return self.shapes.setdefault(pose, np.zeros((self.vertices, 3), np.float32))

    def digest(self) -> str:
        parts = [self.weights, self.joints, self.rest]
        for pose in sorted(self.shapes):
            if self.shapes[pose].any():
                parts += [np.frombuffer(pose.encode(), np.uint8), self.shapes[pose] + np.float32(0)]
        return hashlib.blake2b(b"".join(part.tobytes() for part in parts), digest_size=12).hexdigest()


class Follower:
    """One connection that is attached to one session; never waits.

    `seen` is shared: the digest of each revision, of its instance, that anybody had whole. Two who
    have the same revision must have the same bits.
    """

    def __init__(self, path: Path, session: str, vertices: int, poses: list[str],
                 seen: dict[tuple[str, int], str], name: str = "follower", lines: bool = False,
                 checked: bool = False) -> None:
        self.path, self.session, self.poses, self.seen = path, session, poses, seen
        self.name, self.lines, self.checked = name, lines, checked
        self.state = State(vertices)
        self.have: int | None = None
        self.instance: str | None = None
        self.counts: Counter = Counter()
        self.errors: Counter = Counter()
        self.notifications: list[Message] = []
        self.closed = False
        self._next_id = 1
        self._connect()

    # ---- the connection: also the `exchange` of its Stream ----

    def _connect(self) -> None:
        self.asked: dict[int, tuple[str, dict]] = {}
        self.streams: dict[int, list[dict]] = {}
        self.fetched: list[dict] | None = None
        self._decoder = Decoder()
        self._watch = schemas.watch() if self.checked else None
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.connect(str(self.path))
        self.stream = Stream(connection, self)
        self.ask("hello", {"protocol": {"min": 1, "max": 1}, "client": {"name": self.name}})
        held = {} if self.have is None else {"revision": self.have, "instance": self.instance}
        self.ask("session.attach", {"session": self.session, **held})

    def reconnect(self) -> None:
        """Hangs up in the middle of whatever it is and comes back."""
        self.stream.close()
        self.counts["reconnects"] += 1
        self._connect()

    def ask(self, method: str, params: dict) -> int:
        id, self._next_id = self._next_id, self._next_id + 1
        self.asked[id] = (method, params)
        self.stream.push(encode_request(id, method, params, lines=self.lines))
        if self._watch is not None:
            self._watch._methods[id] = method
        return id

    def pump(self) -> None:
        """Writes and reads what goes without waiting."""
        while self.stream.send():
            pass
        while self.stream.receive():
            pass

    def get_buffer(self) -> memoryview:
        return self._decoder.get_buffer()

    def advance(self, count: int) -> None:
        for message in self._decoder.advance(count):
            if self._watch is not None:
                self._watch("received", message.raw)
            if message.method is not None:
                self._notified(message)
            else:
                self._answered(message)

    # ---- what comes, in its order ----

    def _notified(self, message: Message) -> None:
        told = message.params
        if message.method == "session.update":
            self._updated(told)
        elif message.method == "stroke.weights":
            self.streams.setdefault(told["request"], []).append(told)
        elif message.method == "session.closed":
            self.closed = True
        else:
            self.notifications.append(message)

    def _updated(self, told: dict) -> None:
        self.counts["updates"] += 1
        since, revision = told["since"], told["revision"]
        assert since < revision
        changes = told.get("changes", [{"revision": revision}])
        if "resync" not in told:
            assert [change["revision"] for change in changes] == list(range(since + 1, revision + 1))
            self.counts["merged"] += len(changes) > 1
        self.instance = told["instance"]
        if self.have is None or revision <= self.have:
            return
        if "resync" in told:
            self.counts["resyncs"] += 1
            self.fetch()
            return
        assert since <= self.have, f"{self.name} has {self.have} and is told what came after {since}"
        self.state.write(told)
        self._arrive(revision)

    def _answered(self, message: Message) -> None:
        method, params = self.asked.pop(message.id)
        streamed = self.streams.pop(message.id, [])
        if message.error is not None:
            self.errors[message.error.name] += 1
            if method in FETCH:
                raise message.error
            return
        result = message.result
        if method == "session.attach":
            self._attached(result)
        elif method in FETCH and self.fetched is not None:
            self._fetching({**result, "of": params.get("pose")})
        elif method in ("pins.clear", "pins.weigh") and result["vertices"]:
            self._knows(result, [])  # which no weight, bone or shape shows
        elif method == "weights.set":
            self._knows(result, [params])
        elif streamed:
            assert sum(told["count"] for told in streamed) == result["vertices"]
            self._knows(result, streamed)

    def _attached(self, result: dict) -> None:
        self.instance = result["instance"]
        if result["resync"]:
            self.counts["attached anew"] += 1
            if self.fetched is None:
                self.fetch()
        else:
            self.counts["caught up"] += self.have is not None and result["revision"] > self.have

    def _knows(self, result: dict, told: list[dict]) -> None:
        """An answer of its own, with what it knows of it."""
        if self.have is None or result["revision"] <= self.have:
            self.counts["own, told already"] += 1
        elif result["revision"] == self.have + 1:
            self.counts["own"] += 1
            for part in told:
                self.state.write(part)
            self._arrive(result["revision"])
        else:
            self.counts["own, told later"] += 1

    def _arrive(self, revision: int) -> None:
        self.have = revision
        digest = self.state.digest()
        known = self.seen.setdefault((self.instance, revision), digest)
        assert known == digest, f"{self.name} differs at revision {revision} of {self.instance}"

    # ---- fetching everything ----

    def fetch(self) -> None:
        self.have, self.fetched = None, []
        self.counts["fetched"] += 1
        self.ask("weights.get", {"session": self.session})
        self.ask("mesh.get", {"session": self.session})
        for pose in self.poses:
            self.ask("shapes.get", {"session": self.session, "pose": pose})
        self.ask("weights.get", {"session": self.session})

    def _fetching(self, result: dict) -> None:
        self.fetched.append(result)
        if len(self.fetched) < 3 + len(self.poses):
            return
        first, mesh, *shapes, last = self.fetched
        self.fetched = None
        if first["revision"] != last["revision"]:
            self.fetch()
            return
        state = self.state = State(self.state.vertices)
        slots = last["influences"]
        state.weights = np.array(last["weights"], np.float32).reshape(-1, slots)
        state.joints = np.array(last["joints"], np.uint16).reshape(-1, slots)
        state.rest = np.array(mesh["rest"], np.float32).reshape(-1, 3)
        for shape in shapes:
            where = np.asarray(shape["vertices"], np.uint32)
            if len(where):
                state.shape(shape["of"])[where] = np.asarray(shape["offsets"], np.float32)
        self._arrive(last["revision"])
