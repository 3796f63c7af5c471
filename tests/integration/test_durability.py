"""What outlives a daemon: sessions, their history, their poses and pins; and their files."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import sqlite3
import stat
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
from core import SkindError
from daemons import Daemon

ANGLES = {"bent": 0.3, "back": -0.25}


def make(link, name: str = "sheet", **options) -> dict:
    made = link.call("session.create", {"name": name, **rigs.sheet(900), **options})
    for pose, angle in ANGLES.items():
        link.call("pose.set", {"session": name, "pose": pose, "matrices": rigs.bent(angle)})
    return made


def stroke(link, seed: int, name: str = "sheet", pose: str = "bent", radius: float = 0.15,
           **options) -> dict:
    rng = np.random.default_rng(seed)
    posed = link.call("pose.evaluate", {"session": name, "pose": pose})["positions"]
    vertices, targets = rigs.bump(posed, int(rng.integers(900)), radius, rng.uniform(-0.02, 0.02))
    return link.call("stroke.apply", {"session": name, "pose": pose, "vertices": vertices,
                                      "positions": targets, **options})


def contents(link, name: str = "sheet") -> dict:
    """All that a session holds, to the bit."""
    held = {}
    weights = link.call("weights.get", {"session": name})
    held["joints"], held["weights"] = weights["joints"].tobytes(), weights["weights"].tobytes()
    held["rest"] = link.call("mesh.get", {"session": name})["rest"].tobytes()
    for kind in ("pins", "shapes"):
        for item in link.call(f"{kind}.list", {"session": name})[kind]:
            rows = link.call(f"{kind}.get", {"session": name, "pose": item["pose"]})
            held[kind, item["pose"]] = {key: value.tobytes() for key, value in rows.items()
                                        if isinstance(value, np.ndarray)}
    held["guard"] = link.call("guard.get", {"session": name})["poses"]
    for pose in ("rest", *ANGLES):
        held["pose", pose] = link.call("pose.evaluate",
                                       {"session": name, "pose": pose})["positions"].tobytes()
    info = link.call("session.info", {"session": name})
    for key in ("revision", "instance", "undo_steps", "redo_steps", "exported", "durability",
                "history_bytes", "notes"):
        held[key] = info[key]
    return held


def work(link, name: str = "sheet") -> None:
    """Something of everything that a session can hold."""
    link.call("guard.set", {"session": name, "poses": ["back"]})
    for seed in range(3):
        stroke(link, seed, name, pin="set")
    stroke(link, 7, name, pose="back", slots="evidence", pin="move")
    stroke(link, 8, name, residual="shape")
    for seed in (1, 1):
        stroke(link, seed, name, pose="back", residual="rest", pin="set")
    link.call("weights.prune", {"session": name, "below": 0.05})
    link.call("weights.mirror", {"session": name, "origin": 0.5})
    for _ in range(4):
        link.call("history.undo", {"session": name})
    link.call("history.redo", {"session": name})


@pytest.mark.parametrize("durability", ["full", "second"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_a_session_outlives_its_daemon(start, durability, end) -> None:
    daemon = start()
    with daemon.link() as link:
        make(link, durability=durability)
        work(link)
        before = contents(link)
        if durability == "second" and end == signal.SIGKILL:
            time.sleep(1.5)  # what it promises
    daemon.stop(end)
    daemon = start()
    with daemon.link() as link:
        if durability == "second":
            del before["instance"]  # answers may have been lost: it is another line of revisions
        assert {key: contents(link)[key] for key in before} == before
        undone = 0
        states = [before["weights"]]
        while link.call("session.info", {"session": "sheet"})["undo_steps"]:
            link.call("history.undo", {"session": "sheet"})
            states.append(contents(link)["weights"])
            undone += 1
        assert undone == before["undo_steps"]
        for state in reversed(states[:-1]):
            link.call("history.redo", {"session": "sheet"})
            assert contents(link)["weights"] == state
        while link.call("session.info", {"session": "sheet"})["redo_steps"]:
            link.call("history.redo", {"session": "sheet"})
        assert stroke(link, 5)["revision"] > before["revision"]


def test_a_session_from_a_file_outlives_the_file(start, folder) -> None:
    """Exported over its source, and the source then removed: the next daemon exports still."""
    import subprocess

    from daemons import BIN
    path = folder / "body.glb"
    subprocess.run([BIN / "skinctl", "generate", "--vertices", "2000", path], check=True,
                   capture_output=True)
    daemon = start()
    with daemon.link() as link:
        name = link.call("session.create", {"file": str(path)})["session"]
        link.call("pose.set", {"session": name, "pose": "bent", "clip": "bend", "time": 0.5})
        posed = link.call("pose.evaluate", {"session": name, "pose": "bent"})["positions"]
        vertices, targets = rigs.bump(posed, 500, 0.2, 0.02)
        link.call("stroke.apply", {"session": name, "pose": "bent", "vertices": vertices,
                                   "positions": targets})
        link.call("session.export", {"session": name, "path": str(path)})
        link.call("session.export", {"session": name, "path": str(folder / "one.glb")})
        info = link.call("session.info", {"session": name})
    daemon.stop(signal.SIGKILL)
    path.unlink()
    with start().link() as link:
        again = link.call("session.info", {"session": name})
        for key in ("clips", "bones", "parts", "notes", "length", "source", "triangles"):
            assert again[key] == info[key]
        link.call("session.export", {"session": name, "path": str(folder / "two.glb")})
    assert (folder / "one.glb").read_bytes() == (folder / "two.glb").read_bytes()


def test_off_is_not_kept(start) -> None:
    daemon = start()
    with daemon.link() as link:
        assert make(link, durability="off")["durability"] == "off"
        stroke(link, 1)
        assert link.call("session.info", {"session": "sheet"})["journal"] == "off"
    daemon.stop()
    with start().link() as link:
        assert link.call("session.list")["sessions"] == []


def test_durability_can_be_changed(start) -> None:
    daemon = start()
    with daemon.link() as link:
        make(link, durability="off")
        stroke(link, 1)
        answer = link.call("session.set", {"session": "sheet", "durability": "full"})
        assert answer["durability"] == "full"
        stroke(link, 2)
        before = contents(link)
        make(link, "other")
        stroke(link, 3, "other")
        link.call("session.set", {"session": "other", "durability": "off"})  # answered when its file is gone
    daemon.stop(signal.SIGKILL)
    with start().link() as link:
        assert [item["session"] for item in link.call("session.list")["sessions"]] == ["sheet"]
        assert contents(link) == before


def test_history_is_bounded_and_says_so(start) -> None:
    daemon = start()
    with daemon.link() as link:
        make(link, history_bytes=1 << 20)
        for seed in range(120):
            stroke(link, seed, radius=0.8, pin="set")
        before = contents(link)
        info = link.call("session.info", {"session": "sheet"})
        assert info["history_used"] <= 1 << 20 and 1 < info["undo_steps"] < 120
    daemon.stop(signal.SIGKILL)
    with start().link() as link:
        assert contents(link) == before


def test_save_open_fork_delete(start, folder) -> None:
    daemon = start()
    path = folder / "saved.skind"
    with daemon.link() as link:
        make(link)
        work(link)
        before = contents(link)
        saved = link.call("session.save", {"session": "sheet", "path": str(path)})
        assert saved["revision"] == before["revision"] and saved["bytes"] == path.stat().st_size
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        opened = link.call("session.open", {"path": str(path), "name": "again"})
        forked = link.call("session.fork", {"session": "sheet", "name": "fork"})
        assert len({before["instance"], opened["instance"], forked["instance"]}) == 3
        for name in ("again", "fork"):
            other = contents(link, name)
            assert {**other, "instance": None} == {**before, "instance": None}
        stroke(link, 11, "fork")
        assert contents(link) == before
        link.call("session.delete", {"session": "fork"})
        with pytest.raises(SkindError) as refused:
            link.call("session.delete", {"session": "fork"})
        assert refused.value.name == "no_session"
    daemon.stop(signal.SIGKILL)
    with start().link() as link:
        names = {item["session"] for item in link.call("session.list")["sessions"]}
        assert names == {"sheet", "again"}


def test_a_closed_session_can_be_opened_again(start) -> None:
    daemon = start()
    with daemon.link() as link:
        make(link)
        work(link)
        before = contents(link)
        link.call("session.close", {"session": "sheet"})
        make(link)  # the name is free at once
        link.call("session.close", {"session": "sheet"})  # nothing was done: nothing is kept
    daemon.stop()
    with start().link() as link:
        listed = link.call("session.list")
        assert listed["sessions"] == []
        assert [item["session"] for item in listed["closed"]] == ["sheet"]
        assert link.call("session.open", {"closed": "sheet"})["revision"] == before["revision"]
        assert contents(link) == before
        assert link.call("session.list")["closed"] == []


def test_verify(start, folder) -> None:
    daemon = start()
    path = folder / "saved.skind"
    with daemon.link() as link:
        make(link)
        work(link)
        live = link.call("session.verify", {"session": "sheet"})
        assert live["ok"] and live["problems"] == [] and live["steps"] > 3
        stroke(link, 3)  # it goes on being kept
        link.call("session.save", {"session": "sheet", "path": str(path)})
        assert link.call("session.verify", {"path": str(path)})["ok"]
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0x40
        path.write_bytes(data)
        assert not link.call("session.verify", {"path": str(path)})["ok"]
        path.write_bytes(b"not one of ours")
        with pytest.raises(SkindError):
            link.call("session.open", {"path": str(path)})
        before = contents(link)
    daemon.stop(signal.SIGKILL)
    with start().link() as link:
        assert contents(link) == before


def state_of(folder: Path) -> Path:
    return folder / "state"


def test_a_damaged_file_is_set_aside(start, folder) -> None:
    state = state_of(folder)
    daemon = start("--state", str(state))
    with daemon.link() as link:
        for name in ("good", "bad"):
            make(link, name)
            stroke(link, 4, name)
        good = contents(link, "good")
    daemon.stop()
    [bad] = state.glob("bad-*.skind")
    bad.write_bytes(bad.read_bytes()[:5000])
    daemon = start("--state", str(state))
    with daemon.link() as link:
        listed = link.call("session.list")
        assert [item["session"] for item in listed["sessions"]] == ["good"]
        assert len(listed["damaged"]) == 1 and "bad" in listed["damaged"][0]["file"]
        assert contents(link, "good") == good
    assert not list(state.glob("bad-*"))
    assert list((state / "damaged").glob("bad-*"))


def test_one_daemon_a_state_folder(start, folder) -> None:
    start("--state", str(state_of(folder)))
    second = Daemon(folder, "--state", str(state_of(folder)), socket=folder / "other.sock")
    assert second.process.wait(20) != 0
    assert "--state" in second.log.read_text()


def test_the_state_folder_is_ours_alone(start, folder) -> None:
    before = os.umask(0o777)
    try:
        start("--state", str(folder / "deep" / "state"))
    finally:
        os.umask(before)
    for path in (folder / "deep" / "state", folder / "deep" / "state" / "closed"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o700
    (folder / "link").symlink_to(folder)
    refused = Daemon(folder, "--state", str(folder / "link"), socket=folder / "other.sock")
    assert refused.process.wait(20) == 1
    assert "symlink" in refused.log.read_text()


@contextlib.contextmanager
def full_disk(daemon):
    """The daemon's files may not grow; yields how to make room again."""
    limits = resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, (4096, limits[1]))
    yield lambda: resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, limits)


