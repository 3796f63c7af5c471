# SPDX-License-Identifier: GPL-3.0-or-later
"""Starting skind: `Launcher` runs `skinctl start` beside the program and never waits for it.

skinctl itself sees to it that only one daemon starts, however many programs ask at once, and the
daemon outlives both. Owns the child process. No thread; one thread at a time.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Callable, Iterable

PATIENCE_S = 30.0  # three times what skinctl allows itself
SAID_BYTES = 1 << 16  # as much as a pipe holds


class Launcher:
    """Starts skind with `skinctl start` in the background; polled, never waited for.

    `candidates` are folders that may hold skinctl, or the program itself, in the order in which
    they are tried; PATH comes last, and empty ones are passed over. The daemon that it starts ends
    after `idle_exit_s` without clients and unexported work.

    `problem` says why the last try failed; "" after one that did not, or none. `started`: it was
    this launcher's skinctl that made the daemon, not somebody who was faster.
    """

    def __init__(self, path: str, candidates: Iterable[str | Path], idle_exit_s: int = 1800, *,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self.path = os.fspath(path)
        self.candidates = [os.path.expanduser(candidate) for candidate in candidates
                           if str(candidate).strip()]
        self.idle_exit_s = idle_exit_s
        self.problem = ""
        self.started = False
        self._clock = clock
        self._process: subprocess.Popen | None = None
        self._outcome = "idle"
        self._deadline = 0.0

    def find(self) -> Path | None:
        """The skinctl that start() would run."""
        for file in self._places():
            if os.path.isfile(file) and os.access(file, os.X_OK):
                return Path(file)
        found = shutil.which("skinctl")
        return Path(found) if found else None

    def start(self) -> None:
        """Begins a try, unless one runs. Raises nothing: poll() and `problem` tell."""
        if self._process is not None:
            return
        self.started = False
        program = self.find()
        if program is None:
            self._fail(self._not_found())
            return
        try:
            # In a session of its own, a Ctrl+C in the terminal of this program does not reach it.
            self._process = subprocess.Popen(
                [program, "start", "--json", f"--socket={self.path}",
                 f"--idle-exit={self.idle_exit_s}"],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                bufsize=0, start_new_session=True)
        except (OSError, ValueError) as error:
            self._fail(f"{program} cannot be run: {error}; install skind again")
            return
        for pipe in (self._process.stdout, self._process.stderr):
            os.set_blocking(pipe.fileno(), False)
        self._outcome = "running"
        self._deadline = self._clock() + PATIENCE_S

    def poll(self) -> str:
        """How the last try stands: "idle" (none was made), "running", "done" or "failed"."""
        if self._process is not None:
            status = self._process.poll()
            if status is not None:
                self._finish(status)
            elif self._clock() >= self._deadline:
                self._process.kill()  # and a later poll reaps it
        return self._outcome

    def close(self) -> None:
        """Gives a try up that still runs. A daemon that it made already goes on."""
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()  # only until the system has taken a killed process away
        self._let_go()
        self._outcome = "idle"

    def _places(self) -> list[str]:
        return [os.path.join(candidate, "skinctl") if os.path.isdir(candidate) else candidate
                for candidate in self.candidates]

    def _not_found(self) -> str:
        for file in self._places():
            if os.path.isfile(file):
                return f"{file} may not be executed: allow it with chmod +x, or install skind again"
        looked = ", ".join([*self.candidates, "PATH"])
        return f"skinctl was not found: install skind, or say where it is (looked in {looked})"

    def _fail(self, problem: str) -> None:
        self._outcome = "failed"
        self.problem = problem

    def _finish(self, status: int) -> None:
        answer = self._process.stdout.read(SAID_BYTES) or b""
        said = (self._process.stderr.read(SAID_BYTES) or b"").decode("utf-8", "replace")
        overdue = self._clock() >= self._deadline
        self._let_go()
        if status == 0:
            self._outcome = "done"
            self.problem = ""
            self.started = _made_it(answer)
            return
        sentences = [line.strip() for line in said.splitlines() if line.strip()]
        if sentences:
            self._fail(sentences[-1].removeprefix("skinctl: "))
        elif overdue:
            self._fail(f"skinctl could not start skind within {PATIENCE_S:.0f} s; look whether the "
                       "machine is busy, or run 'skinctl start' in a terminal")
        else:
            self._fail(f"skinctl ended with status {status} and said nothing; run "
                       "'skinctl start' in a terminal to see more")

    def _let_go(self) -> None:
        self._process.stdout.close()
        self._process.stderr.close()
        self._process = None


def _made_it(answer: bytes) -> bool:
    """What skinctl's JSON says about who started the daemon."""
    try:
        said = json.loads(answer)
    except ValueError:
        return False
    return isinstance(said, dict) and said.get("started") is True
