"""A client that stops reading costs little, is told why it was dropped, and nobody waits for it."""

from __future__ import annotations

import json
import re
import signal
import socket
import struct
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
from core import Link
from core.exchange import Exchange
from daemons import BIN, Daemon

HELLO = {"protocol": {"min": 1, "max": 1}}
WHO = {"session": "sheet"}
VERTICES = 40_000
MOST_KIB = 4096  # that a client which does not read may cost
STALL_SECONDS = 1
RANDOM = np.random.default_rng(5)


def memory_kib(daemon: Daemon) -> int:
    status = Path(f"/proc/{daemon.process.pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", status)[1])


def check_memory(daemon: Daemon, before: int, more: int) -> None:
    """Not under a sanitizer, which keeps what was freed."""
    sanitized = re.search(b"__[at]san_init", (BIN / "skind").read_bytes())
    assert sanitized or memory_kib(daemon) - before <= more


@pytest.fixture
def hasty(start) -> Daemon:
    """A daemon that gives up on clients soon, with a session whose answers fill a socket."""
    daemon = start("--stall-timeout", str(STALL_SECONDS))
    with daemon.link() as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(VERTICES),
                                     "durability": "off", "history_bytes": 1 << 20})
    return daemon


def reader(daemon: Daemon, lines: bool = False) -> Link:
    """A connection that reads when it is told to, with little room in its socket."""
    connection = socket.socket(socket.AF_UNIX)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.connect(str(daemon.socket))
    link = Link(connection, Exchange(lines=lines), 20)
    link.call("hello", HELLO)
    return link


def ask(link: Link, method: str, times: int) -> None:
    """Sends requests and reads nothing, where link.send would take in what is there."""
    link.socket.settimeout(20)
    for _ in range(times):
        _, pieces = link.exchange.request(method, WHO)
        link.socket.sendall(b"".join(pieces))


def change(link: Link, value: float) -> None:
    """Changes the weights of half of the vertices: an update of 480 KB."""
    count = VERTICES // 2
    weights = np.tile(np.array([value, 1 - value, 0, 0], np.float32), (count, 1))
    joints = np.tile(np.array([0, 1, 65535, 65535], np.uint16), (count, 1))
    link.call("weights.set", {**WHO, "vertices": np.arange(count, dtype=np.uint32),
                              "weights": weights, "joints": joints})


def read_all(connection: socket.socket) -> bytes:
    """To the end, which comes; a reset says that the daemon left requests unread."""
    connection.settimeout(20)
    data = bytearray()
    try:
        while chunk := connection.recv(1 << 20):
            data += chunk
    except ConnectionResetError:
        pass
    return bytes(data)


def last_messages(connection: socket.socket) -> list[dict]:
    """The JSON parts of all frames to the end."""
    data = read_all(connection)
    messages = []
    at = 0
    while at < len(data):
        magic, json_bytes, tail_bytes = struct.unpack_from("<4sIQ", data, at)
        assert magic == b"SKD1"
        messages.append(json.loads(data[at + 16:at + 16 + json_bytes]))
        at += (16 + json_bytes + 7) // 8 * 8 + tail_bytes
    assert at == len(data), "a piece of a message"
    return messages


def until_dropped(daemon: Daemon, seconds: float = 10) -> None:
    deadline = time.monotonic() + seconds
    while "reads nothing" not in daemon.log.read_text():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_subscriber_that_stops_reading_costs_little_and_is_dropped(hasty) -> None:
    with hasty.link() as other, reader(hasty) as stalled:
        before = 0  # until history and the changes for late ones are as full as they get
        while memory_kib(hasty) > before + 512:
            before = memory_kib(hasty)
            for _ in range(40):
                change(other, RANDOM.uniform(0.1, 0.9))
        before = memory_kib(hasty)
        stalled.call("session.attach", WHO)
        end = time.monotonic() + 0.8 * STALL_SECONDS
        while time.monotonic() < end:
            change(other, RANDOM.uniform(0.1, 0.9))
        check_memory(hasty, before, MOST_KIB)
        until_dropped(hasty)
        messages = last_messages(stalled.socket)
        assert messages[-1]["method"] == "bye"
        assert "read nothing" in messages[-1]["params"]["reason"]
        assert {message["method"] for message in messages[:-1]} <= {"session.update",
                                                                    "session.presence"}
        other.call("ping")
        assert other.call("session.info", WHO)["present"] == []


def test_one_that_asks_and_does_not_read_is_slowed_down_and_dropped(hasty) -> None:
    with hasty.link() as other, reader(hasty) as stalled:
        other.call("weights.get", WHO)
        before = memory_kib(hasty)
        ask(stalled, "weights.get", 64)
        time.sleep(0.5 * STALL_SECONDS)
        other.call("ping")
        answer_kib = VERTICES * 4 * 6 // 1024  # begun when there was room still
        check_memory(hasty, before, MOST_KIB + 2 * answer_kib)
        until_dropped(hasty)
        messages = last_messages(stalled.socket)
        assert messages[-1]["method"] == "bye"
        assert all("result" in message for message in messages[:-1])


def test_one_that_never_reads_again_is_closed(hasty) -> None:
    with hasty.link() as other, reader(hasty) as stalled:
        ask(stalled, "weights.get", 4)
        until_dropped(hasty)
        assert other.call("stats")["connections"] == 2
        time.sleep(1.5 * STALL_SECONDS)
        assert other.call("stats")["connections"] == 1


def test_one_that_reads_slowly_stays(hasty) -> None:
    with reader(hasty) as slow:
        ask(slow, "weights.get", 3)
        end = time.monotonic() + 3 * STALL_SECONDS
        data = bytearray()
        while time.monotonic() < end:
            data += slow.socket.recv(8192)
            time.sleep(0.1 * STALL_SECONDS)
        assert "reads nothing" not in hasty.log.read_text()
        while data.count(b'"revision":') < 3:
            data += slow.socket.recv(1 << 20)
        assert b'"bye"' not in data


def test_a_daemon_that_stood_still_drops_nobody(hasty) -> None:
    with hasty.link() as other, reader(hasty) as slow:
        ask(slow, "weights.get", 3)
        data = slow.socket.recv(1 << 20)
        hasty.process.send_signal(signal.SIGSTOP)
        time.sleep(2 * STALL_SECONDS)
        hasty.process.send_signal(signal.SIGCONT)
        other.call("ping")
        while data.count(b'"revision":') < 3:
            data += slow.socket.recv(1 << 20)
        assert b'"bye"' not in data and "reads nothing" not in hasty.log.read_text()


def test_an_idle_client_is_not_a_stalled_one(hasty) -> None:
    with reader(hasty) as idle:
        time.sleep(2 * STALL_SECONDS)
        idle.call("ping")


def test_lines_are_dropped_whole(hasty) -> None:
    with reader(hasty, lines=True) as stalled:
        ask(stalled, "session.info", 8)
        ask(stalled, "weights.get", 2)
        until_dropped(hasty)
        data = read_all(stalled.socket)
        messages = [json.loads(line) for line in data.splitlines()]
        assert data.endswith(b"\n") and messages[-1]["method"] == "bye"
