"""Channel and Launcher: against the real daemon and the real skinctl, and against peers that do
not behave: a few bytes by hand. Pauses are tested on a clock of our own; nothing here sleeps long.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from core import Channel, Exchange, Launcher, Link, SkindError
from core.stream import PORTION_BYTES, Stream
from daemons import BIN

sys.path.append(str(Path(__file__).resolve().parents[1] / "integration"))
import rigs  # noqa: E402

SECONDS = 20.0  # patience with a daemon under a sanitizer on a busy machine


class Clock:
    """Seconds that pass when told, and `tick` more each time somebody looks."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.tick = 0.0

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


class Seen:
    """A channel's callbacks, as a list of what happened."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.events: list[tuple] = []
        channel.on_ready = lambda: self.events.append(("ready", channel.generation))
        channel.on_lost = lambda reason: self.events.append(("lost", reason))
        channel.on_notification = lambda message: self.events.append((message.method,))

    def done(self, label: str):
        def record(result, error):
            self.events.append((label, error.name if error else result))
        return record

    @property
    def names(self) -> list[str]:
        return [event[0] for event in self.events]

    def __getitem__(self, label: str):
        return next(event[1] for event in self.events if event[0] == label)


def pump_until(channel: Channel, condition) -> None:
    deadline = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < deadline, (channel.state, channel.problem)
        channel.pump()
        time.sleep(0.0005)


def call(channel: Channel, method: str, params: dict | None = None) -> dict:
    """One request, pumped until it is answered."""
    answers = []
    channel.request(method, params, lambda *answer: answers.append(answer))
    pump_until(channel, lambda: answers)
    result, error = answers[0]
    if error is not None:
        raise error
    return result


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def make(folder):
    """make(...) makes a channel to the folder's socket; all are closed in the end."""
    channels: list[Channel] = []

    def run(path=None, **options) -> Channel:
        channels.append(Channel(str(path or folder / "skind.sock"), name="tests", **options))
        return channels[-1]

    yield run
    for channel in channels:
        channel.close()


@pytest.fixture
def ready(daemon, make):
    """A channel that is ready, and what it called."""
    channel = make(version="7")
    seen = Seen(channel)
    channel.open()
    pump_until(channel, lambda: channel.state == "ready")
    return channel, seen


class Peer:
    """A socket that somebody listens at, and the bytes that this test lets it say."""

    def __init__(self, path: Path, backlog: int = 5) -> None:
        self.listening = socket.socket(socket.AF_UNIX)
        self.listening.bind(str(path))
        self.listening.listen(backlog)
        self.listening.settimeout(SECONDS)
        self.connection: socket.socket | None = None

    def accept(self) -> dict:
        """Takes the next connection; returns the hello that it brings."""
        if self.connection is not None:
            self.connection.close()
        self.connection = self.listening.accept()[0]
        self.connection.settimeout(SECONDS)
        return self.read()

    def read(self) -> dict:
        magic, json_bytes, tail_bytes = struct.unpack("<4sIQ", self.take(16))
        assert magic == b"SKD1"
        body = self.take(json_bytes + -json_bytes % 8 + tail_bytes)
        return json.loads(body[:json_bytes])

    def take(self, count: int) -> bytes:
        data = self.connection.recv(count, socket.MSG_WAITALL)
        assert len(data) == count
        return data

    def say(self, message: dict, tail: bytes = b"") -> None:
        text = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self.connection.sendall(struct.pack("<4sIQ", b"SKD1", len(text), len(tail)) + text
                                + bytes(-len(text) % 8) + tail)

    def greet(self, channel: Channel) -> None:
        """Until the channel is ready."""
        pump_until(channel, lambda: channel.state == "greeting")
        self.say({"id": self.accept()["id"], "result": {"protocol": 1, "capabilities": []}})
        pump_until(channel, lambda: channel.state == "ready")

    def close(self) -> None:
        self.listening.close()
        if self.connection is not None:
            self.connection.close()


@pytest.fixture
def peer(folder):
    peer = Peer(folder / "skind.sock")
    yield peer
    peer.close()


# ---- with the daemon ----


