"""Requests that come a second time, because the answer to the first was lost: applied once.

The connection is cut at every message boundary and within messages, on the way there and on the way
back; the daemon is killed. Whatever was done before, sending all of it again must end in the same
revision and the same bits as if nothing had happened.
"""

from __future__ import annotations

import os
import random
import signal
import socket
import time

import numpy as np
import pytest
import rigs
from core import SkindError
from core.wire import PROTOCOL, Decoder, Message, encode_request

QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")
VERTICES = 144
WHO = {"session": "sheet"}


def make(daemon, name: str = "sheet", **options) -> None:
    with daemon.link() as link:
        link.call("session.create", {"name": name, **rigs.sheet(VERTICES), **options})
        link.call("pose.set", {"session": name, "pose": "bent", "matrices": rigs.bent(0.4)})


def script() -> list[tuple[str, dict]]:
    """Every method that takes a number; what one does depends on those before it."""
    some = np.arange(20, 60, dtype=np.uint32)
    targets = np.random.default_rng(1).uniform(0, 0.5, (len(some), 3)).astype(np.float32)
    rows = np.tile(np.float32([0.25, 0.75, 0, 0]), (5, 1))
    joints = np.tile(np.uint16([2, 3, 65535, 65535]), (5, 1))
    posed = np.tile(np.float32([0.1, 0.5, 0.2]), (VERTICES, 1))
    asked = [
        ("stroke.apply", {"pose": "bent", "vertices": some, "positions": targets, "mix": 0.3}),
        ("history.undo", {}),
        ("history.redo", {"own": True}),
        ("weights.set", {"vertices": some[:5], "weights": rows, "joints": joints}),
        ("pins.weigh", {"pose": "bent", "weight": 3}),
        ("pins.solve", {"pose": "bent"}),
        ("weights.prune", {"below": 0.05}),
        ("stroke.apply", {"pose": "bent", "vertices": some + 30, "positions": targets,
                          "stream": False, "pin": "move"}),
        ("weights.reduce", {"influences": 2, "by": "size"}),
        ("pins.clear", {"vertices": some[:9]}),
        ("session.refit", {"poses": ["bent"], "positions": posed, "stiffness": 1, "rounds": 1}),
        ("weights.mirror", {"tolerance": 0.01, "origin": 0.5}),
        ("history.undo", {"own": True}),
        ("history.undo", {}),
    ]
    return [(method, {**WHO, **params, "sequence": number})
            for number, (method, params) in enumerate(asked, 1)]


def encoded(id: int, method: str, params: dict) -> bytes:
    return b"".join(bytes(piece) for piece in encode_request(id, method, params))


def hello(id: str) -> bytes:
    return encoded(0, "hello", {"protocol": PROTOCOL, "client": {"name": id, "id": id}})


class Peer:
    """A connection whose bytes are the test's."""

    def __init__(self, daemon) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(str(daemon.socket))
        self.socket.settimeout(30)
        self.decoder = Decoder()

    def send(self, data: bytes) -> None:
        try:
            self.socket.sendall(data)
        except (BrokenPipeError, ConnectionResetError):
            pass  # it is seen where the answers are missing

    def read(self, most: int = 1 << 16) -> list[Message]:
        """The messages that so many more bytes complete. Raises ConnectionError at the end."""
        into = self.decoder.get_buffer()
        count = self.socket.recv_into(into[:most])
        if count == 0:
            raise ConnectionError
        return list(self.decoder.advance(count))

    def read_bytes(self, count: int) -> list[Message]:
        """As much as comes of so many bytes."""
        messages: list[Message] = []
        self.socket.settimeout(0.25)
        try:
            while count > 0:
                into = self.decoder.get_buffer()
                got = self.socket.recv_into(into[:min(count, len(into))])
                if got == 0:
                    break
                count -= got
                messages += self.decoder.advance(got)
        except TimeoutError:
            pass
        return messages

    def answers(self, ids: list[int]) -> dict[int, Message]:
        found: dict[int, Message] = {}
        while len(found) < len(ids):
            for message in self.read():
                if message.method is None and message.id in ids:
                    found[message.id] = message
        return found

    def close(self) -> None:
        self.socket.close()


def plain(told: dict) -> dict:
    """An answer without what a second one leaves out, and without times."""
    return {key: value for key, value in told.items()
            if not isinstance(value, np.ndarray) and key not in ("ms", "repeated")}


def contents(link) -> tuple:
    weights = link.call("weights.get", WHO)
    pins = link.call("pins.get", {**WHO, "pose": "bent"})
    return (weights["revision"], weights["joints"].tobytes(), weights["weights"].tobytes(),
            *(pins[name].tobytes() for name in ("vertices", "positions", "weights")))


