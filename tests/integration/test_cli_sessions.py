"""skinctl session and watch: kept sessions by hand, and what a watcher holds."""

from __future__ import annotations

import json
import os
import random
import select
import signal
import socket
import subprocess
import threading
import time
from pathlib import Path
from typing import Callable, Iterator

import numpy as np
import pytest
from core import Link
from test_cli import Cli, body, cli, humanoid  # noqa: F401  (fixtures)


def stroke(body: Cli, amount: float = 0.02) -> None:
    body.run("stroke", "bent", "--bone", "thigh.L", "--radius", 0.2, "--move", f"0,{amount},0")


def kill(cli: Cli) -> None:
    os.kill(cli.status()["pid"], signal.SIGKILL)


def test_a_killed_daemon_costs_nothing(body: Cli) -> None:
    stroke(body)
    before = body.json("weights")
    kill(body)
    assert body.json("weights") == before
    assert body.json("undo")["undo_steps"] == 0


def test_save_open_fork_verify_delete(body: Cli, folder) -> None:
    stroke(body)
    assert "saved" in body.run("session", "save", "body.skind").stdout
    assert body.json("session", "verify", "body.skind")["ok"]
    assert body.json("session", "verify")["ok"]
    assert body.json("session", "open", "body.skind", "--name", "again")["undo_steps"] == 1
    assert body.json("session", "fork", "try", "--session", "body")["revision"] == 1
    assert body.json("session", "set", "--session", "try", "--durability", "off", "--history",
                     "2G") == {"session": "try", "durability": "off", "history_bytes": 2 << 30}
    shown = body.run("session").stdout
    assert "again" in shown and "off" in shown
    body.run("session", "delete", "again")
    assert "again" not in body.run("session", "list").stdout


def test_a_damaged_file_is_told(body: Cli, folder) -> None:
    stroke(body)
    body.run("session", "save", "body.skind")
    path = body.folder / "body.skind"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)
    done = body.run("session", "verify", "body.skind", status=1)
    assert "NOT whole" in done.stdout


@pytest.mark.parametrize("arguments", [["nonsense"], ["save"], ["set"], ["list", "more"],
                                       ["set", "--durability", "maybe"],
                                       ["set", "--history", "12"]])
def test_wrong_words(body: Cli, arguments) -> None:
    body.run("session", *arguments, status=2)


def next_told(watch: subprocess.Popen, event: str, revision: int) -> dict:
    """The next event of a kind that is of this revision."""
    for line in watch.stdout:
        told = json.loads(line)
        if told["event"] == event and told["revision"] == revision:
            return told
    raise AssertionError(f"the watch ended before revision {revision}")


@pytest.fixture
def watch(body: Cli) -> Iterator[Callable[..., subprocess.Popen]]:
    """watch(*options) begins to watch, with --json; all must end well on an interrupt."""
    watches = []

    def begin(*options: str) -> subprocess.Popen:
        watches.append(body.popen("--json", "watch", *options))
        return watches[-1]

    yield begin
    for process in watches:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0, process.stderr.read()
        process.stdout.close()
        process.stderr.close()


def test_watchers_hold_the_same_weights_over_a_death(body: Cli, watch) -> None:
    """What one that stays has by its messages is what one that comes fresh fetches."""
    staying = watch("--digest", "--keep")
    first = next_told(staying, "digest", 0)
    stroke(body)
    assert next_told(staying, "digest", 1)["digest"] != first["digest"]
    kill(body)
    stroke(body, -0.03)
    body.run("undo")
    last = next_told(staying, "digest", 3)
    assert last["instance"] == first["instance"], "nothing was lost"
    assert next_told(watch("--digest"), "digest", 3) == last


def test_a_watch_waits_for_a_daemon_that_was_stopped(body: Cli, watch) -> None:
    staying = watch("--keep")
    next_told(staying, "session.attach", 0)
    body.run("stop")
    assert "watching" in staying.stderr.readline()
    assert "waiting" in staying.stderr.readline()
    assert not body.socket.exists(), "the watch started it again"
    stroke(body)
    assert next_told(staying, "session.update", 1)["cause"] == "stroke"


def test_who_is_here_is_told(body: Cli, watch) -> None:
    begun = watch("--no-arrays")
    assert next_told(begun, "session.attach", 0)["present"]
    link = Link.connect(body.socket, name="easel")
    link.call("session.attach", {"session": "body"})
    link.call("session.claim", {"session": "body", "bones": ["hips"],
                                "vertices": np.arange(3, dtype=np.uint32)})
    for line in begun.stdout:
        told = json.loads(line)
        if told["event"] == "session.claims":
            break
    assert (told["client"], told["user"], told["vertices"]) == ("easel", "", 3)
    shown = body.run("info").stdout
    assert "easel" in shown and "1 bones, 3 vertices" in shown
    link.close()


STROKES = 200
SCRIPT = """
strokes:
""" + "".join(f"- {{pose: bent, brush: {{bone: thigh.L, radius: 0.2, move: [0, {move}, 0]}}}}\n"
              for move in np.round(np.linspace(-0.02, 0.02, STROKES), 5))


