"""Limits on what a peer chooses and that no request states: memory, sessions, connections."""

from __future__ import annotations

import contextlib
import json
import resource
import socket
import struct
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
from core import Link, SkindError
from daemons import Daemon

MIB = 1 << 20
CONNECTIONS = 1200
SESSIONS = 64


def create(link: Link, name: str, vertices: int, **more) -> str:
    """Makes a session, or says how it was refused."""
    try:
        link.call("session.create", {"name": name, **rigs.sheet(vertices), "durability": "off",
                                     **more})
    except SkindError as refusal:
        return refusal.name
    return "made"


def change(link: Link, name: str, vertices: int) -> str:
    """Makes a step of all vertices, or says how it was refused."""
    try:
        link.call("weights.set", {
            "session": name, "vertices": np.arange(vertices, dtype=np.uint32),
            "weights": np.tile(np.array([1, 0, 0, 0], np.float32), (vertices, 1)),
            "joints": np.tile(np.array([np.random.default_rng().integers(12)] + 3 * [65535],
                                       np.uint16), (vertices, 1))})
    except SkindError as refusal:
        return refusal.name
    return "done"


def bytes_of(link: Link, name: str) -> int:
    return link.call("session.info", {"session": name})["bytes"]


@pytest.fixture(scope="module")
def sheet_bytes() -> dict[int, int]:
    """What a session of so many vertices takes, as the daemon counts it."""
    sizes = {}
    with tempfile.TemporaryDirectory(prefix="skind-test-") as folder:
        daemon = Daemon(Path(folder)).wait_ready()
        with daemon.link() as link:
            for count in [side * side for side in range(80, 260, 4)]:
                assert create(link, f"sheet-{count}", count) == "made"
                sizes[count] = bytes_of(link, f"sheet-{count}")
                link.call("session.delete", {"session": f"sheet-{count}"})
        assert daemon.stop() == 0
    return sizes


def test_hello_tells_the_limits(start) -> None:
    with start("--memory", "100", "--session-memory", "40").link() as link:
        limits = link.hello["limits"]
        assert (limits["total_bytes"], limits["session_bytes"]) == (100 * MIB, 40 * MIB)


def test_by_default_the_limits_are_parts_of_the_machine(daemon) -> None:
    words = Path("/proc/meminfo").read_text().split()
    machine = int(words[words.index("MemTotal:") + 1]) * 1024
    with daemon.link() as link:
        assert link.hello["limits"]["total_bytes"] == pytest.approx(0.75 * machine, rel=1e-3)
        assert link.hello["limits"]["session_bytes"] == pytest.approx(0.5 * machine, rel=1e-3)


def test_a_session_just_below_the_limit_is_made_and_just_above_is_not(start, sheet_bytes) -> None:
    limit = 6
    below = max(count for count, bytes_ in sheet_bytes.items() if bytes_ <= limit * MIB)
    above = min(count for count, bytes_ in sheet_bytes.items() if bytes_ > limit * MIB)
    with start("--session-memory", str(limit)).link() as link:
        assert create(link, "above", above) == "too_large"
        assert create(link, "below", below) == "made"
        assert [item["session"] for item in link.call("session.list")["sessions"]] == ["below"]
        assert create(link, "above", above) == "too_large"  # nothing of it was left behind


def test_all_sessions_together_have_a_limit(start, sheet_bytes) -> None:
    count = 10_000
    room = 8 * MIB // sheet_bytes[count]
    with start("--memory", "8").link() as link:
        for i in range(room):
            assert create(link, f"s{i}", count) == "made"
        assert create(link, "more", count) == "too_large"
        with pytest.raises(SkindError) as refusal:
            link.call("session.fork", {"session": "s0", "name": "fork"})
        assert refusal.value.name == "too_large" and "--memory" in refusal.value.message
        link.call("session.delete", {"session": "s0"})
        assert create(link, "more", count) == "made"