def test_a_full_disk_suspends_and_resumes(start) -> None:
    """The disk is full for a while: strokes go on, everybody is told, nothing is missing after."""
    daemon = start()
    with daemon.link() as link, daemon.link(name="other") as other:
        make(link)
        stroke(link, 1)
        with full_disk(daemon) as make_room:
            for seed in range(2, 6):
                stroke(link, seed)
            other.pump(0.5)
            told = [message for message in other.notifications
                    if message.method == "journal.suspended"]
            assert len(told) == 1 and told[0].params["session"] == "sheet"
            assert link.call("session.info", {"session": "sheet"})["journal"] == "suspended"
            link.call("pose.set", {"session": "sheet", "pose": "late", "matrices": rigs.bent(0.1)})
            make_room()
        deadline = time.monotonic() + 40
        while link.call("session.info", {"session": "sheet"})["journal"] != "ok":
            assert time.monotonic() < deadline
            time.sleep(0.1)
        other.pump(0.2)
        assert any(message.method == "journal.resumed" for message in other.notifications)
        stroke(link, 9)
        before = contents(link)
    daemon.stop(signal.SIGKILL)
    with start().link() as link:
        assert contents(link) == before
        assert "late" in link.call("session.info", {"session": "sheet"})["poses"]


def test_closing_waits_until_it_is_on_the_disk(start) -> None:
    """Found: who closed a suspended session lost what came after the suspension, and the session
    was open again at the next start."""
    daemon = start()
    with daemon.link() as link:
        make(link)
        with full_disk(daemon) as make_room:
            stroke(link, 1)
            with pytest.raises(SkindError, match="stays open, because it is not on the disk") as no:
                link.call("session.close", {"session": "sheet"})
            assert no.value.name == "file_io"
            before = contents(link)
            make_room()
            link.call("session.close", {"session": "sheet"})
    daemon.stop(signal.SIGKILL)
    with start().link() as link:
        assert link.call("session.list")["sessions"] == []
        link.call("session.open", {"closed": "sheet"})
        assert contents(link) == before