def test_connects_and_says_hello(daemon, make):
    channel = make(version="7")
    seen = Seen(channel)
    assert (channel.state, channel.problem, channel.hello) == ("closed", "", {})
    with pytest.raises(ConnectionError, match="open one"):
        channel.request("ping")
    channel.open()
    assert channel.state == "connecting"
    with pytest.raises(ConnectionError, match="connecting"):
        channel.request("ping")
    pump_until(channel, lambda: channel.state == "ready")
    assert seen.events == [("ready", 1)] and channel.problem == "" and channel.unanswered == 0
    assert channel.hello["server"]["pid"] == daemon.process.pid
    assert channel.capabilities >= {"stroke.stream", "history"}
    assert call(channel, "ping") == {}


def test_updates_of_others_and_our_own_name(ready, daemon):
    channel, seen = ready
    with daemon.link() as other:
        other.call("session.create", {"name": "s", **rigs.sheet(100)})
        other.call("pose.set", {"session": "s", "pose": "p", "bend": 20})
        call(channel, "session.attach", {"session": "s"})
        stroke(other.call, "p", range(5))
        pump_until(channel, lambda: "session.update" in seen.names)
        other.call("session.attach", {"session": "s"})
        stroke(lambda *request: call(channel, *request), "p", range(5))
        deadline = time.monotonic() + SECONDS
        while "session.update" != other.notifications[-1].method and time.monotonic() < deadline:
            other.pump(0.001)
        assert other.notifications[-1].params["client"] == "tests"


def stroke(ask, pose: str, vertices) -> dict:
    vertices = np.array(vertices, np.uint32)
    posed = ask("pose.evaluate", {"session": "s", "pose": pose, "vertices": vertices})
    return ask("stroke.apply", {"session": "s", "pose": pose, "vertices": vertices,
                                "positions": posed["positions"] + np.float32(0.01)})


def test_arrays_both_ways_and_the_order_of_callbacks(ready):
    channel, seen = ready
    rig = rigs.sheet(400)
    call(channel, "session.create", {"name": "s", **rig})
    assert np.array_equal(call(channel, "mesh.get", {"session": "s"})["positions"],
                          rig["positions"])
    channel.request("pose.set", {"session": "s", "pose": "p", "matrices": rigs.bent(0.2)},
                    seen.done("pose"))
    channel.request("weights.get", {"session": "nobody"}, seen.done("refused"))
    channel.request("ping")  # nobody wants to know
    channel.request("weights.get", {"session": "s"}, seen.done("weights"))
    assert channel.unanswered == 4 and channel.unsent_bytes > 0
    pump_until(channel, lambda: not channel.unanswered)
    channel.pump()
    assert channel.unsent_bytes == 0 and seen["refused"] == "no_session"
    weights = seen["weights"]["weights"]
    assert weights.shape == (400, 4) and np.allclose(weights.sum(1), 1)
    stroke(lambda *request: call(channel, *request), "p", range(40))
    assert "stroke.weights" in seen.names
    applied = []
    channel.on_notification = lambda message: applied.append(message.params["request"])
    request = channel.request("history.undo", {"session": "s"},
                              lambda result, error: applied.append("answer"))
    assert request > 4
    pump_until(channel, lambda: applied)
    assert applied[-1] == "answer"


def test_callbacks_may_ask_cancel_and_raise(ready):
    channel, seen = ready
    raised = []

    def again(result, error):
        channel.pump()  # does nothing
        second = channel.request("ping", None, seen.done("second"))
        channel.cancel(second)
        channel.cancel(12345)
        raise RuntimeError("first")

    def fail(result, error):
        raise RuntimeError("last")

    channel.on_error = raised.append
    channel.request("ping", None, again)
    channel.request("stats", None, seen.done("stats"))
    pump_until(channel, lambda: "second" in seen.names)
    assert [str(error) for error in raised] == ["first"] and "stats" in seen.names
    channel.on_error = None
    channel.request("ping", None, fail)
    channel.request("ping", None, seen.done("after"))
    with pytest.raises(RuntimeError, match="last"):
        pump_until(channel, lambda: False)
    pump_until(channel, lambda: "after" in seen.names)
    assert channel.state == "ready"
    channel.on_error = fail
    channel.request("ping", None, lambda result, error: 1 / 0)
    with pytest.raises(TypeError):  # of the on_error that fails itself
        pump_until(channel, lambda: False)