def test_steps_end_where_the_session_is_full(start, sheet_bytes) -> None:
    count = 10_000
    limit = sheet_bytes[count] // MIB + 4
    with start("--session-memory", str(limit)).link() as link:
        assert create(link, "sheet", count) == "made"
        for _ in range(20):
            if change(link, "sheet", count) == "too_large":
                break
            assert bytes_of(link, "sheet") <= limit * MIB
        else:
            raise AssertionError("no step was refused")
        before = link.call("weights.get", {"session": "sheet"})
        assert change(link, "sheet", 100) == "done"  # a small one still has room
        link.call("history.undo", {"session": "sheet"})
        after = link.call("weights.get", {"session": "sheet"})
        assert np.array_equal(before["weights"], after["weights"])
        # With less history there is room again.
        link.call("session.set", {"session": "sheet", "history_bytes": MIB})
        assert change(link, "sheet", count) == "done"


def test_a_step_that_pushes_older_ones_out_needs_no_more(start, sheet_bytes) -> None:
    count = 10_000
    limit = sheet_bytes[count] // MIB + 4
    with start("--session-memory", str(limit)).link() as link:
        assert create(link, "sheet", count, history_bytes=MIB) == "made"
        for _ in range(20):
            assert change(link, "sheet", count) == "done"
        assert bytes_of(link, "sheet") <= limit * MIB


def test_as_many_sessions_as_hello_tells(daemon) -> None:
    with daemon.link() as link:
        assert link.hello["limits"]["sessions"] == SESSIONS
        for i in range(SESSIONS - 1):
            assert create(link, f"s{i}", 16) == "made"
        assert create(link, "last", 16) == "made"
        assert create(link, "more", 16) == "too_large"
        link.call("session.delete", {"session": "last"})
        assert create(link, "more", 16) == "made"


def test_as_many_connections_as_hello_tells(daemon) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < CONNECTIONS + 200:
        pytest.skip("this machine allows too few descriptors")
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    try:
        with contextlib.ExitStack() as stack, daemon.link() as link:
            assert link.hello["limits"]["connections"] == CONNECTIONS

            def knock() -> socket.socket:
                connection = stack.enter_context(socket.socket(socket.AF_UNIX))
                connection.connect(str(daemon.socket))  # waits while others are being let in
                connection.settimeout(20)
                return connection

            for _ in range(CONNECTIONS - 2):
                last = knock()
            link.call("ping")
            with daemon.link() as another:  # the last one there is room for
                another.call("ping")
                refused = json.loads(knock().recv(65536))["error"]
                assert refused["data"]["name"] == "busy" and str(CONNECTIONS) in refused["message"]
                another.call("ping")
            last.close()
            link.call("ping")
            daemon.link().close()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def answers(link: Link, method: str, params: dict) -> list[bool]:
    """Whether requests are taken, one for each value in the list that a parameter has."""
    [(key, values)] = [item for item in params.items() if isinstance(item[1], list)]
    taken = []
    for value in values:
        try:
            link.call(method, {**params, key: value})
            taken.append(True)
        except SkindError as refusal:
            assert refusal.name in ("bad_params", "too_large")
            taken.append(False)
    return taken


def test_numbers_below_at_and_above_what_hello_tells(daemon) -> None:
    with daemon.link(checked=False) as link:
        assert create(link, "sheet", 64) == "made"
        who = {"session": "sheet", "pose": "rest", "vertices": np.arange(3, dtype=np.uint32),
               "positions": np.zeros((3, 3), np.float32)}
        most = link.hello["limits"]["history_bytes"]
        for method, params, expected in [
                ("session.set", {"session": "sheet",
                                 "history_bytes": [MIB - 1, MIB, MIB + 1]}, "nyy"),
                ("session.set", {"session": "sheet",
                                 "history_bytes": [most - 1, most, most + 1]}, "yyn"),
                ("stroke.apply", {**who, "stiffness": [9.999, 10, 10.001]}, "yyn"),
                ("stroke.apply", {**who, "smooth": [9.999, 10, 10.001]}, "yyn"),
                ("stroke.apply", {**who, "guard": [999.9, 1000, 1000.1]}, "yyn"),
                ("pins.weigh", {"session": "sheet", "pose": "rest",
                                "weight": [999.9, 1000, 1000.1]}, "yyn")]:
            taken = answers(link, method, params)
            assert "".join("y" if yes else "n" for yes in taken) == expected, (method, params)


