"""Every allocation, write and fsync of a whole scripted session made to fail, one after the other.

Each point is a daemon of its own, on which the script is played: what was refused was not done,
what was answered is done, whole. What was not answered at all is asked again under its sequence.
Then the daemon ends (by a signal, or killed), starts again without faults, and holds what it held.

What it should hold is what a daemon without faults holds after the same requests.
"""

from __future__ import annotations

import errno
import mmap
import multiprocessing
import os
import shutil
import signal
import struct
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from core import Link, SkindError

from .. import ROOT, work
from ..yard import BIN, Daemon, Failed, Failures, Yard, expect, greet

MEMORY, FILES = 0, 1
VERTICES = 64
# What a request may be refused with when the machine has no memory or no disk.
REFUSALS = {"no_memory", "file_io", "too_large", "busy", "bad_rig", "cancelled", "damaged"}
PATIENCE_SECONDS = 40.0  # until a journal is written again


class Control:
    """The page that faults.c and we share."""

    LAYOUT = struct.Struct("<8Q")  # kind, first, count, number, armed, memory, files, failed
    ARMED = 4

    def __init__(self, path: Path) -> None:
        path.write_bytes(bytes(4096))
        with path.open("r+b") as file:
            self.page = mmap.mmap(file.fileno(), 4096)

    def _set(self, index: int, value: int) -> None:
        self.page[8 * index:8 * index + 8] = struct.pack("<Q", value)

    def arm(self, kind: int, first: int, count: int, number: int) -> None:
        for index, value in enumerate((kind, first, count, number, 0, 0, 0, 0)):
            self._set(index, value)
        self._set(self.ARMED, 1)

    def disarm(self) -> None:
        self._set(self.ARMED, 0)

    def counted(self) -> tuple[int, int, int]:
        """(allocations, changes of files, of these failed) since it was armed."""
        return self.LAYOUT.unpack(self.page[:64])[5:8]


@dataclass(frozen=True)
class Script:
    """What is asked of a daemon; faults begin after the first `setup` requests."""

    name: str
    session: str  # what it leaves
    setup: int
    asked: tuple[tuple[str, dict], ...]


def scripts(glb: Path) -> dict[str, Script]:
    """A session with all that a session can have, in three parts, so that each point is short. A
    "$" in a path stands for the daemon's folder."""
    recipe, who = work.Recipe("main", VERTICES, 4), {"session": "main"}
    begin = (("session.create", {"name": "main", **work.rigs.sheet(VERTICES)}),
             *(("pose.set", {**who, "pose": pose, "bend": 10.0, "seed": seed})
               for seed, pose in enumerate(work.POSES)), recipe.stroke())
    sculpting = (*begin, ("session.attach", who), ("session.claim", {**who, "bones": ["bone.1"]}),
                 recipe.stroke(slots="evidence"),
                 ("guard.set", {**who, "poses": ["a", "b"], "count": 2}),
                 recipe.stroke(residual="shape"),
                 recipe.stroke(pin="move", smooth=0.1, stream=True),
                 ("pins.list", who), ("pins.solve", {**who, "pose": "a", "stream": False}),
                 ("history.undo", who), ("history.undo", who), ("history.redo", who),
                 ("weights.prune", {**who, "below": 0.02}), ("weights.get", who),
                 ("pose.evaluate", {**who, "pose": "b"}), ("session.info", who),
                 recipe.stroke(residual="rest"), ("session.list", {}), ("stats", {}))
    of_file = (("session.create", {"name": "file", "file": str(glb)}),
               ("pose.set", {"session": "file", "pose": "a", "clip": "go", "time": 0.5}),
               ("weights.prune", {"session": "file", "below": 0.3}),
               ("session.export", {"session": "file", "path": "$/out.glb"}),
               ("session.export", {"session": "file", "path": "$/out.glb"}))
    keeping = (*begin, ("session.save", {**who, "path": "$/saved.skind"}),
               ("session.fork", {**who, "name": "fork"}), ("session.verify", who),
               ("session.delete", {"session": "fork"}), recipe.stroke(),
               ("session.close", who), ("session.open", {"closed": "main"}))
    return {one.name: one for one in (Script("sculpting", "main", 0, sculpting),
                                      Script("file", "file", 0, of_file),
                                      Script("keeping", "main", len(begin), keeping))}


@dataclass
class Point:
    """What is made to fail in a script: from the n-th on, so many, with which errno."""

    script: str
    kind: int
    first: int
    count: int = 1
    number: int = errno.ENOSPC

    def __str__(self) -> str:
        what = ("allocation", "change of a file")[self.kind]
        more = f" and {self.count - 1} more" if self.count > 1 else ""
        return f"{self.script}, {what} {self.first}{more}"


SEQUENCED = {"stroke.apply", "pins.solve", "weights.prune", "history.undo", "history.redo"}
MADE_AGAIN = SEQUENCED | {  # what a reference plays
    "session.create", "pose.set", "guard.set", "session.close", "session.open"}