def test_a_replay_survives_its_daemon(body: Cli) -> None:
    """Kills at random moments: each stroke is applied once, as if nothing had been."""
    (body.folder / "s.yaml").write_text(SCRIPT)
    body.run("session", "fork", "whole", "--session", "body")
    body.run("replay", "s.yaml", "--session", "whole")
    expected = body.json("weights", "--session", "whole")
    pause = random.Random(5)
    replay = body.popen("replay", "s.yaml", "--session", "body")
    lines = [replay.stdout.readline() for _ in range(5)]  # the titles and three strokes
    for _ in range(3):
        while not (state := body.status())["running"]:  # it is being started again
            time.sleep(0.01)
        time.sleep(pause.uniform(0, 0.01))
        os.kill(state["pid"], signal.SIGKILL)
    out, talk = replay.communicate(timeout=60)
    assert replay.returncode == 0 and "connecting again" in talk, talk
    numbers = [line.split()[0] for line in lines[2:] + out.splitlines()]
    assert numbers == [str(number) for number in range(1, STROKES + 1)]
    found = body.json("weights", "--session", "body")
    assert found["weights"] == expected["weights"] and found["joints"] == expected["joints"]
    info = body.json("info", "--session", "body")
    assert (info["revision"], info["undo_steps"]) == (STROKES, STROKES), "one was applied twice"


def test_a_replay_says_what_was_lost(body: Cli) -> None:
    """With durability off the session goes with the daemon."""
    body.run("session", "set", "--durability", "off")
    (body.folder / "s.yaml").write_text(SCRIPT)
    replay = body.popen("replay", "s.yaml")
    assert "#" in replay.stdout.readline() + replay.stdout.readline()
    replay.stdout.readline()
    kill(body)
    _, talk = replay.communicate(timeout=60)
    assert replay.returncode == 1 and "connecting again" in talk and "body" in talk


class Cutter:
    """Stands between skinctl and the daemon, and once loses the answer to a method."""

    def __init__(self, daemon: Path, path: Path, method: str) -> None:
        self.daemon, self.method, self.cuts = daemon, method.encode(), 0
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(path))
        self.listener.listen()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            with client, socket.socket(socket.AF_UNIX) as daemon:
                daemon.connect(str(self.daemon))
                self._carry(client, daemon)

    def _carry(self, client: socket.socket, daemon: socket.socket) -> None:
        asked = False
        while True:
            for end in select.select([client, daemon], [], [])[0]:
                data = end.recv(1 << 16)
                if not data:
                    return
                if end is client:
                    asked = asked or self.method in data
                    daemon.sendall(data)
                elif asked and self.cuts == 0:
                    self.cuts += 1
                    return
                else:
                    client.sendall(data)


@pytest.mark.parametrize("method, arguments", [
    ("history.undo", ["undo"]), ("history.undo", ["undo", "--own"]), ("history.redo", ["redo"]),
    ("weights.prune", ["weights", "prune", "--below", "0.05"]),
    ("weights.mirror", ["weights", "mirror"]), ("pins.weigh", ["pins", "weigh", "bent", "2"]),
    ("pins.clear", ["pins", "clear", "bent"])])
def test_a_change_whose_answer_was_lost_is_made_once(body: Cli, folder, method, arguments) -> None:
    for _ in range(3):
        stroke(body)
    body.run("undo")
    before = body.json("info")
    away = Cli(body.folder)
    cutter = Cutter(body.socket, folder / "cut.sock", method)
    with cutter.listener:
        done = away.run("--socket", folder / "cut.sock", *arguments)
    after = body.json("info")
    assert cutter.cuts == 1 and "connecting again" in done.stderr
    assert after["revision"] == before["revision"] + 1
    if arguments[0] in ("undo", "redo"):
        step = -1 if arguments[0] == "undo" else 1
        assert after["undo_steps"] == before["undo_steps"] + step


def test_undo_of_ones_own(body: Cli) -> None:
    """One terminal is one client; a script may have a name of its own."""
    stroke(body)
    other = Cli(body.folder)
    other.env["SKIND_CLIENT"] = "somebody-else"
    assert "own" in other.run("undo", "--own", status=1).stderr
    other.run("stroke", "bent", "--bone", "thigh.L", "--radius", 0.2, "--move", "0,-0.02,0")
    assert "same vertices" in body.run("undo", "--own", status=1).stderr
    assert other.json("undo", "--own")["undo_steps"] == 1
    assert body.json("undo", "--own")["undo_steps"] == 0


def test_what_is_not_kept_is_not_closed_by_a_slip(body: Cli) -> None:
    body.run("session", "set", "--durability", "off")
    stroke(body)
    assert "--discard" in body.run("close", status=1).stderr
    assert "off" in body.run("list").stdout
    body.run("close", "--discard")
    assert "no rig session" in body.run("list", "--all").stdout


def test_a_port(cli: Cli) -> None:
    started = cli.json("start", "--tcp", 0, "--state", "kept")
    token, port = Path(f"{cli.socket}.token").read_text().split()
    assert started["port"] == int(port) and (cli.folder / "kept").is_dir()
    far = Cli(cli.folder)
    far.env.update(SKIND_SOCKET=f"tcp:{port}", SKIND_TOKEN=token)
    assert far.json("status")["pid"] == started["pid"]
    assert far.json("list")["sessions"] == []
    far.env["SKIND_TOKEN"] = token[:-1] + ("0" if token[-1] != "0" else "1")
    assert "token" in far.run("list", status=1).stderr
    del far.env["SKIND_TOKEN"]
    assert "SKIND_TOKEN" in far.run("list", status=1).stderr
    for wrong in ("tcp:", "tcp:0", "tcp:65536", "tcp:12x"):
        assert "tcp:" in far.run("--socket", wrong, "list", status=1).stderr
    far.run("start", status=2)
    cli.run("stop")
    cli.run("start")
    assert "without a port" in cli.run("start", "--tcp", 0, status=1).stderr
