"""Journals that were cut, zeroed or flipped: never wrong weights, never a failed start.

A session's file and its log are kept as they were after each answered step, with what the daemon
held then. Copies are damaged:

    cut      the log at every byte of its last records, newest first, and here and there before
    zero     the same places, with zeros to the end
    flip     one random bit of the file or the log
    folded   the file after a clean stop, cut and flipped in the same ways

Each is read by the daemon's own reader (journal_probe), which must come up with a state that was
held, at the revision that it says, and tell when that is not the newest; where only the end is
lost, it must be the newest whole one. Undone to its beginning, it must hold what it began with. The
last frame of a log is the one place where damage cannot be told from a write that a kill cut off. A
share of the copies goes through a daemon's start.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from core import SkindError

from .. import work
from ..yard import BIN, Daemon, Failed, Failures, Yard, expect

VERTICES = 100
STEPS = 24
LAST = 3  # records whose every byte is cut at
SPREAD = 128  # byte distance of cuts before these
PAGE_BYTES = 4096
FRAME_BYTES = 24 + PAGE_BYTES  # of the log: a head and a page
QUICK_SHARE = 128  # one of so many places with --quick


def hash_of(link: object, session: str) -> str:
    """FNV-1a of joints, weights and rest, as journal_probe.c has it."""
    who = {"session": session}
    rows = link.call("weights.get", who)
    rest = link.call("mesh.get", who)["rest"]
    data = b"".join(np.ascontiguousarray(array).tobytes()
                    for array in (rows["joints"], rows["weights"], rest))
    value = 0xcbf29ce484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001b3 & 0xffffffffffffffff
    return f"{value:016x}"


@dataclass
class Original:
    """A session's file and log (None: folded in), and what was held at each revision."""

    file: Path
    log: Path | None
    held: dict[int, str]
    log_bytes: dict[int, int]  # of the log, once the revision was answered

    @property
    def newest(self) -> int:
        return max(self.held)


def record(yard: Yard) -> tuple[Original, Original]:
    """A session's life: its file as kill -9 leaves it, and as a clean stop does."""
    folder = yard.folder()
    with yard.daemon() as daemon:
        with daemon.link() as link:
            work.create(link, "torn", VERTICES)
            file = next(daemon.state.rglob("torn-*.skind"))
            log = Path(f"{file}-wal")
            recipe = work.Recipe("torn", VERTICES, 8)
            held, sizes = {0: hash_of(link, "torn")}, {0: log.stat().st_size if log.exists() else 0}
            while len(held) <= STEPS:
                method, params = recipe.next()
                try:
                    answer = link.call(method, params)
                except SkindError as error:
                    expect(error.name in work.NOTHING_TO_DO, str(error))
                    continue
                if "revision" in answer:
                    held[answer["revision"]] = hash_of(link, "torn")
                    sizes[answer["revision"]] = log.stat().st_size
            shutil.copy(file, folder / "crashed.skind")
            shutil.copy(log, folder / "crashed.skind-wal")
        daemon.stop()
        file = next(daemon.state.rglob("torn-*.skind"))
        shutil.copy(file, folder / "folded.skind")
        daemon.start()
    return (Original(folder / "crashed.skind", folder / "crashed.skind-wal", held, sizes),
            Original(folder / "folded.skind", None, held, {}))


@dataclass
class Reading:
    """What journal_probe tells of a file."""

    status: str
    revision: int
    cut: bool  # whether something was lost
    held: str  # hash
    begun: str  # hash once all is undone
    text: str


