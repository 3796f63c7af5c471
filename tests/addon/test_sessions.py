"""Sessions in real Blenders without a window: the measure is issue 3's table of figures.

The daemon is started by the add-on itself, as for a user; the fixture `artists` looks afterwards
that none is left.
"""

from __future__ import annotations

import getpass
import os
import pickle
import signal
import subprocess
import time
from pathlib import Path
from typing import Iterator

import numpy as np
import pytest

from blenders import ASSETS, Blender
from characters import CHARACTERS
from daemons import BIN
from core import Link

REACHED = 1e-3  # of the length: what weights can do is done, this well
SAME = 1e-6  # of the length: float32 of a shape computed in two ways
EXPORTED = 1e-4  # Blender's exporter leaves out weights up to this
GONE_SECONDS = 10.0  # within this the daemon that nobody needs is gone
EXIT_SECONDS = 10.0  # a hang takes longer, however busy the machine is

needs_assets = pytest.mark.skipif(not ASSETS.is_dir(), reason="the shared assets are not here")


def daemons(socket: Path) -> list[int]:
    """The processes of skind that listen, or are about to listen, on this socket."""
    found = []
    for process in Path("/proc").iterdir():
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if Path(os.fsdecode(words[0])).name == "skind" and any(
                os.fsencode(socket) in word for word in words):
            found.append(int(process.name))
    return found


def wait_until_none(socket: Path) -> list[int]:
    end = time.monotonic() + GONE_SECONDS
    while daemons(socket) and time.monotonic() < end:
        time.sleep(0.02)
    return daemons(socket)


@pytest.fixture
def artists(blender: Blender, monkeypatch: pytest.MonkeyPatch) -> Iterator[Blender]:
    """A Blender whose add-on starts the daemon; it must be gone when the last one has quit."""
    monkeypatch.setenv("PATH", str(BIN), prepend=os.pathsep)
    yield blender
    blender.close()
    left = wait_until_none(blender.socket)
    for process in left:
        os.kill(process, signal.SIGKILL)
    assert left == [], "a daemon is left that nobody uses"


