"""Runs functions inside real Blenders and brings their results back.

Outside half of the harness; `driver.py` is the half that runs inside. A job is the name of a
function in tests/addon/inside ("rigs.tube_facts") with arguments; its result, NumPy arrays
included, is what the function returns, and an exception in there is the test's failure, with its
traceback. Each job has a process, a home folder and a time limit of its own.

    Blender("3.4", folder)     Debian's, headless
    Blender("4.5", folder)     the bpy wheel of that series in the system's Python, headless
    Window(folder)             Debian's in a window under an Xvfb of its own, driven by events
"""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from core import Link

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
ADDON = ROOT / "clients" / "blender_addon"
ASSETS = ROOT.parent / "shared" / "assets"
PYTHON = "/usr/bin/python3"

CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
BPY_ROOT = Path(os.environ.get("SKIND_BPY_ROOT", CACHE / "skind"))
BPY_VERSIONS = {version.rsplit(".", 1)[0]: version
                for version in (HERE / "bpy-versions").read_text().split()}
DEBIAN = "3.4"
VERSIONS = [DEBIAN, *BPY_VERSIONS]

SECONDS = 120.0  # a job's time when the test names none
GRACE_SECONDS = 15.0  # what a Blender may need to end after its watchdog has fired
SCREEN = (900, 700)


class Failed(AssertionError):
    """A job raised, crashed, ran too long, or left a traceback in the log."""