@pytest.mark.parametrize("has_room", [True, False])
def test_stopping_tries_once_more(start, has_room) -> None:
    """Found: a daemon that was stopped before the next try lost what came after the suspension."""
    daemon = start()
    with daemon.link() as link:
        make(link)
        kept = contents(link)
        with full_disk(daemon) as make_room:
            stroke(link, 1)
            before = contents(link)
            if has_room:
                make_room()
    assert daemon.stop() == 0
    assert ("is lost: " in daemon.log.read_text()) == (not has_room)
    with start().link() as link:
        assert contents(link) == (before if has_room else kept)
        assert len(link.call("session.list")["sessions"]) == 1


def test_a_full_disk_leaves_the_saved_file(start, folder) -> None:
    daemon = start()
    path = folder / "saved.skind"
    with daemon.link() as link:
        make(link)
        link.call("session.save", {"session": "sheet", "path": str(path)})
        before = path.read_bytes()
        stroke(link, 1)
        with full_disk(daemon) as make_room:
            with pytest.raises(SkindError) as refused:
                link.call("session.save", {"session": "sheet", "path": str(path)})
            make_room()
        assert refused.value.name == "file_io"
        assert path.read_bytes() == before
        assert [entry.name for entry in folder.glob("saved*")] == ["saved.skind"]