class Reference:
    """What the script ends in and is answered when nothing is in its way."""

    def __init__(self, daemon) -> None:
        make(daemon)
        self.script = script()
        with daemon.link("tool", id="tool") as link:
            self.told = [link.call(method, params) for method, params in self.script]
            self.contents = contents(link)
            link.call("session.delete", WHO)
        unchanged = [self.script[i][0] for i in range(1, len(self.told))
                     if self.told[i]["revision"] == self.told[i - 1]["revision"]]
        assert unchanged == ["weights.mirror"]
        self.messages = [hello("tool")] + [encoded(number, method, params) for number,
                                           (method, params) in enumerate(self.script, 1)]
        self.ids = list(range(1, len(self.script) + 1))

    def finish(self, daemon) -> int:
        """Sends all of it again, at once; returns how many were done before."""
        peer = Peer(daemon)
        peer.send(b"".join(self.messages))
        answers = peer.answers(self.ids)
        peer.close()
        repeated = 0
        for id, told in zip(self.ids, self.told):
            assert answers[id].error is None, (id, answers[id].error)
            again = answers[id].result
            assert plain(again) == plain(told)
            if "repeated" not in again:
                assert set(again) == set(told)
            else:
                assert repeated == id - 1, "a later one was done, and this one was not"
                assert set(again) - {"repeated"} == {key for key, value in told.items()
                                                     if not isinstance(value, np.ndarray)}
            repeated += "repeated" in again
        with daemon.link() as link:
            assert contents(link) == self.contents
        return repeated


@pytest.fixture
def reference(daemon) -> Reference:
    return Reference(daemon)


def cuts(messages: list[bytes], pick: random.Random) -> list[int]:
    """Every boundary, one byte to either side of it, and somewhere within every message."""
    places, at = [], 0
    for message in messages:
        inside = [16, len(message) - 1, pick.randrange(1, len(message))]
        places += [at + place for place in inside] + [at + len(message)]
        at += len(message)
        places.append(min(at + 1, sum(map(len, messages))))
    return sorted(set(places))


def forget(daemon) -> None:
    with daemon.link() as link:
        link.call("session.delete", WHO)


def test_cut_on_the_way_there(daemon, reference) -> None:
    data = b"".join(reference.messages)
    seen = set()
    places = cuts(reference.messages, random.Random(1))
    for place in places[::3] if QUICK else places:
        make(daemon)
        peer = Peer(daemon)
        peer.send(data[:place])
        if place % 2:
            time.sleep(0.01)
        peer.close()
        seen.add(reference.finish(daemon))
        forget(daemon)
    assert len(seen) > 3, "the cuts all hit the same place"


def test_cut_on_the_way_back(daemon, reference) -> None:
    """The answers are lost from some byte on: whatever the tool heard, it sends all again."""
    data = b"".join(reference.messages)
    pick = random.Random(2)
    for _ in range(12 if QUICK else 60):
        make(daemon)
        peer = Peer(daemon)
        peer.send(data)
        heard = [message for message in peer.read_bytes(pick.randrange(1, 30_000))
                 if message.method is None and message.id]
        peer.close()
        assert reference.finish(daemon) >= len(heard), "what was answered was done"
        forget(daemon)


def test_one_after_the_other_over_many_connections(daemon, reference) -> None:
    """A tool that loses every answer, and sends each request until it hears one."""
    make(daemon)
    for id, message in zip(reference.ids, reference.messages[1:]):
        for attempt in range(3):
            peer = Peer(daemon)
            peer.send(reference.messages[0] + message)
            if attempt < 2:
                peer.close()
                continue
            answer = peer.answers([id])[id]
            peer.close()
            assert answer.error is None and plain(answer.result) == plain(reference.told[id - 1])
    assert reference.finish(daemon) == len(reference.ids)


def test_two_connections_at_once(daemon, reference) -> None:
    """The old connection is not gone yet when the tool sends all again on the next one."""
    for half in range(0, len(reference.messages), 2):
        make(daemon)
        peer = Peer(daemon)
        peer.send(b"".join(reference.messages[:half]))
        first = Peer(daemon)
        first.send(b"".join(reference.messages))
        peer.send(b"".join(reference.messages[half:]))
        for each in (peer, first):
            answers = each.answers(reference.ids)
            assert [plain(answers[id].result) for id in reference.ids] == \
                [plain(told) for told in reference.told]
            each.close()
        assert reference.finish(daemon) == len(reference.ids)
        forget(daemon)


@pytest.mark.parametrize("durability", ["full", "second"])
def test_killed_on_the_way(start, durability) -> None:
    """kill -9: what is there afterwards and what is sent again make the same whole."""
    daemon = start()
    reference = Reference(daemon)
    data = b"".join(reference.messages)
    pick = random.Random(3)
    done = set()
    for round in range(6 if QUICK else 25):
        make(daemon, durability=durability)
        if durability == "second":
            # Its file may lack what was told last, and what was told of it then.
            time.sleep(0.02)
        peer = Peer(daemon)
        peer.send(data)
        heard = len([message for message in peer.read_bytes(pick.randrange(1, 12_000))
                     if message.method is None and message.id])
        assert daemon.stop(signal.SIGKILL) == -signal.SIGKILL
        peer.close()
        daemon = start()
        repeated = reference.finish(daemon)
        assert repeated >= heard or durability == "second"
        done.add(repeated)
        forget(daemon)
    assert len(done) > 1 or durability == "second", "it was always killed at the same place"


