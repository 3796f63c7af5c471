"""Files are parsed in a process of their own: what it finds is what one process would find, and
whatever happens to it is one error to one client."""

from __future__ import annotations

import mmap
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Callable

import numpy as np
import pytest
import rigs
from core import Link, SkindError
from daemons import BIN, Daemon

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracle"))

import rig_lib  # noqa: E402

SECONDS = 30.0  # generous: the sanitizer builds are slow on a busy machine


def generate(path: Path, vertices: int) -> Path:
    subprocess.run([BIN / "skinctl", "generate", "--vertices", str(vertices), path], check=True,
                   capture_output=True, timeout=300)
    return path


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that takes long enough to be met while it is read."""
    return generate(tmp_path_factory.mktemp("large") / "large.glb", 300_000)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generate(tmp_path_factory.mktemp("small") / "small.glb", 2000)


def children(process: int) -> list[int]:
    """Processes whose parent this is."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
            except OSError:
                continue
            if int(stat.rpartition(")")[2].split()[1]) == process:
                found.append(int(entry.name))
    return found


def name_of(process: int) -> str:
    try:
        return Path(f"/proc/{process}/comm").read_text().strip()
    except OSError:
        return ""


def catch(daemon: Daemon) -> int:
    """The daemon's import process, stopped, with its limits lowered already."""
    deadline = time.monotonic() + SECONDS
    while time.monotonic() < deadline:
        for child in children(daemon.process.pid):
            if name_of(child) == "skind-import":  # a name that it takes once its limits are set
                os.kill(child, signal.SIGSTOP)
                return child
    raise AssertionError("no import process was seen")


class Held:
    """A session.create whose process is stopped in the middle."""

    def __init__(self, daemon: Daemon, path: Path) -> None:
        self.link = daemon.link()
        self.id = self.link.send("session.create", {"file": str(path), "name": "held"})
        self.process = catch(daemon)

    def error(self) -> SkindError:
        with pytest.raises(SkindError) as caught:
            self.link.wait(self.id, timeout=SECONDS)
        return caught.value


@pytest.fixture
def hold(daemon: Daemon) -> Callable[[Path], Held]:
    return lambda path: Held(daemon, path)


def gone(process: int) -> bool:
    deadline = time.monotonic() + SECONDS
    while time.monotonic() < deadline:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


def assert_unharmed(link: Link, path: Path) -> None:
    """The name is free again, and the next file is read."""
    made = link.call("session.create", {"file": str(path), "name": "held"})
    assert made["vertices"] == 2000


@pytest.mark.parametrize("name", rig_lib.asset_paths())
def test_same_as_in_one_process(daemon: Daemon, folder: Path, name: str) -> None:
    """rig_probe reads the file by itself; the daemon's session is made of the same bits, and an
    unchanged export is the file again."""
    path, link = rig_lib.ASSETS / name, daemon.link()
    alone = rig_lib.probe("load", path)
    if alone["status"] != "ok":
        with pytest.raises(SkindError) as caught:
            link.call("session.create", {"file": str(path)})
        assert (caught.value.name, caught.value.message) == (alone["status"], alone["text"])
        return
    rig = rig_lib.load(path, folder)
    slots = min(max(4, rig.summary["most"]), 8)
    made = link.call("session.create", {"file": str(path), "name": "s", "influences": slots,
                                        "reduce": "largest"})
    assert {note["name"]: note["count"] for note in made.get("notes", [])} == rig.summary["notes"]
    mesh = link.call("mesh.get", {"session": "s"})
    assert mesh["rest"].tobytes() == rig.arrays["rest"].tobytes()
    assert mesh["triangles"].tobytes() == rig.arrays["triangles"].tobytes()
    if rig.summary["most"] <= slots:
        weights = link.call("weights.get", {"session": "s"})
        joints, expected = rig.rows(slots)
        for slot in range(slots):  # the fill adds bones that weigh nothing, wherever it likes
            hit = (weights["joints"] == joints[:, slot, None]) & (expected[:, slot, None] > 0)
            found = np.where(hit, weights["weights"], 0).sum(1, dtype=np.float32)
            assert (found == expected[:, slot]).all()
        target = folder / path.name
        link.call("session.export", {"session": "s", "path": str(target)})
        if not rig.summary["notes"]:  # what was mended is written
            assert target.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("number, status, words", [
    (signal.SIGSEGV, "bad_rig", "reading"), (signal.SIGABRT, "bad_rig", "reading"),
    (signal.SIGKILL, "too_large", "out of memory"), (signal.SIGXCPU, "too_large", "seconds"),
])
def test_crash(hold: Callable[[Path], Held], large: Path, small: Path, number: signal.Signals,
               status: str, words: str) -> None:
    held = hold(large)
    os.kill(held.process, number)
    os.kill(held.process, signal.SIGCONT)
    error = held.error()
    assert error.name == status and words in error.message and str(large) in error.message
    assert gone(held.process)
    assert_unharmed(held.link, small)


