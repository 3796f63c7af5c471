"""The daemon's life: one a socket, modes, stale sockets, signals, idleness."""

from __future__ import annotations

import os
import resource
import signal
import stat
import subprocess
import time

import numpy as np
import pytest
import rigs
from core import Link, SkindError
from daemons import BIN, Daemon


def test_one_instance_a_socket(start, folder) -> None:
    first = start()
    second = Daemon(folder)
    assert second.process.wait(20) == 3
    assert f"pid {first.process.pid}" in second.log.read_text()
    with first.link() as link:
        assert link.hello["server"]["pid"] == first.process.pid


def test_a_stale_socket_is_replaced(start, folder) -> None:
    killed = start()
    killed.stop(signal.SIGKILL)
    assert killed.socket.exists()
    with start().link() as link:
        link.call("ping")


def test_a_file_in_the_sockets_place_is_left_alone(folder) -> None:
    (folder / "skind.sock").write_text("mine")
    daemon = Daemon(folder)
    assert daemon.process.wait(20) == 1
    assert (folder / "skind.sock").read_text() == "mine"


def test_modes_whatever_the_umask(folder, start) -> None:
    before = os.umask(0)
    try:
        daemon = start(socket=folder / "new" / "skind.sock")
    finally:
        os.umask(before)
    assert stat.S_IMODE(daemon.socket.stat().st_mode) == 0o600
    assert stat.S_IMODE(daemon.socket.parent.stat().st_mode) == 0o700


@pytest.mark.parametrize("make", ["open", "link"])
def test_a_folder_that_others_can_enter_is_refused(folder, make) -> None:
    place = folder / "place"
    if make == "open":
        place.mkdir()
        place.chmod(0o755)
    else:
        (folder / "real").mkdir(mode=0o700)
        place.symlink_to(folder / "real")
    daemon = Daemon(folder, socket=place / "skind.sock")
    assert daemon.process.wait(20) == 1
    assert str(place) in daemon.log.read_text()


def test_a_socket_path_that_is_too_long_is_refused_with_the_reason(start, folder) -> None:
    for length in (106, 107):
        start(socket=folder / ("x" * (length - len(f"{folder}/")))).stop()
    daemon = Daemon(folder, socket=folder / ("x" * (108 - len(f"{folder}/"))))
    assert daemon.process.wait(20) == 1
    assert "108" in daemon.log.read_text() and "107" in daemon.log.read_text()


def test_it_ends_clean_with_work_in_flight(start) -> None:
    daemon = start()
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(200_000)})
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
        stroke = {"session": "sheet", "pose": "rest", "positions": posed,
                  "vertices": np.arange(len(posed), dtype=np.uint32)}
        ids = [link.send("stroke.apply", stroke) for _ in range(4)]
        daemon.process.send_signal(signal.SIGTERM)
        outcomes = []
        for id in ids:
            try:
                outcomes.append(link.wait(id)["revision"])
            except SkindError as error:
                outcomes.append(error.name)
        with pytest.raises((ConnectionError, SkindError)):
            link.call("ping")
    # Those that were done are told as done, in order; the others as not done.
    done = [outcome for outcome in outcomes if outcome != "shutting_down"]
    assert done == list(range(1, len(done) + 1))
    assert outcomes[len(done):] == ["shutting_down"] * (4 - len(done))
    assert daemon.process.wait(20) == 0
    assert not daemon.socket.exists()


def test_a_shutdown_request_says_bye(daemon) -> None:
    with daemon.link() as link, daemon.link() as other:
        other.call("shutdown")
        with pytest.raises(ConnectionError):
            link.call("ping")
        assert [note.method for note in link.notifications] == ["bye"]
    assert daemon.process.wait(20) == 0


def test_it_ends_when_idle_for_as_long_as_it_was_told(start) -> None:
    daemon = start("--idle-exit", "1")
    assert daemon.process.wait(20) == 0
    assert "idle" in daemon.log.read_text()


def test_it_does_not_end_on_unexported_work(start) -> None:
    daemon = start("--idle-exit", "1")
    with daemon.link() as link:
        link.call("session.create", {"name": "sheet", "durability": "off", **rigs.sheet(64)})
        link.call("stroke.apply", {"session": "sheet", "pose": "rest", "vertices": [1],
                                   "positions": [[0, 0, 0]]})
    time.sleep(2.5)
    assert daemon.process.poll() is None
    with daemon.link() as link:
        link.call("session.close", {"session": "sheet"})
    assert daemon.process.wait(20) == 0


@pytest.mark.parametrize("options", [["--workers", "x"], ["--nonsense"], ["extra"],
                                     ["--log", "loud"], ["--workers", "1000"]])
def test_wrong_options_are_refused(options) -> None:
    done = subprocess.run([BIN / "skind", *options], capture_output=True, text=True, timeout=20)
    assert done.returncode == 2
    assert done.stderr.startswith("skind: ") and done.stdout == ""


def test_help_teaches_by_example() -> None:
    done = subprocess.run([BIN / "skind", "--help"], capture_output=True, text=True, timeout=20)
    assert done.returncode == 0
    assert "Examples" in done.stdout and "--idle-exit" in done.stdout


def test_three_hundred_connections_at_once(start) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (128, hard))  # a login's may be low
    try:
        daemon = start()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    links = []
    try:
        for _ in range(300):
            links.append(Link.connect(daemon.socket))
        assert links[0].call("stats")["connections"] == 300
    finally:
        for link in links:
            link.close()
    with daemon.link() as link:
        link.call("ping")
