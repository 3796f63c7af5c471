"""What `./run torture` found once, each as a test of its own."""

from __future__ import annotations

import contextlib
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
from core import SkindError
from daemons import BIN
from torture import yard as torture
from torture.figures.faults import MEMORY, Control
from torture.work import answer_of

IS_SANITIZED = re.search(b"__[at]san_init", (BIN / "skind").read_bytes()) is not None
GONE = {"session": "nobody"}
SOME = {"vertices": np.array([0], np.uint32)}
# Each method that works on a session, with what it cannot do without.
METHODS = {
    "session.info": {}, "session.attach": {}, "session.detach": {}, "session.close": {},
    "session.set": {"durability": "off"}, "session.claim": {}, "session.delete": {},
    "session.save": {"path": "/nowhere/a.skind"}, "session.fork": {"name": "fork"},
    "session.verify": {}, "session.export": {"path": "/nowhere/a.glb"}, "mesh.get": {},
    "pose.set": {"pose": "p", "bend": 10}, "pose.evaluate": {"pose": "p"},
    "stroke.apply": {"pose": "p", "positions": np.zeros((1, 3), np.float32), **SOME},
    "pins.list": {}, "pins.get": {"pose": "p"}, "pins.weigh": {"pose": "p", "weight": 1},
    "pins.clear": {}, "pins.solve": {"pose": "p"}, "guard.set": {}, "guard.get": {},
    "shapes.list": {}, "shapes.get": {"pose": "p"},
    "session.refit": {"poses": ["p"], "positions": np.zeros((1, 3), np.float32)},
    "weights.get": {}, "weights.set": {"weights": np.array([[1, 0, 0, 0]], np.float32), **SOME},
    "weights.mirror": {}, "weights.prune": {}, "weights.reduce": {"influences": 1},
    "history.undo": {}, "history.redo": {},
}


@pytest.mark.parametrize("method", METHODS)
def test_a_session_that_is_not_there(daemon, method) -> None:
    """session.verify went on with its call after it had been answered and freed."""
    with daemon.link(checked=False) as link:
        for _ in range(20):
            with pytest.raises(SkindError) as refusal:
                link.call(method, {**GONE, **METHODS[method]})
            assert refusal.value.name == "no_session"
        link.call("session.create", {"name": "after", **rigs.sheet(16)})
        link.call("weights.get", {"session": "after"})


@pytest.mark.parametrize("method", ["session.delete", "session.close"])
def test_a_session_that_was_ended_stays_ended(start, folder: Path, method) -> None:
    """It came back when the daemon was killed right after the answer."""
    for attempt in range(8):
        daemon = start(socket=folder / f"s{attempt}")
        with daemon.link(checked=False) as link:
            link.call("session.create", {"name": "gone", **rigs.sheet(64)})
            link.call("stroke.apply", {"session": "gone", "pose": "rest", **SOME,
                                       "positions": np.ones((1, 3), np.float32)})
            link.call(method, {"session": "gone"})
            daemon.stop(signal.SIGKILL)
        with start(socket=daemon.socket).link(checked=False) as link:
            assert link.call("session.list")["sessions"] == []


def test_it_stops_with_sessions_that_are_kept(start) -> None:
    """The journal kept the loop waiting for a next record."""
    daemon = start()
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "kept", **rigs.sheet(64)})
    began = time.monotonic()
    assert daemon.stop() == 0
    assert time.monotonic() - began < 10


def verify_and_close(daemon: torture.Daemon, control: Control, number: int) -> int:
    """Both at once, on a session of their own, while the n-th allocation fails (0: none). Returns
    how many there were."""
    who = {"session": f"s{number}"}
    with daemon.link(timeout=2) as link:
        link.call("session.create", {"name": who["session"], **rigs.sheet(16)})
        link.call("stroke.apply", {**who, "pose": "rest", **SOME,
                                   "positions": np.ones((1, 3), np.float32)})
        control.arm(MEMORY, number, 1, 0)
        asked = [link.send(method, who) for method in ("session.verify", "session.close")]
        try:
            errors = [answer_of(link, id)[1] for id in asked]
        except (ConnectionError, TimeoutError):  # not even read, for want of memory
            errors = ["no_memory"] * 2
        control.disarm()
    assert set(errors) <= {"", "no_memory", "file_io"}
    if errors[1]:
        with daemon.link() as link, contextlib.suppress(SkindError):
            link.call("session.close", who)
    return control.counted()[0]


@pytest.mark.skipif(IS_SANITIZED, reason="a sanitizer has malloc for itself")
def test_a_session_closed_while_it_is_verified_stays_closed(folder: Path) -> None:
    """Its file was away, could not be taken up again for want of memory, and was left open."""
    control = Control(folder / "control")
    daemon = torture.Daemon(folder, environment={
        "LD_PRELOAD": str(BIN / "libfaults.so"), "SKIND_FAULTS": str(folder / "control")}).start()
    allocations = verify_and_close(daemon, control, 0)
    # Before these the requests themselves are read, after them the file is closed.
    for number in range(allocations // 2, allocations * 2 // 3):
        verify_and_close(daemon, control, number)
    with daemon.link() as link:
        assert link.call("session.list")["sessions"] == []
    daemon.kill()
    with daemon.start().link() as link:
        assert link.call("session.list")["sessions"] == []
    daemon.stop()


def end_it(daemon: torture.Daemon, control: Control, method: str, number: int) -> int:
    """Ends a session of its own while the n-th allocation fails (0: none). Returns how many there
    were."""
    who = {"session": f"s{number}"}
    with daemon.link(timeout=2) as link, contextlib.suppress(ConnectionError, TimeoutError):
        link.call("session.create", {"name": who["session"], **rigs.sheet(16)})
        control.arm(MEMORY, number, 1, 0)
        _, error = answer_of(link, link.send(method, who))
        control.disarm()
        names = [row["session"] for row in link.call("session.list")["sessions"]]
        assert (who["session"] in names) == (error != "")
    control.disarm()
    return control.counted()[0]


@pytest.mark.skipif(IS_SANITIZED, reason="a sanitizer has malloc for itself")
@pytest.mark.parametrize("method", ["session.close", "session.delete"])
def test_ending_a_session_is_done_or_refused(folder: Path, method) -> None:
    """It was closed, and then there was no memory for saying so: told as refused."""
    control = Control(folder / "control")
    daemon = torture.Daemon(folder, environment={
        "LD_PRELOAD": str(BIN / "libfaults.so"), "SKIND_FAULTS": str(folder / "control")}).start()
    for number in range(1, end_it(daemon, control, method, 0) + 1):
        end_it(daemon, control, method, number)
    daemon.kill()
