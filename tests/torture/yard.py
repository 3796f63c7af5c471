"""Where the daemons under test live: folders, starts and ends, and what /proc tells of them."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from core import Link
from core.exchange import Exchange
from core.wire import PROTOCOL

from . import ROOT

BUILD = Path(os.environ.get("SKIND_BUILD", ROOT / "build" / "release"))
BIN = BUILD / "bin"
START_SECONDS = 30.0
TICK = os.sysconf("SC_CLK_TCK")
# Gives free memory back at once, so that what is resident is what a daemon holds.
LEAN_ALLOCATOR = {"MALLOC_ARENA_MAX": "1", "MALLOC_TRIM_THRESHOLD_": "65536",
                  "MALLOC_MMAP_THRESHOLD_": "131072"}


class Failed(Exception):
    """A figure that is not reached, with the sentence that tells why."""


def expect(condition: object, why: str) -> None:
    if not condition:
        raise Failed(why)


class Failures:
    """What was found wrong in the cases of a figure: all are counted, the first ones told."""

    TOLD = 20

    def __init__(self, yard: "Yard") -> None:
        self._yard = yard
        self.count = 0

    def add(self, why: str) -> None:
        self.count += 1
        if self.count <= self.TOLD:
            self._yard.say(f"  {why}")


def greet(path: Path, client_id: str, timeout: float = 60.0) -> Link:
    """A connection of a client that keeps its id over connections, so that sequences count."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.connect(str(path))
        link = Link(connection, Exchange(), timeout)
        link.hello = link.call("hello", {"protocol": PROTOCOL,
                                         "client": {"name": "torture", "id": client_id}})
    except BaseException:
        connection.close()
        raise
    return link


class Daemon:
    """A skind process with a folder of its own, which holds its socket, sessions and log.

    Killed and started again in the same folder, it has to find its sessions.
    """

    def __init__(self, folder: Path, *options: str, environment: dict | None = None,
                 before: list[str] | None = None) -> None:
        self.folder = folder
        self.socket = folder / "s"
        self.state = folder / "state"
        self.log = folder / "log"
        self.options = [str(option) for option in options]
        self.environment = {**os.environ, "XDG_STATE_HOME": str(self.state),
                            **(environment or {})}
        self.before = before or []  # a program to run it with
        self.process: subprocess.Popen | None = None
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)

    def __enter__(self) -> "Daemon":
        return self.start()

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            self.kill()
        elif self.process is not None:
            self.stop()

    @property
    def pid(self) -> int:
        return self.process.pid

    def launch(self) -> None:
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [*self.before, str(BIN / "skind"), "--socket", str(self.socket), *self.options],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log,
                env=self.environment)

    def start(self) -> "Daemon":
        self.launch()
        self.link().close()
        return self

    def link(self, timeout: float = 60.0, **options: object) -> Link:
        """A connection; waits for a daemon that is still starting."""
        deadline = time.monotonic() + START_SECONDS
        while True:
            try:
                return Link.connect(self.socket, timeout=timeout, **options)
            except (OSError, ConnectionError):
                expect(self.process.poll() is None,
                       f"skind ended with {self.process.returncode}: {self.tail()}")
                expect(time.monotonic() < deadline, f"skind does not answer: {self.tail()}")
                time.sleep(0.002)

    def kill(self) -> None:
        """-9, as often as one likes."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def stop(self) -> None:
        """Asks it to end, which it must do clean."""
        self.process.send_signal(signal.SIGTERM)
        try:
            status = self.process.wait(START_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            raise Failed(f"skind does not stop: {self.tail()}") from None
        expect(status == 0, f"skind stopped with {status}: {self.tail()}")

    def tail(self) -> str:
        return self.log.read_text(errors="replace")[-600:].strip() if self.log.exists() else ""

    # ---- what the system tells of it ----

    def rss_kib(self) -> int:
        """Memory of its own that is resident."""
        for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
            if line.startswith("RssAnon"):
                return int(line.split()[1])
        raise Failed("no RssAnon in /proc")

    def descriptors(self) -> int:
        return len(os.listdir(f"/proc/{self.pid}/fd"))

    def cpu_seconds(self) -> float:
        fields = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / TICK


class Yard:
    """`with Yard(quick) as yard:` holds all folders of a run."""

    def __init__(self, quick: bool) -> None:
        self.quick = quick
        self._root = tempfile.mkdtemp(prefix="skt-")  # a name, so that a Yard can go to a process
        self._began = time.monotonic()

    def __enter__(self) -> "Yard":
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._root, ignore_errors=True)

    def say(self, text: str) -> None:
        """A line of progress."""
        print(f"{time.monotonic() - self._began:7.1f} s  {text}", file=sys.stderr, flush=True)

    def folder(self) -> Path:
        """A new one, with a path short enough for a socket."""
        return Path(tempfile.mkdtemp(prefix="", dir=self._root))

    def daemon(self, *options: str, **more: object) -> Daemon:
        return Daemon(self.folder(), *options, **more)

    def pick(self, full: object, quick: object) -> object:
        """How much of something there is."""
        return quick if self.quick else full
