"""What strokes know beyond one pose and one set of bones, in real Blenders: each option shows
there, and is undone to the bit."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Iterator

import pytest

from blenders import Blender, Window
from daemons import BIN

CHOICES = [("slots", "EVIDENCE"), ("residual", "REST"), ("residual", "SHAPE")]


@pytest.fixture(autouse=True)
def programs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The add-on starts the daemon of this build."""
    monkeypatch.setenv("PATH", str(BIN), prepend=os.pathsep)
    yield


# ---- pins ----


def test_two_poses_are_both_kept(blender: Blender) -> None:
    found = blender.run("layers.two_poses")
    kept, forgotten = found["kept"], found["forgotten"]
    assert kept["equal"] and forgotten["equal"]
    assert (kept["poses"], forgotten["poses"]) == (2, 1)
    assert len(set(kept["names"])) == len(kept["pins"]) == 2 and len(forgotten["pins"]) == 1
    assert kept["apart"][0] < 0.7 * forgotten["apart"][0]  # the first pose is not given up


def test_the_same_pose_has_the_same_name(blender: Blender) -> None:
    found = blender.run("layers.same_pose")
    assert len(set(found["names"])) == len(found["names"]) == 2
    assert found["solved"] > 0 and found["changed"] and found["equal"] and found["left"] == 0


# ---- poses to keep ----


def test_frames_are_looked_at_without_being_gone_to(blender: Blender) -> None:
    found = blender.run("layers.looked_at")
    assert found["untouched"]
    assert found["frames"] == list(range(1, 42, 2))  # ten a second of 24
    assert found["apart"] < 1e-6


@pytest.mark.parametrize("where, poses", [("ACTIONS", 16), ("MARKERS", 3), ("CHOSEN", 4),
                                          ("HAND", 3)])
def test_other_poses_are_kept(blender: Blender, where: str, poses: int) -> None:
    found = blender.run("layers.kept", where)
    without, with_them = found[False], found[True]
    assert (without["poses"], with_them["poses"]) == (0, poses), with_them["told"]
    assert without["equal"] and with_them["equal"]
    assert with_them["moved"] < 0.8 * without["moved"]
    assert with_them["edited"] < 1.1 * without["edited"]


# ---- other bones, rest positions, shapes ----


def assert_undone(found: dict) -> None:
    """Each state came back bit for bit, and the daemon followed."""
    assert [at for at, is_right in found["seen"] if not is_right] == []
    assert found["compared"] == (True, True)
    assert all(each["equal"] for each in found["last"])


def test_vertices_get_other_bones(blender: Blender) -> None:
    kept = blender.run("layers.changed", "slots", "KEEP")
    found = blender.run("layers.changed", "slots", "EVIDENCE")
    assert_undone(kept)
    assert_undone(found)
    assert sum(each["slots_changed"] for each in kept["last"]) == 0
    assert "bone.3" not in kept["groups"] and "bone.3" in found["groups"]
    assert found["last"][1]["slots_changed"] > 500
    assert max(kept["ends"]) > 0.1 and max(found["ends"]) < 1e-4 * found["length"]


def test_rest_positions_move(blender: Blender) -> None:
    kept = blender.run("layers.changed", "residual", "REPORT")
    found = blender.run("layers.changed", "residual", "REST")
    assert_undone(found)
    # With one pose it is refused, and the stroke is solved without.
    assert found["last"][0]["rest_moved"] == 0 and found["apart"][0] == kept["apart"][0]
    assert found["last"][1]["rest_moved"] > 1900
    assert found["apart"][1] < kept["apart"][1] and found["apart"][2] < kept["apart"][2]
    assert found["keys"] == []


def test_corrective_shape_keys(blender: Blender) -> None:
    found = blender.run("layers.changed", "residual", "SHAPE")
    assert_undone(found)
    assert found["keys"][0] == "Basis" and len(found["keys"]) == 5
    assert all(name.startswith("skind pose ") for name in found["keys"][1:])
    assert max(found["apart"]) < 1e-6 * found["length"]  # nothing is left over in its pose
    assert found["last"][0]["shaped"] > 1900


@pytest.mark.parametrize("option, value", CHOICES)
def test_cancel_takes_it_all_back(blender: Blender, option: str, value: str) -> None:
    assert blender.run("layers.cancelled", option, value) == []


@pytest.mark.parametrize("option, value", CHOICES)
def test_saved_and_rejoined(blender: Blender, tmp_path: Path, option: str, value: str) -> None:
    found = blender.run("layers.rejoined", str(tmp_path / "saved.blend"), option, value)
    assert found["saved"] and found["joined"] and found["equal"] == [True, True] and found["start"]
    assert found["different"] == [] and not found["keys"]


@pytest.mark.parametrize("option, value", CHOICES)
def test_undo_of_the_pen(window: Window, option: str, value: str) -> None:
    found = window.run("layers.undo_redo", 4, option, value)
    ways, last = found["ways"], found["last"]
    assert found["strokes"] == 4 and all(found["equal"])
    changed = {"EVIDENCE": "slots_changed", "REST": "rest_moved", "SHAPE": "shaped"}[value]
    assert any(each[changed] for each in last)
    assert ways["undo"] == list(reversed(ways["forth"][:-1]))
    assert ways["redo"] == ways["forth"][1:]


# ---- edits, masks ----


def test_mirror_prune_and_reduce(blender: Blender) -> None:
    found = blender.run("layers.mirrored")
    assert found["alike"] == 0 and "Mirrored" in found["told"]
    assert found["smallest"] >= 0.1 and "Removed" in found["pruned"]
    assert found["most"] == 1 and found["equal"]
    assert found["states"] == 4  # each is a step of undo


def assert_masked(found: dict) -> None:
    assert found["read"]
    (under, free), (under_too, free_too) = found["moved"][False], found["moved"][True]
    assert under > 100 and under_too == 0 and free == free_too


def test_the_sculpt_mask_keeps_weights(blender: Blender) -> None:
    if blender.version == "3.4":  # there only Sculpt Mode can make one: the next test
        return
    assert_masked(blender.run("layers.masked"))


def test_the_sculpt_mask_of_old_blenders(window: Window) -> None:
    assert_masked(window.run("layers.masked_in_window"))