def test_as_many_poses_as_hello_tells(daemon) -> None:
    with daemon.link(checked=False) as link:
        assert create(link, "sheet", 16) == "made"
        most = link.hello["limits"]["poses"]
        pose = {"session": "sheet", "bend": 10.0}
        for number in range(most - len(link.call("session.info", {"session": "sheet"})["poses"])):
            link.call("pose.set", {**pose, "pose": f"pose {number}"})
        with pytest.raises(SkindError) as refusal:
            link.call("pose.set", {**pose, "pose": "one more"})
        assert refusal.value.name == "too_large" and str(most) in refusal.value.message
        link.call("pose.set", {**pose, "pose": "pose 0"})  # instead of the one that it was
        assert len(link.call("session.info", {"session": "sheet"})["poses"]) == most


def test_as_many_guard_poses_as_hello_tells(daemon) -> None:
    with daemon.link(checked=False) as link:
        assert create(link, "sheet", 16) == "made"
        most = link.hello["limits"]["guard_poses"]
        for number in range(4):
            link.call("pose.set", {"session": "sheet", "pose": f"p{number}", "bend": 10.0 + number})
        guard = {"session": "sheet", "poses": [f"p{number}" for number in range(4)]}
        for count, name in ((most - 1, ""), (most, ""), (most + 1, "bad_params")):
            try:
                link.call("guard.set", {**guard, "count": count})
                assert name == ""
            except SkindError as refusal:
                assert refusal.name == name


# ---- messages that are coming in ---------------------------------------------------------------

def begin_frame(link: Link, bytes_: int) -> None:
    """Sends the header of a frame that has so many bytes, and no more of it."""
    link.socket.settimeout(20)
    link.socket.sendall(struct.pack("<4sIQ", b"SKD1", 8, bytes_ - 24))


class LargeRequest:
    """A request of more than 1 MiB, sent by a thread: the daemon may not take it yet."""

    def __init__(self, daemon: Daemon) -> None:
        self.link = daemon.link(checked=False)
        self.link.socket.settimeout(20)
        self.id, pieces = self.link.exchange.request("weights.get", {
            "session": "sheet", "vertices": np.zeros(MIB // 4 + 1, np.uint32)})
        self.thread = threading.Thread(target=self.link.socket.sendall,
                                       args=(b"".join(pieces),))
        self.thread.start()

    def is_taken(self, seconds: float) -> bool:
        self.thread.join(seconds)
        return not self.thread.is_alive()

    def close(self) -> None:
        self.thread.join(20)
        assert len(self.link.wait(self.id)["weights"]) == MIB // 4 + 1
        self.link.close()


def test_large_messages_share_their_room(daemon) -> None:
    with daemon.link() as first, daemon.link() as second, daemon.link() as other:
        begin_frame(first, 512 * MIB)
        begin_frame(second, 512 * MIB)
        assert create(other, "sheet", 10_000) == "made"  # small ones need no room
        large = LargeRequest(daemon)
        assert not large.is_taken(0.3)
        second.close()
        assert large.is_taken(20)
        large.close()


def test_who_begins_a_large_message_and_stops_makes_room_for_others(start) -> None:
    daemon = start("--stall-timeout", "1")
    with daemon.link() as first, daemon.link() as second, daemon.link() as other:
        assert create(other, "sheet", 16) == "made"
        begin_frame(first, 512 * MIB)
        begin_frame(second, 512 * MIB)
        time.sleep(1.5)
        assert other.call("stats")["connections"] == 3  # as long as nobody waits for the room
        large = LargeRequest(daemon)
        assert large.is_taken(20)
        large.close()
        assert other.call("stats")["connections"] == 2