def test_an_older_file_is_brought_up_to_date(start, folder) -> None:
    """Version 1 did not know the person who made a step."""
    state = state_of(folder)
    daemon = start("--state", str(state))
    with daemon.link() as link:
        make(link)
        stroke(link, 1)
        before = contents(link)
    daemon.stop()
    [path] = state.glob("*.skind")
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.executescript("alter table steps drop column user; pragma user_version = 1")
    daemon = start("--state", str(state))
    with daemon.link() as link:
        assert contents(link) == before
        assert "damage" not in link.call("session.info", {"session": "sheet"})
        link.call("history.undo", {"session": "sheet", "own": False})
    daemon.stop()
    [path] = state.glob("*.skind")
    with contextlib.closing(sqlite3.connect(path)) as file:
        assert file.execute("pragma user_version").fetchone() == (2,)


def test_the_rest_pose_always_exists(start, folder) -> None:
    """Found: a damaged file could lose it with the other poses, and no stroke could be made in it."""
    state = state_of(folder)
    daemon = start("--state", str(state))
    with daemon.link() as link:
        make(link)
        rest = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
    daemon.stop()
    [path] = state.glob("*.skind")
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.executescript("delete from poses")
    with start("--state", str(state)).link() as link:
        info = link.call("session.info", {"session": "sheet"})
        assert info["poses"] == ["rest"] and "poses are lost" in info["damage"]
        after = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
        assert np.array_equal(after, rest)


def test_a_newer_file_is_refused_unharmed(start, folder) -> None:
    state = state_of(folder)
    daemon = start("--state", str(state))
    with daemon.link() as link:
        make(link)
        stroke(link, 1)
    daemon.stop()
    [path] = state.glob("*.skind")
    with contextlib.closing(sqlite3.connect(path)) as file:
        file.execute("pragma user_version = 99")
    before = path.read_bytes()
    daemon = start("--state", str(state))
    with daemon.link() as link:
        assert link.call("session.list")["sessions"] == []
    daemon.stop()
    assert path.read_bytes() == before
    assert "later skind" in daemon.log.read_text()
    copy = folder / "copy.skind"
    shutil.copy(path, copy)
    with start().link() as link:
        with pytest.raises(SkindError) as refused:
            link.call("session.open", {"path": str(copy)})
    assert refused.value.name == "newer"
