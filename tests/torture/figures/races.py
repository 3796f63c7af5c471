"""A hundred programs start the daemon at the same moment: one daemon serves, nobody hangs.

Half of them are `skinctl start`, which start a daemon when there is none and end when it answers;
half are skind itself, of which all but one end because another has the socket.
"""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import time
from pathlib import Path

from core import Link

from ..yard import BIN, Yard, expect

STARTS = 100
HANG_SECONDS = 2.0
BUSY = 3  # skind's exit status where another serves the socket


def spawn(command: list[str], gate: int, environment: dict, log: Path) -> subprocess.Popen:
    """A process that waits for the gate to open before it becomes the command."""
    with log.open("ab") as output:
        return subprocess.Popen(
            ["/bin/sh", "-c", 'read line; exec "$@" </dev/null', "sh", *command],
            stdin=gate, stdout=output, stderr=output, env=environment)


def serving(path: Path) -> int:
    """The pid of the daemon that answers, or 0."""
    try:
        with Link.connect(path) as link:
            return link.hello["server"]["pid"]
    except OSError:
        return 0


def wait_all(processes: list[subprocess.Popen], path: Path) -> dict[subprocess.Popen, float]:
    """Seconds until each ended; who has not is not in it: the skind that serves, and who hangs."""
    ended: dict[subprocess.Popen, float] = {}
    began = time.monotonic()
    while len(ended) < len(processes) and time.monotonic() - began < 3 * HANG_SECONDS:
        for process in processes:
            if process not in ended and process.poll() is not None:
                ended[process] = time.monotonic() - began
        left = [process.pid for process in processes if process not in ended]
        if len(left) == 1 and left[0] == serving(path):
            break
        time.sleep(0.005)
    return ended


def end(pid: int) -> None:
    """A daemon that one of our own programs started; whose child it is now, reaps it."""
    os.kill(pid, signal.SIGTERM)
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except FileNotFoundError:
            return
        if state == "Z":
            return
        time.sleep(0.005)


def race(yard: Yard) -> float:
    """One round; returns the time of the slowest."""
    folder = yard.folder()
    path, log = folder / "s", folder / "log"
    environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state"),
                   "SKIND_BIN": str(BIN / "skind")}
    gate, opening = os.pipe()
    starters = [str(BIN / "skinctl"), "--socket", str(path), "start"]
    daemons = [str(BIN / "skind"), "--socket", str(path)]
    processes = [spawn(starters if i % 2 else daemons, gate, environment, log)
                 for i in range(STARTS)]
    os.close(gate)
    time.sleep(0.05)
    os.close(opening)
    winner = 0
    try:
        ended = wait_all(processes, path)
        winner = serving(path)
        expect(winner, f"nobody serves: {log.read_text()[-300:]}")
        late = [process for process in processes if process not in ended]
        expect([process.pid for process in late] in ([], [winner]),
               f"{len(late)} of {STARTS} starts hang, pid {winner} serves")
        for index, process in enumerate(processes):
            if process in ended:
                wanted = 0 if index % 2 else BUSY
                expect(process.returncode == wanted,
                       f"a start ended with {process.returncode}: {log.read_text()[-300:]}")
        slowest = max(ended.values())
        expect(slowest <= HANG_SECONDS, f"a start took {slowest:.2f} s")
        return slowest
    finally:
        for process in processes:
            if process.poll() is None and process.pid != winner:
                process.kill()
        if winner:
            late = [process for process in processes if process.pid == winner]
            if late:
                late[0].terminate()
                late[0].wait(10)
            else:
                end(winner)
        for process in processes:
            process.wait(10)


def measure(yard: Yard, seconds: float) -> dict:
    times, began = [], time.monotonic()
    least = yard.pick(20, 2)
    while len(times) < least or (time.monotonic() - began < seconds and not yard.quick):
        times.append(race(yard))
    yard.say(f"  slowest start {max(times):.2f} s, of most rounds {statistics.median(times):.2f} s")
    return {"race_starts": len(times)}