def wait_for(file: Path, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not file.exists():
        assert time.monotonic() < end, f"{file.name} did not come"
        time.sleep(0.02)


# ---- figures ----


def assert_figures(rows: list[dict]) -> None:
    """Of reachable strokes, those with a stiffness of 1e-3 or less come within REACHED."""
    for row in rows:
        assert row["changed"] > 0, row
        assert row["target"] <= SAME, row  # what Blender shows is what NumPy computes
        assert row["fresh"] > 0 and row["farther"] <= SAME, row
        assert row["energy"] <= SAME ** 2 + 2 * SAME * row["before"], row
        assert row["rest"] and row["equal"], row
        if row["sculpt"] == "shift" and row["stiffness"] <= 1e-3:
            assert row["before"] > REACHED, row
            assert row["after"] <= REACHED, row


def test_figures(artists: Blender) -> None:
    assert_figures(artists.run("sessions.figures", "tube", "", [10, 40, -60], [0.008, 1e-3]))


def test_figures_of_a_rigify_rig(artists: Blender) -> None:
    assert_figures(artists.run("sessions.figures", "rigify", "", [20, -35], [0.008, 1e-3]))


@needs_assets
def test_figures_of_imported_characters(artists: Blender) -> None:
    for character in CHARACTERS[3], CHARACTERS[6]:
        assert_figures(artists.run("sessions.figures", str(ASSETS / character.file),
                                   character.mesh, [15, -30], [0.008, 1e-3]))


# ---- undo and redo ----


def test_weights_are_the_daemons_after_any_sequence(artists: Blender) -> None:
    for seed in (1, 2):
        seen = artists.run("sessions.sequences", seed, 40)
        wrong = [(at, *step) for at, step in enumerate(seen) if step[1:] != (True, True)]
        assert wrong == []
        assert {what for what, *_ in seen} >= {"stroke", "undo", "redo", "withdraw", "forget"}


def test_undo_and_redo_of_a_stroke_that_waits(artists: Blender) -> None:
    facts = artists.run("sessions.withdrawn")
    assert facts == {"pending": 0, "undone": (True, True), "again": 1, "redone": (True, True),
                     "strokes": 1, "rest": True}


# ---- Start, Cancel, Finish ----


@needs_assets
def test_cancel_leaves_everything_as_it_was(artists: Blender) -> None:
    chosen = [CHARACTERS[index] for index in (1, 3, 5, 6, 7, 9, 11, 12)]
    answers = artists.run("sessions.cancelled", [
        (str(ASSETS / character.file), character.mesh) for character in chosen])
    for character, facts in zip(chosen, answers, strict=True):
        assert facts["at once"] == [], character
        assert facts["after strokes"] == [], character
        assert facts["strokes"] == (1, 1), character
        if facts["reduced"]["reduced"] == 0:
            assert facts["shown"] <= SAME, character
    assert answers[0]["reduced"]["reduced"] > 0


def test_finish_keeps_the_weights_alone(artists: Blender) -> None:
    facts = artists.run("sessions.finished")
    assert facts["strokes"] == 2 and facts["kept"] and facts["changed"]
    assert facts["different"] == ["entries", "groups"]  # bone.3 is needed now
    assert facts["padded"] == 8000
    assert facts["zeros"] == 0
    assert facts["entries"] < facts["padded"]
    assert facts["sessions"] == []


# ---- trouble ----


def test_daemon_killed_twenty_times(artists: Blender) -> None:
    seen = artists.run("trouble.killed", 20)
    assert len(seen) == 20
    for facts in seen:
        assert facts["kept"] and facts["others"] and facts["equal"] and facts["rest"], facts
        assert facts["strokes"] and facts["phase"] == "ready", facts
        assert facts["waits"] == (facts["when"] != "between"), facts
        if facts["when"] == "mid-answer":
            assert 0 < facts["solved"] < 20_000, facts


def test_disabling_loses_nothing(artists: Blender) -> None:
    facts = artists.run("trouble.left", "disable")
    assert facts["started"]
    assert facts["seconds"] < EXIT_SECONDS
    assert facts["rest"] and facts["kept"] and facts["remembered"] and facts["equal"]
    assert facts["different"] == []


@pytest.mark.parametrize("how", ["quit", "halted"])
def test_quitting_leaves_no_orphan(artists: Blender, how: str) -> None:
    job = artists.start("trouble.left", how)
    wait_for(job.output)
    begun = time.monotonic()
    facts = job.result()
    assert time.monotonic() - begun < EXIT_SECONDS
    assert facts["started"]
    if how == "quit":
        assert wait_until_none(artists.socket) == []
    else:  # it stands still and cannot hear that it is not needed any more
        assert daemons(artists.socket) == [facts["pid"]]
        os.kill(facts["pid"], signal.SIGKILL)


# ---- files ----


def test_a_file_saved_mid_session(artists: Blender, tmp_path: Path) -> None:
    """One Blender saves with a stroke pending and goes on, a second one opens that and rejoins. When
    both have left and the daemon is gone, a third takes the session back with its history; a fourth
    comes when it was deleted."""
    path, flag = str(tmp_path / "saved.blend"), str(tmp_path)
    first = artists.start("sessions.saved", path, flag)
    wait_for(tmp_path / "saved")
    before = pickle.loads((tmp_path / "before").read_bytes())
    second = artists.run("sessions.opened", path, "cancel", before, flag)
    told = first.result()
    assert told["shown"] and told["clean"] and told["pending"] == 1
    assert told["equal"] and told["back"] and told["strokes"] == 2

    assert np.array_equal(second["rest"], told["rest"])
    assert np.array_equal(second["table"].sum(1) > 0, np.ones(len(told["rest"]), bool))
    assert second["remembered"] == told["name"] == second["name"]
    assert np.array_equal(second["joined"], told["solved"])
    assert np.array_equal(second["stroked"], told["theirs"])
    assert second["equal"]
    assert sorted(second["marks"]) == ["skind_session", "skind_state"]
    assert lasting(second["facts"]) == lasting(before) and second["remembers"] is None
    stop_idle(artists.socket)

    third = artists.run("sessions.opened", path, "cancel", before)
    assert third["told"] == "" and third["undo_steps"] == 3
    assert np.array_equal(third["joined"], told["theirs"])
    assert third["equal"]
    assert lasting(third["facts"]) == lasting(before) and third["remembers"] is None
    with reader(artists) as link:
        link.call("session.delete", {"session": told["name"]})
        link.call("shutdown")
    assert wait_until_none(artists.socket) == []

    fourth = artists.run("sessions.opened", path, "finish", before)
    assert "begins anew" in fourth["told"] and fourth["undo_steps"] == 0
    assert np.array_equal(np.sort(fourth["table"], 1)[:, -4:], np.sort(told["answered"], 1))
    assert np.array_equal(np.sort(fourth["joined"], 1), np.sort(told["answered"], 1))
    assert fourth["equal"] and fourth["zeros"] == 0 and fourth["remembers"] is None


def stop_idle(socket: Path) -> None:
    """Of two Blenders the one that started the daemon may leave first. Then it waits for half an
    hour whether somebody needs it, without a session."""
    if daemons(socket):
        with Link.connect(socket) as link:
            assert link.call("session.list")["sessions"] == []
            link.call("shutdown")
    assert wait_until_none(socket) == []


def lasting(facts: dict) -> dict:
    """Without what each Blender process has its own of."""
    return {name: facts[name] for name in ("co", "entries", "groups", "active", "modifiers")}


def test_half_done_is_never_left(artists: Blender, tmp_path: Path) -> None:
    facts = artists.run("trouble.interrupted", str(tmp_path / "half.blend"))
    assert facts["saved at start"] == (True, True)
    for case in "saved at cancel", "stopped at cancel", "stopped at start", "disabled at start":
        assert facts[case] == (True, []), case
    assert facts["sessions"] == 0
    is_over, changed = facts["opened"]
    assert is_over and all(".session_u" in line for line in changed), changed


def test_without_a_session_or_a_daemon(artists: Blender) -> None:
    facts = artists.run("trouble.bereft")
    for how in "finish", "cancel":
        assert facts[f"closed, {how}"][:2] == (True, True), facts
        # The stroke's refusal and the session's end come in either order.
        told = facts[f"closed, {how}"][2]
        assert 'no session "Tube"' in told or "a client closed it" in told
        assert facts[f"gone, {how}"] == (True, True, 1), facts


def test_undone_to_before_the_start(artists: Blender) -> None:
    facts = artists.run("trouble.outside")
    assert facts == {"renamed": (2, True), "outside": (True, False), "back": (False, 3, True),
                     "cancelled": []}


# ---- several tools ----


def test_another_tool_works_on_the_same_session(artists: Blender) -> None:
    facts = artists.run("sessions.shared", 5, 30)
    assert all(facts["seen"])
    assert facts["strokes"][0] == facts["strokes"][1] > 10
    assert facts["theirs"] > 10
    # Each change has a revision, without gaps: none was lost.
    ours, theirs = facts["strokes"][0], facts["theirs"]
    assert facts["revision"] == (ours + theirs, ours + theirs)


def test_a_second_blender_joins(artists: Blender, tmp_path: Path) -> None:
    first = artists.start("sessions.held", str(tmp_path))
    wait_for(tmp_path / "held")
    second = artists.run("sessions.joined", str(tmp_path), "Tube")
    told = first.result()
    assert second["listed"] == ["Tube"]
    assert second["equal"] and told["equal"] and told["alone"]
    assert np.array_equal(second["weights"], told["weights"])
    assert told["strokes"] == 1 and told["told"].startswith(f"Stroke by {getpass.getuser()} (Blender")
    assert second["different"] == []


@needs_assets
def test_a_session_of_a_file(artists: Blender, tmp_path: Path) -> None:
    """Another tool made it from the glTF file that Blender has imported, y up and all."""
    fox = CHARACTERS[6]
    facts = artists.run("sessions.of_a_file", str(ASSETS / fox.file), fox.mesh,
                        str(tmp_path / "fox.glb"))
    assert facts["before"] > REACHED >= facts["after"] and facts["equal"]
    assert facts["told"].startswith("Wrote ") and facts["different"] == []
    assert facts["sessions"] == ["of-a-file"]  # it is the other tool's
    written, held = (np.sort(weights, 1) for weights in facts["exported"])
    assert np.abs(written - held).max() <= 1e-6


# ---- odd meshes ----


def test_odd_vertices_and_groups(artists: Blender) -> None:
    facts = artists.run("sessions.odd")
    sentences, changed = facts["refused"]
    assert len(sentences) == 1 and "140 vertices have more than 4 influences" in sentences[0]
    assert changed == []
    assert facts["reduced"] == 140
    assert facts["unweighted"] == [0, 1, 2, 3]
    assert facts["moved"]["bare"] == 0 and facts["moved"]["light"] <= SAME
    assert facts["locked"] and facts["others"] and facts["equal"] and facts["rest"]
    assert facts["changed"] > 100 and facts["strokes"] == 6
    solved, told, rest = facts["nothing"]
    assert solved == 0 and rest
    assert told == "4 vertices have no weights: a stroke cannot move them."
    assert facts["different"] == []


def test_groups_that_change_in_the_middle(artists: Blender) -> None:
    facts = artists.run("sessions.meddled")
    assert facts["added"] and facts["filled"] and facts["removed"]
    assert facts["zeros"] == 0
    assert facts["moved"] < 1e-6
    assert facts["different"] == []


# ---- export ----


def test_export(artists: Blender, tmp_path: Path) -> None:
    """Blender's exporter writes the rest shape with the new weights; our own reader agrees."""
    path = tmp_path / "tube.glb"
    facts = artists.run("sessions.exported", "tube", "", str(path))
    assert facts["told"].startswith(f"Wrote {path}")
    assert facts["strokes"] == 2 and facts["equal"]
    assert facts["scene"] == ("SCULPT", True, True, False)
    assert "Preferences > Add-ons" in facts["off"]
    with reader(artists) as link:
        made = link.call("session.create", {"file": str(path)})
        about = {"session": made["session"]}
        assert made["bones"] == len(facts["bones"])
        mesh = link.call("mesh.get", about)
        held = link.call("weights.get", about)
        names = [bone["name"] for bone in link.call("session.info", about)["bones"]]
        link.call("shutdown")
    # glTF has y up, and splits vertices at seams: each is looked up by its place.
    rest = facts["rest"] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)
    distances = np.linalg.norm(mesh["positions"][:, None] - rest[None], axis=2)
    twin = distances.argmin(1)
    assert distances.min(1).max() <= SAME * facts["length"]
    assert len(np.unique(twin)) == len(rest)
    written = by_name(held["joints"], held["weights"], names)
    shown = by_name(facts["joints"], facts["weights"], facts["bones"])[twin]
    assert np.abs(written - shown).max() < 2 * EXPORTED


def reader(artists: Blender) -> Link:
    """A connection to a daemon of this test's own, after the add-on's is gone."""
    assert wait_until_none(artists.socket) == []
    subprocess.run([BIN / "skinctl", "--quiet", f"--socket={artists.socket}", "start"], check=True,
                   stdin=subprocess.DEVNULL, timeout=60)
    return Link.connect(artists.socket)


def by_name(joints: np.ndarray, weights: np.ndarray, names: list[str]) -> np.ndarray:
    """[V,B] weights, bones by name."""
    table = np.zeros((len(joints), len(names)))
    order = {name: index for index, name in enumerate(sorted(names))}
    place = np.array([order[name] for name in names])
    vertices, slots = np.nonzero(joints != 65535)
    np.add.at(table, (vertices, place[joints[vertices, slots]]), weights[vertices, slots])
    return table