class Job:
    """A function that runs inside a Blender at this moment."""

    def __init__(self, command: list[str], call: str, arguments: tuple, named: dict, *, home: Path,
                 environment: dict[str, str], window: bool = False, addon: Path | None = ADDON,
                 seconds: float = SECONDS, quiet: bool = True) -> None:
        """`addon` is the add-on's package folder, None for a Blender without it. `quiet` makes a
        traceback in Blender's output a failure too: what dies in a timer or a draw handler
        reaches nobody otherwise."""
        self.call, self.seconds, self.quiet = call, seconds, quiet
        self.folder = Path(tempfile.mkdtemp(prefix="job-", dir=home))
        self.log = self.folder / "log"
        self.output = self.folder / "result"
        packages = self.folder / "packages"
        packages.mkdir()
        if addon is not None:
            (packages / "skind").symlink_to(addon)
        job = self.folder / "job"
        job.write_bytes(pickle.dumps({
            "call": call, "arguments": arguments, "named": named, "window": window,
            "addon": addon is not None, "packages": str(packages), "seconds": seconds,
            "output": str(self.output)}))
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [*command, str(job)], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                cwd=self.folder, env=environment)

    def text(self) -> str:
        """What Blender has printed."""
        return self.log.read_text(errors="replace")

    def kill(self) -> None:
        """Ends Blender as a crash would."""
        self.process.kill()
        self.process.wait()

    def result(self) -> Any:
        """Waits for the end; returns what the function returned, or raises Failed."""
        try:
            status = self.process.wait(self.seconds + GRACE_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            raise self._failure(f"did not end within {self.seconds:g} s") from None
        if not self.output.exists():
            raise self._failure(f"ended with status {status} and without a result")
        answer = pickle.loads(self.output.read_bytes())
        if "error" in answer:
            raise self._failure(answer["error"])
        if status != 0:
            raise self._failure(f"returned, but Blender ended with status {status}")
        if self.quiet and "Traceback (most recent call last)" in self.text():
            raise self._failure("returned, but something else in Blender failed")
        return answer["value"]

    def _failure(self, reason: str) -> Failed:
        tail = "\n".join(self.text().splitlines()[-60:])
        return Failed(f"{self.call} {reason}\n--- Blender's output\n{tail}")


class Blender:
    """A Blender version without a window. Jobs share `folder` as their home, and its socket."""

    def __init__(self, version: str, folder: Path) -> None:
        self.version = version
        self.home = folder
        self.socket = folder / "skind.sock"
        self.jobs: list[Job] = []
        if version == DEBIAN:
            self._need(shutil.which("blender"), "blender is not installed")
            self.command = ["blender", "--background", "--factory-startup",
                            "--python-exit-code", "1", "--python", str(HERE / "driver.py"), "--"]
            self.modules: Path | None = None
        else:
            self.modules = BPY_ROOT / f"bpy-{BPY_VERSIONS[version]}"
            self._need((self.modules / "bpy").is_dir(), f"{self.modules} does not hold bpy")
            self.command = [PYTHON, str(HERE / "driver.py")]

    @staticmethod
    def _need(there: object, sentence: str) -> None:
        if not there:
            raise Failed(f"{sentence}; `./run test` installs it")

    def environment(self) -> dict[str, str]:
        """The outside's, with folders that are private to the test."""
        build = Path(os.environ.get("SKIND_BUILD") or ROOT / "build" / "release")
        private = {"PATH": f"{build / 'bin'}:{os.environ['PATH']}", "HOME": self.home, "TMPDIR": self.home, "SKIND_SOCKET": self.socket,
                   "BLENDER_USER_RESOURCES": self.home / "blender",
                   "BLENDER_USER_CONFIG": self.home / "blender" / "config",
                   "BLENDER_USER_SCRIPTS": self.home / "blender" / "scripts",
                   "MESA_SHADER_CACHE_DIR": CACHE / "skind",
                   "XDG_CONFIG_HOME": self.home / "config", "XDG_CACHE_HOME": self.home / "cache",
                   "XDG_DATA_HOME": self.home / "data", "XDG_RUNTIME_DIR": self.home,
                   "SKIND_BUILD": build}
        result = {**os.environ, **{name: str(value) for name, value in private.items()},
                  "PYTHONDONTWRITEBYTECODE": "1"}
        result.pop("DISPLAY", None)
        if self.modules is not None:
            result["PYTHONPATH"] = str(self.modules)
        return result

    def start(self, call: str, *arguments: Any, addon: Path | None = ADDON,
              seconds: float = SECONDS, quiet: bool = True, **named: Any) -> Job:
        """Starts a job and does not wait: for tests that do things to it meanwhile."""
        self.jobs.append(Job(self.command, call, arguments, named, home=self.home, addon=addon,
                             environment=self.environment(), seconds=seconds, quiet=quiet))
        return self.jobs[-1]

    def run(self, call: str, *arguments: Any, **named: Any) -> Any:
        """start() and result() in one."""
        return self.start(call, *arguments, **named).result()

    def close(self) -> None:
        """Ends what still runs: a test that failed between start() and result(), and a daemon that
        an add-on started and that holds unexported strokes, which it would keep for ever."""
        for job in self.jobs:
            if job.process.poll() is None:
                job.kill()
        with suppress(OSError), Link.connect(self.socket, name="test") as link:
            link.call("shutdown")


class Window(Blender):
    """Debian's Blender in a window. Its jobs are generator functions; see driver.py."""

    def __init__(self, folder: Path, screen: tuple[int, int] = SCREEN) -> None:
        super().__init__(DEBIAN, folder)
        self._need(shutil.which("Xvfb"), "Xvfb is not installed")
        self.screen = screen
        self.command = ["blender", "--factory-startup", "--enable-event-simulate",
                        "-p", "0", "0", str(screen[0]), str(screen[1]),
                        "--python-exit-code", "1", "--python", str(HERE / "driver.py"), "--"]
        self.display: str | None = None
        self.server: subprocess.Popen | None = None

    def _open_display(self) -> str:
        """An X server on a display that is free; it ends in close()."""
        if self.display is None:
            reader, writer = os.pipe()
            with (self.home / "xvfb.log").open("wb") as log:
                self.server = subprocess.Popen(
                    ["Xvfb", "-displayfd", str(writer), "-noreset", "-nolisten", "tcp",
                     "-screen", "0", f"{self.screen[0]}x{self.screen[1]}x24"],
                    stdin=subprocess.DEVNULL, stdout=log, stderr=log, pass_fds=[writer])
            os.close(writer)
            with os.fdopen(reader) as lines:
                number = lines.readline().strip()
            self._need(number, f"Xvfb does not start: {(self.home / 'xvfb.log').read_text()}")
            self.display = f":{number}"
        return self.display

    def start(self, call: str, *arguments: Any, addon: Path | None = ADDON,
              seconds: float = SECONDS, quiet: bool = True, **named: Any) -> Job:
        environment = {**self.environment(), "DISPLAY": self._open_display(),
                       "LIBGL_ALWAYS_SOFTWARE": "1"}
        self.jobs.append(Job(self.command, call, arguments, named, home=self.home, addon=addon,
                             environment=environment, window=True, seconds=seconds, quiet=quiet))
        return self.jobs[-1]

    def close(self) -> None:
        super().close()
        if self.server is not None:
            self.server.send_signal(signal.SIGTERM)
            self.server.wait(GRACE_SECONDS)
