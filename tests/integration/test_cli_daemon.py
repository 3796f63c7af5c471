"""How skinctl finds, starts and ends the daemon."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import time
from pathlib import Path

from test_cli import BIN, QUICK, Cli, cli  # noqa: F401  (fixtures)


def is_running(pid: int) -> bool:
    """A process that is dead but not waited for does not run."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_start_status_stop(cli: Cli) -> None:
    assert cli.json("status", status=1) == {"running": False, "socket": str(cli.socket)}
    started = cli.json("start", "--workers", 1, "--idle-exit", 600)
    assert started["started"] and started["socket"] == str(cli.socket)
    again = cli.json("start")
    assert not again["started"] and again["pid"] == started["pid"]
    status = cli.json("status")
    assert status["running"] and status["pid"] == started["pid"] and status["sessions"] == []
    assert status["stats"]["workers"] == 1
    assert cli.socket.parent.stat().st_mode & 0o777 == 0o700
    assert cli.json("stop") == {"stopped": True}
    assert not cli.socket.exists()
    assert not is_running(started["pid"])
    assert cli.json("stop") == {"stopped": False}


def test_daemon_is_detached(cli: Cli) -> None:
    pid = cli.json("start")["pid"]
    assert os.getsid(pid) == pid
    assert os.readlink(f"/proc/{pid}/cwd") == "/"
    assert os.readlink(f"/proc/{pid}/fd/0") == "/dev/null"
    log = str(cli.socket.parent / "skind.log")
    assert {os.readlink(f"/proc/{pid}/fd/{number}") for number in (1, 2)} == {log}


def test_autostarted_daemon_ends_when_idle(cli: Cli) -> None:
    assert cli.json("list")["sessions"] == []
    pid = cli.json("status")["pid"]
    command = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    assert command[command.index(b"--idle-exit") + 1] == b"1800"


def test_many_starts_give_one_daemon(cli: Cli) -> None:
    count = 20 if QUICK else 100
    begun = time.monotonic()
    running = [cli.popen("--json", "start") for _ in range(count)]
    answers = [json.loads(process.communicate(timeout=60)[0]) for process in running]
    assert all(process.returncode == 0 for process in running)
    assert len({answer["pid"] for answer in answers}) == 1
    assert sum(answer["started"] for answer in answers) == 1
    assert time.monotonic() - begun < 30


def test_start_after_a_kill(cli: Cli) -> None:
    first = cli.json("start")["pid"]
    os.kill(first, signal.SIGKILL)
    assert cli.json("status", status=1)["running"] is False
    second = cli.json("start")
    assert second["started"] and second["pid"] != first


def test_start_waits_for_a_daemon_that_is_leaving(cli: Cli) -> None:
    """A lock that somebody holds for a moment: start tries again and does not give up."""
    cli.socket.parent.mkdir(mode=0o700)
    with open(f"{cli.socket}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        process = cli.popen("--json", "start")
        time.sleep(0.5)
        assert process.poll() is None
    assert json.loads(process.communicate(timeout=60)[0])["started"]


def test_daemon_that_cannot_start_is_explained(cli: Cli) -> None:
    cli.env["SKIND_BIN"] = str(cli.folder / "nowhere")
    assert "nowhere: No such file" in cli.run("list", status=1).stderr
    broken = cli.folder / "broken"
    broken.write_text("#!/bin/sh\necho no luck today >&2\nexit 1\n")
    broken.chmod(0o755)
    cli.env["SKIND_BIN"] = str(broken)
    assert "no luck today" in cli.run("list", status=1).stderr
    del cli.env["SKIND_BIN"]
    cli.socket.parent.chmod(0o755)
    assert "0755" in cli.run("list", status=1).stderr
    cli.socket.parent.chmod(0o700)
    assert "absolute" in cli.run("--socket", "here", "list", status=1).stderr
    assert "bytes" in cli.run("--socket", "/" + "x" * 200, "list", status=1).stderr


def test_start_has_patience_and_says_so(cli: Cli) -> None:
    """A daemon that has much to read first, and two that want it."""
    slow = cli.folder / "slow"
    slow.write_text(f'#!/bin/sh\nsleep 2.5\nexec "{BIN}/skind" "$@"\n')
    slow.chmod(0o755)
    cli.env["SKIND_BIN"] = str(slow)
    for process in [cli.popen("list") for _ in range(2)]:
        _, talk = process.communicate(timeout=60)
        assert process.returncode == 0 and "waiting for skind to start" in talk, talk


def test_socket_option_wins(cli: Cli) -> None:
    other = cli.folder / "other" / "s"
    assert cli.json("--socket", other, "start")["socket"] == str(other)
    assert cli.json("status", status=1)["running"] is False
    assert cli.json("stop", "--socket", other)["stopped"] is True
