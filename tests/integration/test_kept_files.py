"""The files of the state folder: which of them count, which go, and what is said of the others."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import struct
import subprocess
import time
from pathlib import Path
from typing import Callable, Iterator

import numpy as np
import pytest
import rigs
from core import Link, SkindError
from daemons import BIN, Daemon
from test_durability import contents, make, stroke

MIB = 1 << 20
CLOSED = 32  # that are remembered


@pytest.fixture
def state(folder: Path) -> Path:
    return folder / "state"


@pytest.fixture
def begin(start, state) -> Callable[[], Daemon]:
    return lambda: start("--state", str(state))


def make_small(link: Link, name: str) -> None:
    """A session with a step, in as little time as may be."""
    link.call("session.create", {"name": name, **rigs.sheet(16)})
    link.call("weights.prune", {"session": name, "below": 0.5})


def names(link: Link) -> dict[str, int]:
    return {item["session"]: item["revision"] for item in link.call("session.list")["sessions"]}


def closed(link: Link) -> list[str]:
    return [item["session"] for item in link.call("session.list")["closed"]]


def file_of(state: Path, name: str) -> Path:
    [path] = state.glob(f"{name}-*.skind")
    return path


# ---- closed ones -----------------------------------------------------------------------------

@pytest.mark.parametrize("days", [30, -30])
def test_who_is_closed_now_is_the_newest(begin, state, days) -> None:
    """However long ago its file was written; and where the clock was ahead and is right again."""
    daemon = begin()
    with daemon.link(checked=False) as link:
        make_small(link, "old")
        for number in range(CLOSED):
            make_small(link, f"s{number}")
            link.call("session.close", {"session": f"s{number}"})
    daemon.stop()
    for path in (state.glob("old-*") if days > 0 else (state / "closed").iterdir()):
        os.utime(path, (time.time() - 86400 * days,) * 2)
    daemon = begin()
    with daemon.link() as link:
        link.call("session.close", {"session": "old"})
        assert closed(link)[0] == "old" and len(closed(link)) == CLOSED
        assert link.call("session.open", {"closed": "old"})["revision"] == 1


def test_closing_what_is_not_kept_forgets_nothing(begin) -> None:
    with begin().link(checked=False) as link:
        for number in range(CLOSED):
            make_small(link, f"s{number}")
            link.call("session.close", {"session": f"s{number}"})
        link.call("session.create", {"name": "empty", **rigs.sheet(16)})
        link.call("session.close", {"session": "empty"})
        assert len(closed(link)) == CLOSED


# ---- two files of one session ------------------------------------------------------------------

def twin(path: Path) -> Path:
    """As a daemon that dies while it writes a file anew leaves it."""
    other = path.with_name(path.name[:-len("0123456789abcdef.skind")] + "f" * 16 + ".skind")
    shutil.copy(path, other)
    return other


@pytest.mark.parametrize("durability", ["full", "second"])
def test_of_two_files_the_older_goes(begin, state, durability) -> None:
    daemon = begin()
    with daemon.link() as link:
        make(link, durability=durability)
        stroke(link, 1)
        daemon.stop()
    older = twin(file_of(state, "sheet")).read_bytes()
    shutil.rmtree(state / "closed")
    (state / "closed").mkdir(mode=0o700)
    daemon = begin()
    with daemon.link() as link:
        assert names(link) == {"sheet": 1} and closed(link) == []
        assert file_of(state, "sheet").read_bytes() == older
        link.call("session.delete", {"session": "sheet"})
    daemon.stop()
    with begin().link() as link:
        assert names(link) == {} and closed(link) == []


def test_another_line_of_the_same_name_is_not_thrown_away(begin, state, folder) -> None:
    """A session that is no more came back by hand, and one of its name is open."""
    daemon = begin()
    with daemon.link() as link:
        make(link)
        stroke(link, 1)
        older = contents(link)
        daemon.stop()
    path = file_of(state, "sheet")
    shutil.copy(path, folder)
    daemon = begin()
    with daemon.link() as link:
        link.call("session.delete", {"session": "sheet"})
        make(link)
        for seed in (2, 3):
            stroke(link, seed)
        newer = contents(link)
        daemon.stop()
    shutil.copy(folder / path.name, path)
    daemon = begin()
    with daemon.link() as link:
        assert contents(link) == newer and closed(link) == ["sheet"]
        link.call("session.open", {"closed": "sheet", "name": "older"})
        assert contents(link, "older") == older
        assert [entry.name for entry in state.glob("sheet-*")] == [file_of(state, "sheet").name]


def test_a_backup_in_the_folder_stays_and_is_told(begin, state) -> None:
    daemon = begin()
    with daemon.link() as link:
        make(link)
        stroke(link, 1)
        daemon.stop()
    backup = state / "backup.skind"
    shutil.copy(file_of(state, "sheet"), backup)
    before = backup.read_bytes()
    daemon = begin()
    with daemon.link() as link:
        assert names(link) == {"sheet": 1}
        [told] = link.call("session.list")["damaged"]
        assert told["file"] == "backup.skind" and "\"sheet\" already" in told["text"]
        again = link.call("session.open", {"path": str(backup), "name": "again"})
        assert again["revision"] == 1
    assert backup.read_bytes() == before


# ---- damaged ones ------------------------------------------------------------------------------

def test_what_is_not_opened_is_told(begin, state) -> None:
    daemon = begin()
    with daemon.link() as link:
        for name in ("good", "newer", "gone"):
            make(link, name)
            stroke(link, 1, name)
        daemon.stop()
    with sqlite3.connect(file_of(state, "newer")) as file:
        file.execute("pragma user_version = 99")
    file.close()
    file_of(state, "gone").write_bytes(b"rubbish" * 1000)
    with begin().link() as link:
        assert names(link) == {"good": 1}
        newer, gone = link.call("session.list")["damaged"]
        assert newer["file"].startswith("newer-") and "later skind" in newer["text"]
        assert "\"gone\"" in gone["text"] and "if anything" in gone["text"]


@pytest.mark.parametrize("commits", [False, True])
def test_a_log_that_ends_in_the_middle(begin, state, commits) -> None:
    """Frames whose sums are wrong, of what a kill broke off, or of what was done."""
    daemon = begin()
    with daemon.link() as link:
        make(link)
        stroke(link, 1)
        before = contents(link)
        daemon.stop(signal.SIGKILL)
    log = Path(f"{file_of(state, 'sheet')}-wal")
    head = log.read_bytes()[:32]
    page = struct.unpack_from(">I", head, 8)[0]
    assert (log.stat().st_size - 32) % (24 + page) == 0
    with log.open("ab") as file:
        for pages in (0, 0, 40 if commits else 0):
            file.write(struct.pack(">II8sII", 2, pages, head[16:24], 1, 2) + bytes([7]) * page)
    with begin().link() as link:
        after = contents(link)
        assert after["weights"] == before["weights"]
        assert (after == before) != commits
        assert bool(link.call("session.list")["damaged"]) == commits
        assert ("damage" in link.call("session.info", {"session": "sheet"})) == commits


def test_a_file_does_not_grow_with_every_start(begin, state) -> None:
    """What cannot be undone any more goes, also where the daemon never runs for long."""
    count, limit = 40_000, 100 * MIB
    rows = {"session": "sheet", "vertices": np.arange(count, dtype=np.uint32),
            "joints": np.tile(np.array([0, 1, 65535, 65535], np.uint16), (count, 1))}
    random = np.random.default_rng(3)
    for number in range(5):
        daemon = begin()
        with daemon.link(checked=False) as link:
            if number == 0:
                link.call("session.create", {"name": "sheet", **rigs.sheet(count),
                                             "history_bytes": MIB})
            for _ in range(40):
                weights = np.zeros((count, 4), np.float32)
                weights[:, 0] = random.random(count, np.float32)
                weights[:, 1] = 1 - weights[:, 0]
                link.call("weights.set", {**rows, "weights": weights})
                assert sum(path.stat().st_size for path in state.glob("sheet-*")) < limit
            link.call("session.verify", {"session": "sheet"})
            before = link.call("weights.get", {"session": "sheet"})["weights"]
            daemon.stop(signal.SIGKILL)
    with begin().link() as link:
        assert names(link) == {"sheet": 200}
        assert np.array_equal(link.call("weights.get", {"session": "sheet"})["weights"], before)


@pytest.fixture
def disk(folder: Path) -> Iterator[Path]:
    """A small disk of its own."""
    path = folder / "disk"
    path.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m,mode=700", "none", path],
                          capture_output=True)
    if made.returncode != 0:
        pytest.skip("only root can make a small disk")
    yield path
    subprocess.run(["umount", "-l", path], check=True)


def fill(disk: Path) -> Path:
    room = os.statvfs(disk)
    (disk / "fill").write_bytes(bytes(room.f_bavail * room.f_bsize))
    return disk / "fill"


def wait_for(link: Link, word: str) -> None:
    deadline = time.monotonic() + 40
    while link.call("session.list")["sessions"][0]["journal"] != word:
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_damaged_file_on_a_full_disk(start, disk) -> None:
    """It is used as far as it is whole, and once there is room only what came of it is left."""
    state = disk / "state"
    daemon = start("--state", str(state))
    with daemon.link() as link:
        make(link)
        for seed in range(6):
            stroke(link, seed)
        daemon.stop(signal.SIGKILL)
    log = Path(f"{file_of(state, 'sheet')}-wal")
    torn = bytearray(log.read_bytes())
    torn[-9000] ^= 1
    log.write_bytes(torn)
    filler = fill(disk)
    daemon = start("--state", str(state))
    with daemon.link() as link:
        wait_for(link, "suspended")
        [before] = names(link).values()
        assert 0 < before < 6 and len(link.call("session.list")["damaged"]) == 1
        stroke(link, 8)
        filler.unlink()
        wait_for(link, "ok")
        held = contents(link)
        daemon.stop(signal.SIGKILL)
    daemon = start("--state", str(state))
    with daemon.link() as link:
        assert contents(link) == held and len(link.call("session.list")["damaged"]) == 1
        link.call("session.delete", {"session": "sheet"})
        daemon.stop(signal.SIGKILL)
    with start("--state", str(state)).link() as link:
        assert names(link) == {}


def test_a_full_disk_leaves_what_was_saved_and_exported(start, folder, disk) -> None:
    subprocess.run([BIN / "skinctl", "generate", "--vertices", "20000", folder / "body.glb"],
                   check=True, capture_output=True, timeout=60)
    for name in ("body.skind", "body.glb"):
        (disk / name).write_bytes(b"old")
    with start().link() as link:
        link.call("session.create", {"file": str(folder / "body.glb"), "name": "body"})
        filler = fill(disk)
        filler.write_bytes(filler.read_bytes()[:-500_000])
        for method, name in (("save", "body.skind"), ("export", "body.glb")):
            with pytest.raises(SkindError) as refused:
                link.call(f"session.{method}", {"session": "body", "path": str(disk / name)})
            assert refused.value.name == "file_io"
            assert name in refused.value.message and ".tmp" not in refused.value.message
            assert (disk / name).read_bytes() == b"old"
    assert sorted(path.name for path in disk.iterdir()) == ["body.glb", "body.skind", "fill"]


@pytest.mark.parametrize("method", ["save", "export"])
def test_what_a_kill_left_beside_a_file_goes_in_time(start, folder, method) -> None:
    subprocess.run([BIN / "skinctl", "generate", "--vertices", "2000", folder / "body.glb"],
                   check=True, capture_output=True, timeout=60)
    path = folder / "out" / ("body.skind" if method == "save" else "body.glb")
    (path.parent / ".skind-0123456789abcdef.tmp.d").mkdir(parents=True)
    others = [".skind-0000000000000000.tmp", ".skind-notes", "other.tmp", ".skind-link.tmp"]
    for name in (*others[:3], ".skind-0123456789abcdef.tmp", ".skind-0123456789abcdef.tmp-wal"):
        (path.parent / name).write_bytes(b"left")
        if name != others[0]:  # of one that is at work now
            os.utime(path.parent / name, (time.time() - 7200,) * 2)
    (path.parent / others[3]).symlink_to("nowhere")
    with start().link() as link:
        link.call("session.create", {"file": str(folder / "body.glb"), "name": "body"})
        link.call(f"session.{method}", {"session": "body", "path": str(path)})
    assert {entry.name for entry in path.parent.iterdir()} == {
        path.name, ".skind-0123456789abcdef.tmp.d", *others}


def test_a_file_that_cannot_be_opened_is_named_once(daemon, folder) -> None:
    rubbish = folder / "rubbish.skind"
    rubbish.write_bytes(b"rubbish" * 1000)
    (folder / "link.skind").symlink_to(rubbish)
    with daemon.link() as link:
        for path, words in ((rubbish, "no session's file"),
                            (folder / "link.skind", "name the file")):
            with pytest.raises(SkindError) as refused:
                link.call("session.open", {"path": str(path)})
            assert refused.value.message.count(str(path)) == 1 and words in refused.value.message


# ---- what people do to the folder ----------------------------------------------------------------

def test_nothing_is_saved_over_the_file_of_an_open_session(begin, state, folder) -> None:
    daemon = begin()
    (folder / "way").symlink_to(state)
    with daemon.link() as link:
        make(link)
        make(link, "other")
        own = file_of(state, "sheet")
        for path in (own, state / "new.skind", state / "closed" / "new.skind",
                     folder / "way" / own.name, folder / "state" / ".." / "state" / own.name):
            for name in ("sheet", "other"):
                with pytest.raises(SkindError) as refused:
                    link.call("session.save", {"session": name, "path": str(path)})
                assert "elsewhere" in refused.value.message
        stroke(link, 1)
        assert link.call("session.verify", {"session": "sheet"})["ok"]
        before = contents(link)
    daemon.stop(signal.SIGKILL)
    with begin().link() as link:
        assert contents(link) == before
