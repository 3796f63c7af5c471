"""Link and Exchange: the C library at the other end of a socket, and a few bytes made by hand."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys

import numpy as np
import pytest
import schemas
from core import Exchange, Link, SkindError, WireError, default_socket_path


def frame(message: dict, tail: bytes = b"") -> bytes:
    text = json.dumps({"jsonrpc": "2.0", **message}).encode()
    return struct.pack("<4sIQ", b"SKD1", len(text), len(tail)) + text + bytes(-len(text) % 8) + tail


@pytest.fixture(params=["frames", "lines"])
def echo(probe_path, request):
    """A Link to `wire_probe echo`, and the process."""
    ours, theirs = socket.socketpair()
    with subprocess.Popen([probe_path, "echo"], stdin=theirs, stdout=theirs) as process:
        theirs.close()
        with Link(ours, Exchange(lines=request.param == "lines"), 20) as link:
            yield link
        assert process.wait(10) == 0


@pytest.fixture
def pair():
    """A Link, and the bare socket at its other end."""
    ours, theirs = socket.socketpair()
    with Link(ours, Exchange(), 5) as link, theirs:
        yield link, theirs


def test_calls_and_answers_in_any_order(echo):
    assert echo.call("any", {"a": 1, "b": [1, {"c": None}]}) == {"a": 1, "b": [1, {"c": None}]}
    ids = [echo.send("any", {"n": n}, {"x": np.full(n, n, np.uint32)}) for n in range(40)]
    for n in reversed(range(40)):
        result = echo.wait(ids[n])
        assert result["n"] == n and list(result["x"]) == [n] * n
    assert echo.exchange.unanswered == 0
    with pytest.raises(KeyError):
        echo.wait(ids[0])


def test_both_sides_may_be_full(probe_path):
    """Two large requests at once: the other side stops reading until its answer is read."""
    ours, theirs = socket.socketpair()
    large = np.arange(4 << 20, dtype=np.uint32)
    with subprocess.Popen([probe_path, "echo"], stdin=theirs, stdout=theirs) as process:
        theirs.close()
        with Link(ours, Exchange(), 60) as link:
            ids = [link.send("any", {"x": large}) for _ in range(3)]
            for id in ids:
                assert np.array_equal(link.wait(id)["x"], large)
        assert process.wait(10) == 0


def test_connect_says_hello(probe_path, tmp_path):
    path = str(tmp_path / "s")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(path)
        listening.listen()
        command = [sys.executable, "-c",
                   "import os,socket,subprocess,sys;c=socket.socket(fileno=int(sys.argv[1]));"
                   "p=c.accept()[0];sys.exit(subprocess.call([sys.argv[2]],stdin=p,stdout=p))",
                   str(listening.fileno()), probe_path]
        with subprocess.Popen(command, pass_fds=[listening.fileno()]) as process:
            with Link.connect(path, name="tést", version="9", timeout=20) as link:
                assert link.hello == {"min": 1, "max": 1, "name": "tést", "version": "9"}
                with pytest.raises(SkindError) as refused:
                    link.call("session.info", {})
                assert refused.value.name == "bad_params" and refused.value.code == -32602
                assert "session is missing" in refused.value.message and refused.value.hint
                assert not refused.value.retryable
                assert link.call("ping") == {}
            assert process.wait(10) == 0
    with pytest.raises(OSError):
        Link.connect(str(tmp_path / "nobody"))


def test_notifications_gather_or_are_called(pair):
    link, other = pair
    weights = np.array([[1, 0, 0, 0]], np.float32)
    streamed = frame({"method": "stroke.weights",
                      "params": {"first": 0, "weights": {"buffer": 0}},
                      "buffers": [{"dtype": "f32", "shape": [1, 4], "offset": 0}]},
                     weights.tobytes())
    id = link.send("ping")
    other.sendall(streamed + frame({"method": "bye", "params": {"reason": "x"}})
                  + frame({"id": id, "result": {}}))
    assert link.wait(id) == {}
    assert [message.method for message in link.notifications] == ["stroke.weights", "bye"]
    assert np.array_equal(link.notifications[0].params["weights"], weights)
    link.notifications.clear()
    seen = []
    link.exchange.on_notification = seen.append
    other.sendall(streamed)
    link.pump()
    assert len(seen) == 1 and not link.notifications


def test_cancel_goes_out_as_a_notification(pair):
    link, other = pair
    id = link.send("stroke.apply", {"session": "a"})
    link.cancel(id)
    sent = other.recv(1 << 16)
    assert b'"method":"cancel","params":{"id":1}' in sent
    other.sendall(frame({"id": id, "error": {"code": -32005, "message": "was cancelled",
                                             "data": {"name": "cancelled", "retryable": True,
                                                      "hint": "nothing was changed"}}}))
    with pytest.raises(SkindError) as refused:
        link.wait(id)
    assert refused.value.name == "cancelled" and refused.value.retryable


def test_silence_and_endings(pair):
    link, other = pair
    id = link.send("ping")
    with pytest.raises(TimeoutError):
        link.wait(id, timeout=0.05)
    other.sendall(frame({"id": id, "result": {}}))
    assert link.wait(id) == {}  # a late answer is still the answer
    other.sendall(frame({"id": None, "error": {"code": -32000, "message": "no frame", "data":
                         {"name": "bad_frame", "retryable": False, "hint": ""}}}))
    other.close()
    with pytest.raises(SkindError) as refused:
        link.call("ping")
    assert refused.value.name == "bad_frame"
    with pytest.raises(ConnectionError):
        link.wait(link.send("ping"))


def test_answers_that_nobody_asked_for(pair):
    link, other = pair
    other.sendall(frame({"id": 99, "result": {}}))
    with pytest.raises(WireError):
        link.call("ping")


def test_watching_holds_messages_against_the_schemas():
    ours, theirs = socket.socketpair()
    schemas.seen.clear()
    with Link(ours, Exchange(watch=schemas.watch()), 5) as link, theirs:
        id = link.send("stroke.apply", {"session": "a", "pose": "p",
                                        "vertices": np.zeros(1, np.uint32),
                                        "positions": np.zeros((1, 3), np.float32)})
        assert "stroke.apply.request" in schemas.seen
        theirs.sendall(frame({"id": id, "result": {"revision": 1}}))
        with pytest.raises(schemas.jsonschema.ValidationError):
            link.wait(id)
        with pytest.raises(schemas.jsonschema.ValidationError):
            link.send("pose.evaluate", {"session": "a"})
        id = link.send("history.undo", {"session": "a"})
        theirs.sendall(frame({"id": id, "result": {"revision": 2, "vertices": 1, "undo_steps": 0,
                                                   "redo_steps": 1}}))
        assert link.wait(id)["revision"] == 2
        assert "history.undo.result" in schemas.seen
        assert "stroke.apply.result" in schemas.unseen()


def test_the_path_of_the_socket(monkeypatch):
    monkeypatch.setenv("SKIND_SOCKET", "/a/b.sock")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/5")
    assert default_socket_path() == "/a/b.sock"
    monkeypatch.setenv("SKIND_SOCKET", "")
    assert default_socket_path() == "/run/user/5/skind/skind.sock"
    monkeypatch.setenv("XDG_RUNTIME_DIR", "relative")
    assert default_socket_path().startswith("/tmp/skind-")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert default_socket_path().endswith("/skind.sock")