class Probe:
    """journal_probe, a file after the other."""

    def __init__(self) -> None:
        self.process = subprocess.Popen([BIN / "journal_probe"], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)

    def read(self, path: Path) -> Reading:
        self.process.stdin.write(f"{path}\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        expect(line, f"the reader died with {self.process.poll()} on {path}")
        status, revision, cut, held, begun, *text = line.rstrip("\n").split(" ", 5)
        return Reading(status, int(revision), cut == "1", held, begun, " ".join(text))

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(10)


class Bench:
    """A copy of an original that is damaged and mended again, and the cases that failed."""

    def __init__(self, yard: Yard, original: Original, name: str, seed: int) -> None:
        self.yard, self.original, self.name = yard, original, name
        self.folder = yard.folder()
        self.file = self.folder / "torn-0123456789abcdef.skind"
        self.log = Path(f"{self.file}-wal")
        self.random = random.Random(seed)
        self.probe = Probe()
        self.cases = 0
        self.failures = Failures(yard)
        self.renew()

    def renew(self) -> None:
        shutil.copy(self.original.file, self.file)
        if self.original.log is not None:
            shutil.copy(self.original.log, self.log)

    def target(self) -> Path:
        """What is cut: the log, or the file when there is none."""
        return self.log if self.original.log is not None else self.file

    def check(self, what: str, wanted: int | None, silent: int | None = None) -> None:
        """Reads the copy; `wanted`: the revision that it must come up with; `silent`: that it may
        without a word."""
        self.cases += 1
        try:
            why = self.judge(self.probe.read(self.file), wanted, silent)
        except Failed as failure:
            why = str(failure)
            self.probe = Probe()
        if why:
            self.fail(f"{what}: {why}")

    def judge(self, found: Reading, wanted: int | None, silent: int | None) -> str:
        """What is wrong with it, or nothing."""
        held, newest = self.original.held, self.original.newest
        if found.status != "ok":
            fine = wanted is None and found.status in ("damaged", "unsupported", "newer")
            return "" if fine else f"{found.status}: {found.text}"
        if held.get(found.revision) != found.held:
            return f"other weights than those of revision {found.revision}"
        if found.begun != held[0]:
            return f"revision {found.revision}, but other weights once all is undone"
        if wanted is not None and found.revision != wanted:
            return f"revision {found.revision} in place of {wanted}"
        if wanted is None and not found.cut and found.revision not in (newest, silent):
            return f"revision {found.revision} of {newest}, and nothing said"
        return ""

    def fail(self, why: str) -> None:
        self.failures.add(f"{self.name}, {why}")

    def places(self) -> list[int]:
        """Lengths to cut to, longest first."""
        size = self.target().stat().st_size
        if self.original.log is None:
            every, spread = size - PAGE_BYTES, PAGE_BYTES // 8 - 1
        else:
            every, spread = self.original.log_bytes[self.original.newest - LAST], SPREAD
        places = sorted({*range(every, size), *range(0, every, spread)}, reverse=True)
        return places[::self.yard.pick(1, QUICK_SHARE)]

    def newest_within(self, size: int) -> int | None:
        """The newest revision that lies whole before this length of the log."""
        if self.original.log is None:
            return None
        return max(revision for revision, end in self.original.log_bytes.items()
                   if end <= size or revision == 0)

    def cut(self) -> None:
        for size in self.places():
            os.truncate(self.target(), size)
            self.check(f"cut to {size} bytes", self.newest_within(size))
        self.renew()

    def zero(self) -> None:
        end = self.target().stat().st_size
        whole = self.target().read_bytes()
        with self.target().open("r+b") as file:
            for size in self.places():
                file.seek(size)
                file.write(bytes(end - size))
                file.flush()
                end = size
                kept = size + len(whole[size:]) - len(whole[size:].lstrip(b"\0"))
                self.check(f"zeros from byte {size}", self.newest_within(kept))
        self.renew()

    def flip(self, count: int) -> None:
        files = [self.file] + [self.log] * (self.original.log is not None)
        for _ in range(count):
            path = self.random.choice(files)
            at, bit = self.random.randrange(path.stat().st_size), self.random.randrange(8)
            with path.open("r+b") as file:
                file.seek(at)
                (byte,) = file.read(1)
                file.seek(at)
                file.write(bytes([byte ^ 1 << bit]))
                file.flush()
                is_last = path == self.log and at >= path.stat().st_size - FRAME_BYTES
                self.check(f"bit {bit} of byte {at} of {path.suffix}", None,
                           silent=self.original.newest - 1 if is_last else None)
                file.seek(at)
                file.write(bytes([byte]))

    def start_daemon(self, damage: str) -> None:
        """A daemon that finds the damaged copy among its sessions."""
        self.cases += 1
        daemon = Daemon(self.yard.folder())
        try:
            daemon.start()
            folder = next(daemon.state.rglob("lock")).parent
            daemon.stop()
            for path in (self.file, self.log):
                if path.exists():
                    shutil.copy(path, folder / path.name)
            with daemon.start().link() as link:
                listed = link.call("session.list")
                names = {row["session"]: row["revision"] for row in listed["sessions"]}
                if "torn" in names:
                    expect(self.original.held[names["torn"]] == hash_of(link, "torn"),
                           "a daemon started with other weights")
                    link.call(*work.Recipe("torn", VERTICES, 1).stroke(pose="rest"))
                else:
                    expect(listed["damaged"], "the session is gone, and nothing is said")
            daemon.stop()
        except (Failed, SkindError, OSError) as failure:
            self.fail(f"a start after {damage}: {failure}")
            daemon.kill()

    def start_some(self, count: int) -> None:
        for index in range(count):
            size = self.target().stat().st_size
            if index % 2:
                at = self.random.randrange(size)
                os.truncate(self.target(), at)
                self.start_daemon(f"a cut to {at}")
            else:
                with self.target().open("r+b") as file:
                    at = self.random.randrange(size)
                    file.seek(at)
                    file.write(b"\xa5")
                self.start_daemon(f"a5 in byte {at}")
            self.renew()

    def run(self) -> "Bench":
        try:
            self.check("whole", self.original.newest)
            self.cut()
            self.zero()
            self.flip(self.yard.pick(3000, 100))
            self.start_some(self.yard.pick(100, 4))
        finally:
            self.probe.close()
            shutil.rmtree(self.folder, ignore_errors=True)
        return self


def measure(yard: Yard, seconds: float) -> dict:
    crashed, folded = record(yard)
    benches = [Bench(yard, crashed, "crashed", 1), Bench(yard, folded, "folded", 2)]
    with ThreadPoolExecutor(len(benches)) as pool:
        done = list(pool.map(Bench.run, benches))
    return {"torn_cases": sum(bench.cases for bench in done),
            "torn_failed": sum(bench.failures.count for bench in done)}