def test_what_does_not_travel_is_told_at_once(ready):
    channel, _ = ready
    with pytest.raises(TypeError):
        channel.request("ping", {"x": np.zeros(3, np.int64)})
    with pytest.raises(ValueError):
        channel.request("ping", {"x": float("nan")})
    assert channel.unanswered == 0 and call(channel, "ping") == {}


def test_a_big_stroke_within_the_budget(ready, clock, monkeypatch):
    """Each pump moves as many portions as its budget has ticks of the clock, and no more."""
    channel, seen = ready
    portions: list[int] = []
    send, receive = Stream.send, Stream.receive

    def count(move):
        def counted(stream):
            moved = move(stream)
            if moved:
                portions.append(moved)
            return moved
        return counted

    rig = rigs.sheet(200_000)
    total = len(rig["positions"])
    call(channel, "session.create", {"name": "s", **rig})
    call(channel, "pose.set", {"session": "s", "pose": "p", "matrices": rigs.bent(0.05)})
    posed = call(channel, "pose.evaluate", {"session": "s", "pose": "p"})["positions"]
    targets = posed + np.float32(0.001)
    monkeypatch.setattr(Stream, "send", count(send))
    monkeypatch.setattr(Stream, "receive", count(receive))
    monkeypatch.setattr(channel, "_clock", clock)
    clock.tick = 0.001
    streamed = np.zeros(total, bool)
    channel.on_notification = lambda message: streamed.__setitem__(message.params["vertices"], True)
    channel.request("stroke.apply", {"session": "s", "pose": "p", "positions": targets,
                                     "vertices": np.arange(total, dtype=np.uint32)},
                    seen.done("stroke"))
    assert channel.unsent_bytes > 16 * total
    most = pumps = 0
    deadline = time.monotonic() + SECONDS
    while "stroke" not in seen.names and time.monotonic() < deadline:
        portions.clear()
        channel.pump(0.004)
        pumps += bool(portions)
        most = max(most, len(portions))
        assert all(portion <= PORTION_BYTES for portion in portions)
        time.sleep(0 if portions else 0.002)
    assert seen["stroke"]["vertices"] == total and streamed.all()
    assert most <= 8, "four ticks, each one portion out and one in"
    assert pumps > 10


def test_killed_with_requests_pending_and_started_again(ready, daemon, start):
    channel, seen = ready
    daemon.process.send_signal(signal.SIGSTOP)
    for label in ("a", "b", "c"):
        old = channel.request("ping", None, seen.done(label))
    channel.pump()
    assert daemon.stop(signal.SIGKILL) == -signal.SIGKILL
    pump_until(channel, lambda: "lost" in seen.names)
    assert seen.events[1:4] == [("a", "lost"), ("b", "lost"), ("c", "lost")]
    assert seen.names[4:] == ["lost"] and seen["lost"] == "skind ended"
    pump_until(channel, lambda: "does not run" in channel.problem)
    assert channel.unanswered == channel.unsent_bytes == 0
    with pytest.raises(ConnectionError, match="skinctl start"):
        channel.request("ping")
    again = start()
    pump_until(channel, lambda: channel.state == "ready")
    assert seen.events[5:] == [("ready", 2)] and channel.problem == ""
    assert channel.hello["server"]["pid"] == again.process.pid
    new = channel.request("ping", None, seen.done("new"))
    channel.cancel(old)  # an old id must not mean a new request
    pump_until(channel, lambda: not channel.unanswered)
    channel.pump()
    assert new > old and seen["new"] == {}


def test_lost_is_retryable_and_bye_is_the_reason(ready, daemon):
    channel, seen = ready
    errors = []

    def lost(result, error):
        errors.append(error)
        with pytest.raises(ConnectionError):
            channel.request("ping")

    channel.request("shutdown", None, seen.done("shutdown"))
    pump_until(channel, lambda: "shutdown" in seen.names)
    if channel.state == "ready":  # else the bye came with the answer
        channel.request("ping", None, lost)
    pump_until(channel, lambda: "lost" in seen.names)
    assert seen["shutdown"] == {} and seen["lost"] == "skind is stopping"
    assert "bye" not in seen.names
    for error in errors:
        assert isinstance(error, SkindError) and error.retryable and error.name == "lost"