def test_what_was_read_is_still_in_use(hold: Callable[[Path], Held], large: Path,
                                       small: Path) -> None:
    """Somebody else could still change the image: it is not the file's fault."""
    held = hold(large)
    [memory] = [entry for entry in Path(f"/proc/{held.process}/fd").iterdir()
                if "memfd" in os.readlink(entry)]
    with memory.open("r+b") as file:
        file.truncate(mmap.PAGESIZE)
        with mmap.mmap(file.fileno(), mmap.PAGESIZE):
            os.kill(held.process, signal.SIGCONT)
            error = held.error()
    assert error.name == "busy" and "again" in error.message
    assert_unharmed(held.link, small)


def test_no_more_memory(hold: Callable[[Path], Held], large: Path, small: Path) -> None:
    """Its image is larger than it may be, as when its own limit is the lower one."""
    held = hold(large)
    resource.prlimit(held.process, resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
    os.kill(held.process, signal.SIGCONT)
    error = held.error()
    assert error.name == "too_large" and "more memory" in error.message
    assert_unharmed(held.link, small)


def test_others_do_not_wait(start: Callable[..., Daemon], large: Path, small: Path) -> None:
    """With one worker and one import that hangs: others are answered, sculpt and load."""
    daemon = start("--workers", "1")
    held, other = Held(daemon, large), daemon.link()
    other.call("ping")
    other.call("session.create", {"name": "sheet", **rigs.sheet(400)})
    other.call("pose.set", {"session": "sheet", "pose": "bent"},
               {"matrices": rigs.bent(0.2)})
    other.call("stroke.apply", {"session": "sheet", "pose": "bent", "vertices": [1, 2],
                                "positions": [[0.0, 0.1, 0.0], [0.1, 0.1, 0.1]]})
    other.call("session.create", {"file": str(small), "name": "small"})
    other.call("session.close", {"session": "small"})
    os.kill(held.process, signal.SIGCONT)
    assert held.link.wait(held.id, timeout=SECONDS)["vertices"] == 300_000


def test_cancel(hold: Callable[[Path], Held], large: Path, small: Path) -> None:
    held = hold(large)
    held.link.cancel(held.id)
    assert held.error().name == "cancelled"
    assert gone(held.process)
    assert_unharmed(held.link, small)


def test_stop_ends_an_import(daemon: Daemon, large: Path) -> None:
    held = Held(daemon, large)
    assert daemon.stop() == 0
    assert gone(held.process)


def test_dies_with_the_daemon(daemon: Daemon, large: Path) -> None:
    held = Held(daemon, large)
    daemon.stop(signal.SIGKILL)
    assert gone(held.process)


def test_what_it_may(hold: Callable[[Path], Held], large: Path) -> None:
    """Limits on time, memory, files and processes; no descriptor of the daemon's; no new rights."""
    held = hold(large)
    limit = {what: resource.prlimit(held.process, what)
             for what in (resource.RLIMIT_CPU, resource.RLIMIT_FSIZE, resource.RLIMIT_NOFILE,
                          resource.RLIMIT_NPROC, resource.RLIMIT_CORE)}
    assert all(hard != resource.RLIM_INFINITY for _, hard in limit.values())
    assert limit[resource.RLIMIT_NPROC] == limit[resource.RLIMIT_CORE] == (0, 0)
    assert limit[resource.RLIMIT_NOFILE][1] <= 128
    status = Path(f"/proc/{held.process}/status").read_text()
    assert "NoNewPrivs:\t1" in status
    targets = [os.readlink(entry) for entry in Path(f"/proc/{held.process}/fd").iterdir()]
    assert not [target for target in targets if "socket" in target or ".skind" in target]
    held.link.cancel(held.id)
    assert held.error().name == "cancelled"


def test_many_at_once(daemon: Daemon, small: Path) -> None:
    """More than there are places for, from several clients; one of them is no file."""
    names: list[str] = []
    refused: list[str] = []

    def load(index: int) -> None:
        link = daemon.link(checked=False)
        ids = [link.send("session.create", {"file": str(small)}) for _ in range(4)]
        broken = link.send("session.create", {"file": f"/nowhere/{index}.glb"})
        names.extend(link.wait(id, timeout=SECONDS)["session"] for id in ids)
        with pytest.raises(SkindError) as caught:
            link.wait(broken, timeout=SECONDS)
        refused.append(caught.value.name)

    threads = [threading.Thread(target=load, args=[index]) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(names)) == 16 and refused == ["no_file"] * 4
    assert not children(daemon.process.pid)