# What says that a request was done already, of those without a sequence.
ENDED = {"session.create": {"name_taken"}, "session.fork": {"name_taken"},
         "session.open": {"name_taken", "no_session"},  # it is open, and among the closed no more
         "session.delete": {"no_session"}, "session.close": {"no_session"}}


@dataclass
class Played:
    """How a script went: what was done, and what was refused."""

    done: list[int] = field(default_factory=list)
    comes_back: list[int] | None = None  # at a restart: a file that could not be put away
    refused: dict[int, str] = field(default_factory=dict)


def wait_for_journal(link: Link, who: dict) -> None:
    """Until a journal that was suspended is written again."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while link.call("session.info", who)["journal"] != "ok":
        expect(time.monotonic() < deadline, "the journal is not resumed")
        time.sleep(0.05)


class Player:
    """One client that plays a script, and connects anew when the daemon hangs up on it."""

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        self.played = Played()
        self.has_closed = False
        self.link: Link | None = None

    def connect(self) -> Link:
        """A refusal, too, is an answer of a daemon without memory; it has to let us in soon."""
        if self.link is not None:
            return self.link
        deadline = time.monotonic() + 10
        while True:
            try:
                self.link = greet(self.daemon.socket, "player", timeout=20)
                return self.link
            except (SkindError, OSError) as error:
                code = self.daemon.process.poll()
                expect(code is None, f"skind ended with {code}: {self.daemon.tail()}")
                expect(time.monotonic() < deadline, f"it does not let us in: {error}")
                time.sleep(0.01)

    def reconnect(self) -> Link:
        """A connection that has all behind it that failed."""
        try:
            self.connect().call("ping")
        except (ConnectionError, OSError):
            self.link.close()
            self.link = None
        return self.connect()

    def _was_done(self, method: str, error: SkindError) -> bool:
        """Whether this refusal says that an attempt which nobody answered did it."""
        if method == "session.open" and not self.has_closed:
            return False  # there is nothing to open, and never was
        return error.name in ENDED.get(method, ())

    def ask(self, index: int, method: str, params: dict) -> None:
        if method in SEQUENCED:
            params = {**params, "sequence": index + 1}
        if "path" in params:
            params = {**params, "path": params["path"].replace("$", str(self.daemon.folder))}
        for attempt in range(4):
            link = self.connect()
            try:
                link.call(method, params)
                link.notifications.clear()
            except SkindError as error:
                if attempt > 0 and self._was_done(method, error):
                    break
                if method == "session.close" and "is closed, but" in str(error):
                    self.played.comes_back = list(self.played.done)
                    break
                allowed = REFUSALS | work.NOTHING_TO_DO | {"no_session"}
                if method == "session.claim":  # its attach may have been refused
                    allowed |= {"bad_params"}
                expect(error.name in allowed, f"{method} is refused with {error}")
                self.played.refused[index] = error.name
                return
            except (ConnectionError, OSError):
                link.close()
                self.link = None
                continue
            break
        else:
            raise Failed(f"{method} is never answered")
        self.has_closed |= method == "session.close"
        self.played.done.append(index)


class Lab:
    """Plays the scripts at one fault after the other, and knows what each should end in."""

    def __init__(self, yard: Yard) -> None:
        self.yard = yard
        self.library = BIN / "libfaults.so"
        expect(self.library.exists(), f"{self.library} is not built")
        self.scripts = scripts(ROOT / "tests" / "fuzz" / "corpus" / "gltf" / "animated.glb")
        self.references: dict[tuple, str] = {}

    def reference(self, script: Script, done: list[int]) -> str:
        """What a daemon without faults holds after these requests of a script."""
        key = (script.name, *done)
        if key not in self.references:
            with self.yard.daemon("--workers", 1) as daemon, daemon.link() as link:
                for index in done:
                    if script.asked[index][0] in MADE_AGAIN:
                        link.call(*script.asked[index])
                self.references[key] = self.held(link, script)
        return self.references[key]

    @staticmethod
    def held(link: Link, script: Script) -> str:
        names = {row["session"] for row in link.call("session.list")["sessions"]}
        return work.digest(link, script.session) if script.session in names else "nothing"

    def count(self, script: Script) -> tuple[int, int]:
        """How many points a script has."""
        daemon, control = self.begin()
        self.play(daemon, control, script, Point(script.name, MEMORY, 0))
        counted = control.counted()
        daemon.stop()
        return counted[:2]

    def begin(self) -> tuple[Daemon, Control]:
        folder = self.yard.folder()
        control = Control(folder / "control")
        return Daemon(folder, "--workers", 1, environment={
            "LD_PRELOAD": str(self.library), "SKIND_FAULTS": str(folder / "control")}), control

    def play(self, daemon: Daemon, control: Control, script: Script,
             point: Point) -> Player | None:
        """Plays a script with a fault on its way. None: the daemon gave up before it served."""
        if script.setup == 0:
            control.arm(point.kind, point.first, point.count, point.number)
        daemon.launch()
        if not self.is_up(daemon):
            return None
        player = Player(daemon)
        for index, (method, params) in enumerate(script.asked):
            if index == script.setup > 0:
                control.arm(point.kind, point.first, point.count, point.number)
            player.ask(index, method, params)
        control.disarm()
        return player

    def try_point(self, point: Point) -> str:
        """What is wrong with how the daemon took it, or nothing."""
        daemon, control = self.begin()
        script = self.scripts[point.script]
        try:
            player = self.play(daemon, control, script, point)
            if player is not None:
                self.check(daemon, player, script, point)
            else:  # it may, with a sentence (for want of libuv's threads: by an abort)
                expect(daemon.process.returncode == 1 and daemon.tail()
                       or daemon.process.returncode == -signal.SIGABRT and point.kind == MEMORY,
                       f"it could not start: {daemon.process.returncode}, {daemon.tail()}")
                control.disarm()
                daemon.start()
                daemon.stop()
        except Failed as failure:
            return f"{point}: {failure}"
        except Exception as error:  # a broken stream is a finding like the others
            return f"{point}: {type(error).__name__}: {error}"
        finally:
            control.disarm()
            daemon.kill()
        shutil.rmtree(daemon.folder, ignore_errors=True)
        return ""

    @staticmethod
    def is_up(daemon: Daemon) -> bool:
        """Whether it says that it serves, and not that it gives up."""
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            if b"listening on" in daemon.log.read_bytes():
                return True
            if daemon.process.poll() is not None:
                return False
            time.sleep(0.001)
        raise Failed("it neither serves nor ends")

    def check(self, daemon: Daemon, player: Player, script: Script, point: Point) -> None:
        link = player.reconnect()
        held = self.held(link, script)
        wanted = self.reference(script, player.played.done)
        expect(held == wanted, "it holds something else than what it answered; refused were "
                               f"{player.played.refused}")
        who, info = {"session": script.session}, {}
        if held != "nothing":
            info = link.call("session.info", who)
            wait_for_journal(link, who)
        if point.first % 2:
            daemon.kill()
        else:
            daemon.stop()
        daemon.environment = {key: value for key, value in daemon.environment.items()
                              if key != "LD_PRELOAD"}
        if player.played.comes_back is not None and held == "nothing":
            wanted = self.reference(script, player.played.comes_back)
        with daemon.start().link() as again:
            expect(self.held(again, script) == wanted, "after a restart it holds something else")
            after = again.call("session.info", who) if info else {}
            for key in ("revision", "undo_steps", "redo_steps") if info else ():
                expect(after[key] == info[key], f"after a restart {key} is {after[key]}, was "
                                                f"{info[key]}")
        daemon.stop()
        out = daemon.folder / "out.glb"
        if out.exists():
            expect(out.read_bytes()[:4] == b"glTF" and out.stat().st_size == struct.unpack(
                "<I", out.read_bytes()[8:12])[0], "half of an export was left")
        left = [path.name for path in daemon.folder.iterdir() if "tmp" in path.name]
        expect(not left or point.count > 1, f"left behind: {left}")  # nothing can be removed then


def choose(lab: Lab) -> list[Point]:
    """Every point of every script: alone, and some with all that follows."""
    points: list[Point] = []
    for script in lab.scripts.values():
        memory, files = lab.count(script)
        lab.yard.say(f"  {script.name}: {memory} allocations, {files} changes of files")
        for n in range(1, files + 1):
            points.append(Point(script.name, FILES, n, 1, (errno.ENOSPC, errno.EIO)[n % 2]))
        points += [Point(script.name, FILES, n, 1 << 40) for n in range(1, files + 1, 16)]
        points += [Point(script.name, MEMORY, n) for n in range(1, memory + 1)]
        points += [Point(script.name, MEMORY, n, 6) for n in range(1, memory + 1, 24)]
    return points


def measure(yard: Yard, seconds: float) -> dict:
    lab = Lab(yard)
    points = choose(lab)
    if yard.quick:
        points = points[::max(1, len(points) // 100)]
    failures, began = Failures(yard), time.monotonic()
    workers = 16 * len(os.sched_getaffinity(0))  # they wait for journals to be tried again
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("fork"))
    try:
        for index, why in enumerate(pool.map(lab.try_point, points, chunksize=4)):
            if why:
                failures.add(why)
            spent = time.monotonic() - began
            if index % 2000 == 1999:
                yard.say(f"  {index + 1} of {len(points)} points in {spent:.0f} s, "
                         f"{failures.count} failed")
            expect(spent < 1.5 * seconds or yard.quick,
                   f"only {index + 1} of {len(points)} points in {spent:.0f} s, "
                   f"{failures.count} of them failed")
    finally:
        pool.shutdown(cancel_futures=True)
    return {"fault_points": len(points), "fault_failed": failures.count}