def test_close_is_silent(ready, daemon):
    channel, seen = ready
    daemon.process.send_signal(signal.SIGSTOP)
    channel.request("ping", None, seen.done("never"))
    channel.pump()
    channel.close()
    daemon.process.send_signal(signal.SIGCONT)
    for _ in range(5):
        channel.pump()
    assert seen.names == ["ready"]
    assert (channel.state, channel.problem, channel.unanswered) == ("closed", "", 0)
    channel.open()
    pump_until(channel, lambda: channel.state == "ready")
    channel.request("ping", None, lambda result, error: channel.close())
    channel.request("ping", None, seen.done("never"))
    pump_until(channel, lambda: channel.state == "closed")
    assert seen.names == ["ready", "ready"]


# ---- with skinctl ----


@pytest.fixture
def launcher(folder):
    launcher = Launcher(str(folder / "skind.sock"), ["", folder, BIN], idle_exit_s=60)
    yield launcher
    launcher.close()
    try:
        with Link.connect(folder / "skind.sock") as link:
            os.kill(link.hello["server"]["pid"], signal.SIGTERM)
    except OSError:
        pass


def note_children(monkeypatch) -> list[int]:
    """The list of the processes that are started from now on."""
    children: list[int] = []

    class Noted(subprocess.Popen):
        def __init__(self, *arguments, **options) -> None:
            super().__init__(*arguments, **options)
            children.append(self.pid)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    return children


def is_left(child: int) -> bool:
    """Whether a child of ours still runs, or has ended and was not taken away."""
    return Path(f"/proc/{child}").exists()


def test_the_launcher_starts_the_daemon_once(make, launcher, monkeypatch):
    children = note_children(monkeypatch)
    channel, other = make(launcher=launcher), make(launcher=Launcher(launcher.path, [BIN]))
    states = []
    channel.open()
    other.open()
    deadline = time.monotonic() + SECONDS
    while {channel.state, other.state} != {"ready"} and time.monotonic() < deadline:
        channel.pump()
        other.pump()
        states.append(channel.state)
        time.sleep(0.0005)
    assert channel.state == other.state == "ready", (channel.problem, other.problem)
    assert "starting" in states and launcher.poll() == "done" and launcher.problem == ""
    assert channel.hello["server"]["pid"] == other.hello["server"]["pid"]
    assert launcher.started != other.launcher.started, "one of them made it"
    late = Launcher(launcher.path, [BIN / "skinctl"])
    late.start()
    deadline = time.monotonic() + SECONDS
    while late.poll() == "running" and time.monotonic() < deadline:
        time.sleep(0.002)
    assert late.poll() == "done" and not late.started
    # The second may have found it running already.
    assert len(children) in (2, 3) and not any(map(is_left, children)), "zombies"
    assert call(channel, "stats")["connections"] == 2


def test_killed_and_started_by_the_channel(make, launcher):
    channel = make(launcher=launcher)
    seen = Seen(channel)
    channel.open()
    pump_until(channel, lambda: channel.state == "ready")
    os.kill(channel.hello["server"]["pid"], signal.SIGKILL)
    pump_until(channel, lambda: channel.generation == 2 and not channel.problem)
    channel.pump()
    assert seen.names == ["ready", "lost", "ready"]


def test_closed_while_starting(make, launcher, monkeypatch):
    channel = make(launcher=launcher)
    children = note_children(monkeypatch)
    channel.open()
    channel.pump(0)
    assert channel.state == "starting" and channel.problem == "skind is being started"
    channel.close()
    assert len(children) == 1 and not is_left(children[0])
    assert launcher.poll() == "idle" and channel.state == "closed"


