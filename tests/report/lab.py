"""A daemon of the report's own, a link to it, and what is said while it works."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ROOT.parent / "shared" / "assets"
BIN = Path(os.environ.get("SKIND_BUILD", ROOT / "build" / "release")) / "bin"
START_SECONDS = 30.0

sys.path[:0] = [str(ROOT / "clients" / "blender_addon"), str(ROOT / "tests" / "oracle")]

from core import Link  # noqa: E402


class Lab:
    """`with Lab() as lab:` a daemon on a private socket runs as long as the block does."""

    def __init__(self, quick: bool = False) -> None:
        self.quick = quick
        self.folder = tempfile.TemporaryDirectory(prefix="skind-report-")
        self._began = time.monotonic()
        self._count = 0

    def __enter__(self) -> "Lab":
        path = Path(self.folder.name) / "skind.sock"
        self._log = (Path(self.folder.name) / "log").open("wb")
        self._process = subprocess.Popen([BIN / "skind", "--socket", str(path), "--state",
                                          str(path.parent / "state")],
                                         stdin=subprocess.DEVNULL, stderr=self._log)
        deadline = time.monotonic() + START_SECONDS
        while True:
            try:
                self.link = Link.connect(path, name="report", timeout=300)
                break
            except OSError:
                if self._process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"{BIN / 'skind'} does not start") from None
                time.sleep(0.02)
        self.capabilities = set(self.link.hello["capabilities"])
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()
        self._process.terminate()
        self._process.wait(START_SECONDS)
        self._log.close()
        self.folder.cleanup()

    def say(self, text: str) -> None:
        """A line of progress."""
        print(f"{time.monotonic() - self._began:6.1f} s  {text}", file=sys.stderr, flush=True)

    def new_name(self) -> str:
        self._count += 1
        return f"report.{self._count}"

    def call(self, request: str, **params: object) -> dict:
        """The answer to a request; what the daemon tells on the side is dropped."""
        answer = self.link.call(request, params)
        self.link.notifications.clear()
        return answer
