"""A skind process under test, with a socket of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import schemas
from core import Link

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(os.environ.get("SKIND_BUILD", ROOT / "build" / "release")) / "bin"
START_SECONDS = 30.0  # generous: the sanitizer builds start slowly on a busy machine


class Daemon:
    """A skind process under test."""

    def __init__(self, folder: Path, *options: str, socket: Path | None = None,
                 before: tuple[str, ...] = ()) -> None:
        self.socket = socket or folder / "skind.sock"
        self.log = folder / "log"
        self.process = subprocess.Popen(
            [*before, BIN / "skind", "--socket", str(self.socket), *options],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=self.log.open("ab"),
            env={"TSAN_OPTIONS": f"suppressions={ROOT / 'tests' / 'tsan.supp'}", **os.environ})

    def wait_ready(self) -> "Daemon":
        deadline = time.monotonic() + START_SECONDS
        while time.monotonic() < deadline:
            assert self.process.poll() is None, self.log.read_text()
            try:
                Link.connect(self.socket).close()
                return self
            except OSError:
                time.sleep(0.01)
        raise AssertionError(f"skind does not answer: {self.log.read_text()}")

    def link(self, name: str = "test", lines: bool = False, checked: bool = True,
             id: str = "") -> Link:
        """A connection; `checked` holds each of its messages against the schemas."""
        return Link.connect(self.socket, name=name, id=id, lines=lines,
                            watch=schemas.watch() if checked else None)

    def stop(self, number: int = signal.SIGTERM) -> int:
        """Ends it and returns its exit status; a sanitizer's report makes that not 0."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(START_SECONDS)