def test_remembered_over_a_restart(start) -> None:
    daemon = start()
    reference = Reference(daemon)
    make(daemon)
    assert reference.finish(daemon) == 0
    assert daemon.stop() == 0
    daemon = start()
    assert reference.finish(daemon) == len(reference.ids)
    with daemon.link("tool", id="tool") as link:
        told = link.call("history.redo", {**WHO, "sequence": len(reference.ids) + 1})
        assert "repeated" not in told and told["revision"] == len(reference.ids)


def put(link, sequence: int, vertex: int = 0, **more) -> dict:
    """One row set: a change that is quick to make."""
    return link.call("weights.set", {**WHO, "sequence": sequence, "vertices": [vertex],
                                     "weights": [[1, 0, 0, 0]], **more})


def test_the_last_64_are_known(daemon) -> None:
    make(daemon)
    with daemon.link("tool", id="tool") as link:
        for number in range(1, 65):
            assert put(link, number)["revision"] == number
        assert put(link, 1)["repeated"] is True
        assert put(link, 65)["revision"] == 65
        with pytest.raises(SkindError) as caught:
            put(link, 1)
        assert caught.value.name == "stale_sequence"
        again = put(link, 2)
        assert again["repeated"] is True and again["revision"] == 2
        assert link.call("session.info", WHO)["revision"] == 65
    # Other clients have their own, and who has no id is another at each connection.
    with daemon.link("tool", id="another") as link:
        assert put(link, 1)["revision"] == 66
    for revision in (67, 68):
        with daemon.link("tool") as link:
            assert put(link, 1)["revision"] == revision


def test_who_has_no_id_is_nobody_s_successor(start) -> None:
    """Connections are counted anew by each daemon, and sessions outlive it."""
    daemon = start()
    make(daemon)
    for revision in (1, 2):
        with daemon.link("tool") as link:
            told = put(link, 1)
            assert "repeated" not in told and told["revision"] == revision
        assert daemon.stop() == 0
        daemon = start()
    links = [daemon.link("tool") for _ in range(8)]
    for link in links:
        with pytest.raises(SkindError) as caught:
            link.call("history.undo", {**WHO, "own": True})
        assert caught.value.name == "nothing_to_undo"
        link.close()


def test_what_failed_is_not_remembered(daemon) -> None:
    make(daemon)
    with daemon.link("tool", id="tool") as link:
        with pytest.raises(SkindError) as caught:
            link.call("history.undo", {**WHO, "sequence": 1})
        assert caught.value.name == "nothing_to_undo"
        put(link, 2)
        told = link.call("history.undo", {**WHO, "sequence": 1})
        assert "repeated" not in told and told["revision"] == 2
        assert link.call("history.undo", {**WHO, "sequence": 1})["repeated"] is True


def test_what_changed_nothing_is_done_then_and_not_later(start) -> None:
    daemon = start()
    make(daemon)
    asked = [("weights.prune", {"below": 0.5, "vertices": [0]}),
             ("stroke.apply", {"pose": "bent", "vertices": [], "positions": []}),
             ("pins.clear", {"pose": "bent"})]
    with daemon.link("tool", id="tool") as link:
        for number, (method, params) in enumerate(asked, 1):
            assert link.call(method, {**WHO, **params, "sequence": number})["revision"] == 0
        # Now they would find something to do.
        put(link, 9, weights=[[0.6, 0.4, 0, 0]])
        link.call("stroke.apply", {**WHO, "pose": "bent", "vertices": [5, 6],
                                   "positions": [[0, 0.2, 0.1], [0.1, 0.2, 0.1]]})
    for _ in range(2):
        with daemon.link("tool", id="tool") as link:
            for number, (method, params) in enumerate(asked, 1):
                told = link.call(method, {**WHO, **params, "sequence": number})
                assert told["repeated"] is True and told["revision"] == 0
            assert link.call("session.info", WHO)["revision"] == 2
        assert daemon.stop() == 0
        daemon = start()


def test_a_second_request_need_not_be_the_same(daemon) -> None:
    """The number says what it is; what it is answered is what the first was."""
    make(daemon)
    with daemon.link("tool", id="tool") as link:
        told = put(link, 5, vertex=3)
        again = put(link, 5, vertex=4)
        assert {**told, "repeated": True} == again
        assert link.call("session.info", WHO)["undo_steps"] == 1


def test_a_fork_and_a_copy_begin_anew(daemon, folder) -> None:
    """What a tool sent to one session it did not send to another."""
    make(daemon)
    with daemon.link("tool", id="tool") as link:
        put(link, 1)
        link.call("session.fork", {**WHO, "name": "fork"})
        told = put(link, 1, **{"session": "fork"})
        assert "repeated" not in told and told["revision"] == 2
        path = str(folder / "copy.skind")
        link.call("session.save", {**WHO, "path": path})
        link.call("session.open", {"path": path, "name": "copy"})
        told = put(link, 1, **{"session": "copy"})
        assert "repeated" not in told and told["revision"] == 2
        assert put(link, 1)["repeated"] is True