def script(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def finish(launcher: Launcher) -> str:
    launcher.start()
    launcher.start()  # one at a time
    deadline = time.monotonic() + SECONDS
    while launcher.poll() == "running" and time.monotonic() < deadline:
        time.sleep(0.001)
    return launcher.poll()


def test_where_skinctl_is_looked_for(folder, monkeypatch):
    monkeypatch.setenv("PATH", str(folder / "bin"))
    nothing = Launcher("/s", ["", folder / "nowhere"])
    assert nothing.find() is None and nothing.poll() == "idle"
    assert finish(nothing) == "failed"
    assert "skinctl was not found" in nothing.problem and "nowhere, PATH" in nothing.problem
    (folder / "bin").mkdir()
    last = script(folder / "bin" / "skinctl", "exit 0")
    assert nothing.find() == last
    first = script(folder / "skinctl", "exit 0")
    assert Launcher("/s", [folder, folder / "bin"]).find() == first
    assert Launcher("/s", [str(first)]).find() == first
    first.chmod(0o644)
    assert Launcher("/s", [folder]).find() == last, "what may not be run is passed over"
    last.unlink()
    forbidden = Launcher("/s", [folder])
    assert finish(forbidden) == "failed" and "chmod +x" in forbidden.problem


def test_why_skinctl_failed(folder, monkeypatch, clock):
    program = script(folder / "skinctl",
                     "echo; echo a >&2; echo skinctl: no room at all >&2; exit 1")
    launcher = Launcher("/s", [program], clock=clock)
    assert finish(launcher) == "failed" and launcher.problem == "no room at all"
    script(program, "exit 3")
    assert finish(launcher) == "failed" and "status 3" in launcher.problem
    script(program, f'echo "$@" > {folder}/said; echo \'{{"started": true}}\'')
    assert finish(launcher) == "done" and launcher.started and launcher.problem == ""
    assert (folder / "said").read_text() == "start --json --socket=/s --idle-exit=1800\n"
    script(program, "echo nonsense")
    assert finish(launcher) == "done" and not launcher.started
    program.write_text("#!/nowhere/at/all\n")
    assert finish(launcher) == "failed" and "cannot be run" in launcher.problem
    script(program, "exec sleep 60")
    launcher.start()
    assert launcher.poll() == "running"
    clock.now += 31
    assert finish(launcher) == "failed" and "within 30 s" in launcher.problem
    monkeypatch.setenv("SKIND_BIN", "/nowhere/skind")
    real = Launcher(str(folder / "s"), [BIN])
    assert finish(real) == "failed" and real.problem.startswith("cannot run /nowhere/skind")


def test_a_launch_that_fails_is_tried_each_two_seconds(make, folder, clock):
    program = script(folder / "skinctl", f"echo x >> {folder}/tries; echo no luck >&2; exit 1")
    channel = make(launcher=Launcher("/s", [program]), clock=clock)
    channel.open()
    for tries in (1, 2, 3):
        pump_until(channel, lambda: channel.state == "waiting")
        assert channel.problem == "no luck"
        assert (folder / "tries").read_text() == "x\n" * tries
        clock.now += 1.9
        channel.pump()
        assert channel.state == "waiting"
        clock.now += 0.2
        channel.pump(0)  # one step: it may have failed again by the next
        assert channel.state == "starting" and channel.problem == "no luck"
    script(program, "exit 0")  # says that it runs, which is not so
    pump_until(channel, lambda: channel.state == "waiting")
    clock.now += 2.1
    channel.pump()
    pump_until(channel, lambda: channel.state == "waiting")
    assert "ended right after its start" in channel.problem


# ---- with peers that do not behave ----


def test_pauses_between_tries(make, folder, clock):
    channel = make(clock=clock)
    channel.open()
    channel.pump()
    assert channel.state == "waiting" and "skinctl start" in channel.problem
    for pause in (0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0):
        tried = []
        clock.now += pause - 0.01
        channel._connect, kept = lambda: tried.append(1), channel._connect
        channel.pump(0)
        assert not tried
        channel._connect = kept
        clock.now += 0.011
        channel.pump()
        assert channel.state == "waiting"
    channel.open()  # somebody pressed a button: at once
    assert channel.state == "connecting"
    peer = Peer(folder / "skind.sock")
    channel.pump()
    assert channel.state == "greeting"
    peer.close()


def test_at_once_after_a_loss_but_not_for_ever(make, peer, clock):
    channel = make(clock=clock)
    seen = Seen(channel)
    channel.open()
    peer.greet(channel)
    peer.connection.close()
    channel.pump()
    assert channel.state == "greeting", "no time passed"
    peer.greet(channel)
    assert seen.names == ["ready", "lost", "ready"]
    peer.connection.close()
    channel.pump()
    assert channel.state == "waiting" and channel.problem.startswith("the connection to skind was")
    clock.now += 0.11
    peer.greet(channel)
    clock.now += 60
    peer.connection.close()
    channel.pump()
    assert channel.state == "greeting"


def test_a_version_mismatch_ends_the_tries(make, peer, clock):
    channel = make(clock=clock)
    seen = Seen(channel)
    channel.open()
    channel.pump()
    hello = peer.accept()
    client = hello["params"]["client"]
    assert hello["params"]["protocol"] == {"min": 1, "max": 1}
    assert (client["name"], client["version"]) == ("tests", "")
    assert len(client["id"]) == 16 and client["user"]
    peer.say({"id": hello["id"], "error": {
        "code": -32001, "message": "this skind speaks protocol 2 to 3 and the client 1 to 1; "
        "update the client", "data": {"name": "version", "retryable": False, "hint": ""}}})
    pump_until(channel, lambda: channel.state == "closed")
    assert channel.problem.endswith("update the client (the client is tests)")
    clock.now += 100
    channel.pump()
    assert channel.state == "closed" and seen.events == []
    channel.open()
    peer.greet(channel)
    channel.pump()
    assert seen.names == ["ready"]


@pytest.mark.parametrize("answer", [
    b"HTTP/1.1 400 Bad Request\r\n\r\n", b"{}\n", b"SKD1\xff\xff\xff\xff" + bytes(8),
    b'{"jsonrpc":"2.0","id":1,"result":{}}\n',
    b'{"jsonrpc":"2.0","id":1,"result":{"protocol":9,"capabilities":[]}}\n',
    b'{"jsonrpc":"2.0","id":77,"result":{}}\n', b"",
    b'{"jsonrpc":"2.0","id":null,"error":{"code":-32004,"message":"64 connections are open"}}\n',
])
def test_a_peer_that_is_not_skind(make, peer, clock, answer):
    channel = make(clock=clock)
    seen = Seen(channel)
    channel.open()
    channel.pump()
    peer.accept()
    peer.connection.sendall(answer)
    peer.connection.close()
    pump_until(channel, lambda: channel.state == "waiting")
    assert channel.problem.startswith("the greeting failed (") and "SKIND_SOCKET" in channel.problem
    assert ("64 connections" in channel.problem) == (b"64" in answer)
    clock.now += 0.3
    channel.pump()
    assert channel.state == "greeting" and seen.events == []


@pytest.mark.parametrize("rubbish", [
    b"garbage", b'SKD1\x02\0\0\0' + bytes(8) + b"{}" + bytes(6),
    b"SKD1" + struct.pack("<IQ", 8, 600 << 20),
])
def test_rubbish_in_the_middle(make, peer, rubbish):
    channel = make()
    seen = Seen(channel)
    channel.open()
    peer.greet(channel)
    channel.request("ping", None, seen.done("ping"))
    channel.pump()
    peer.read()
    peer.connection.sendall(rubbish)
    pump_until(channel, lambda: "lost" in seen.names)
    assert seen.events[1] == ("ping", "lost") and "not understood" in seen["lost"]
    peer.greet(channel)
    assert channel.generation == 2


def test_a_silent_peer_is_told(make, peer, clock):
    channel = make(clock=clock)
    channel.open()
    channel.pump()
    clock.now += 4.9
    channel.pump()
    assert "being greeted" in channel.problem
    clock.now += 1.1
    channel.pump()
    assert channel.problem.startswith("connected, but skind does not answer (6 s)")
    assert channel.state == "greeting"
    peer.greet(channel)
    clock.now += 3600
    assert channel.silence_s == 0 and channel.problem == "", "nothing was asked"
    channel.request("ping")
    channel.pump()
    assert channel.silence_s == 0
    clock.now += 12
    assert channel.silence_s == pytest.approx(12)
    assert "not answered for 12 s" in channel.problem and "normal" in channel.problem
    peer.connection.sendall(b"SKD1")
    pump_until(channel, lambda: channel.silence_s == 0)
    assert channel.problem == "" and channel.state == "ready"


def test_many_messages_at_once_and_a_small_budget(make, peer, clock):
    """One message a pump when the time is short, none lost, none out of order."""
    channel = make(clock=clock)
    seen = Seen(channel)
    channel.open()
    peer.greet(channel)
    channel.pump()
    id = channel.request("ping", None, seen.done("ping"))
    for number in range(20):
        peer.say({"method": f"n{number}", "params": {}})
    peer.say({"id": id, "result": {}})
    peer.connection.close()
    clock.tick = 0.001
    counts = []
    while "lost" not in seen.names:
        before = len(seen.events)
        channel.pump(0)
        counts.append(len(seen.events) - before)
        assert len(counts) < 1000
    assert max(counts) == 1
    assert seen.names == ["ready", *(f"n{number}" for number in range(20)), "ping", "lost"]
    assert seen["ping"] == {}


@pytest.fixture
def broken_pipes():
    """The SIGPIPEs that came; Python by itself ignores them, a program around it may not."""
    came: list[int] = []
    before = signal.signal(signal.SIGPIPE, lambda number, frame: came.append(number))
    yield came
    signal.signal(signal.SIGPIPE, before)


def test_a_peer_that_does_not_read(make, peer, broken_pipes):
    channel = make()
    seen = Seen(channel)
    channel.open()
    peer.greet(channel)
    sent = np.arange(3 << 20, dtype=np.uint8)
    channel.request("any", {"x": sent}, seen.done("any"))
    for _ in range(10):
        channel.pump()
    left = channel.unsent_bytes
    assert 0 < left < sent.nbytes + 200 and channel.state == "ready"
    peer.connection.close()
    pump_until(channel, lambda: "lost" in seen.names)
    assert channel.unsent_bytes == 0 or channel.state == "greeting"
    assert broken_pipes == [], "a signal that would end the program"


def test_no_system_call_is_asked_for_more_than_a_portion():
    """Whatever the sizes of the system's own buffers are."""
    asked: list[int] = []

    class Recorded(socket.socket):
        def sendmsg(self, pieces, *more):
            asked.append(sum(map(len, pieces)))
            return super().sendmsg(pieces, *more)

        def recv_into(self, buffer, *more):
            asked.append(len(buffer))
            return super().recv_into(buffer, *more)

    ours, theirs = socket.socketpair()
    stream = Stream(Recorded(fileno=ours.detach()), Exchange())
    with theirs:
        stream.push([np.zeros(100_000, np.uint8).data] * 8)
        sent = stream.send()
        assert 0 < sent <= asked.pop() == PORTION_BYTES
        assert stream.unsent_bytes == 800_000 - sent
        theirs.sendall(b"SKD1" + struct.pack("<IQ", 8, 400 << 20))
        assert stream.receive() == 16
        assert stream.receive() == 0 and asked[-1] == PORTION_BYTES
        stream.close()
        assert stream.unsent_bytes == 0


def test_paths_that_cannot_be(make, folder, monkeypatch):
    long = make(folder / ("x" * 120))
    long.open()
    long.pump()
    assert long.state == "closed" and "only 107" in long.problem
    (folder / "file").write_text("")
    under = make(folder / "file" / "s")
    under.open()
    under.pump()
    assert under.state == "waiting" and "Not a directory" in under.problem

    def forbid(self, address):
        raise PermissionError(13, "Permission denied")

    class Forbidden(socket.socket):  # root may do everything, so the system cannot be asked to
        connect = forbid

    monkeypatch.setattr("core.dial.socket.socket", Forbidden)
    channel = make()
    channel.open()
    channel.pump()
    assert channel.state == "waiting" and "forbids" in channel.problem


def test_a_full_backlog(make, folder, clock):
    peer = Peer(folder / "skind.sock", backlog=0)
    first, second = make(clock=clock), make(clock=clock)
    first.open()
    first.pump()
    second.open()
    second.pump()
    assert first.state == "greeting" and second.state == "waiting"
    assert "too many programs" in second.problem
    peer.accept()
    clock.now += 0.2
    second.pump()
    assert second.state == "greeting"
    peer.close()
