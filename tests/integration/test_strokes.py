"""Strokes through a real daemon: solved, streamed, committed, shared, undone."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest
import rigs
from core import SkindError

MANY = 60_000 if os.environ.get("SKIND_QUICK") else 400_000


def open_sheet(link, vertices: int = 900, **options) -> tuple[str, dict]:
    rig = rigs.sheet(vertices)
    made = link.call("session.create", {"name": "sheet", **rig, **options})
    assert made["vertices"] == len(rig["positions"])
    link.call("pose.set", {"session": "sheet", "pose": "bent", "matrices": rigs.bent(0.3)})
    return made["session"], rig


def everything(link) -> tuple[np.ndarray, np.ndarray]:
    answer = link.call("weights.get", {"session": "sheet"})
    return answer["joints"], answer["weights"]


@pytest.mark.parametrize("influences", [4, 8])
def test_posed_positions_are_linear_blend_skinning(daemon, influences) -> None:
    with daemon.link() as link:
        _, rig = open_sheet(link, influences=influences)
        joints, weights = everything(link)
        assert joints.shape == (len(rig["positions"]), influences)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        np.testing.assert_allclose(posed, rigs.skin(rig, rigs.bent(0.3), joints, weights),
                                   atol=1e-6)
        some = np.array([7, 3], np.uint32)
        few = link.call("pose.evaluate", {"session": "sheet", "pose": "bent", "vertices": some})
        np.testing.assert_array_equal(few["positions"], posed[some])


@pytest.mark.parametrize("influences", [4, 8])
@pytest.mark.parametrize("lines", [False, True])
def test_a_stroke_brings_the_surface_nearer(daemon, influences, lines) -> None:
    with daemon.link(lines=lines) as link:
        _, rig = open_sheet(link, influences=influences)
        posed = np.asarray(
            link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"])
        vertices, targets = rigs.bump(posed, 450, 0.2, 0.02)
        answer = link.call("stroke.apply", {"session": "sheet", "pose": "bent",
                                            "vertices": vertices, "positions": targets})
        joints, weights = (np.asarray(array) for array in everything(link))
        after = rigs.skin(rig, rigs.bent(0.3), joints, weights)
        before_error = np.linalg.norm(posed[vertices] - targets, axis=-1)
        after_error = np.linalg.norm(after[vertices] - targets, axis=-1)
        assert answer["revision"] == 1
        assert answer["vertices"] == len(vertices)
        assert (after_error <= before_error + 1e-6).all()
        assert after_error.mean() < 0.9 * before_error.mean()
        assert answer["residual"]["before"]["mean"] == pytest.approx(before_error.mean(), rel=1e-4)
        assert answer["residual"]["after"]["max"] == pytest.approx(after_error.max(), rel=1e-4)
        untouched = np.setdiff1d(np.arange(len(posed)), vertices)
        np.testing.assert_allclose(after[untouched], posed[untouched], atol=1e-6)


def test_streamed_weights_are_the_committed_ones(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link, 40_000)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        everyone = np.arange(len(posed), dtype=np.uint32)
        id = link.send("stroke.apply", {"session": "sheet", "pose": "bent", "vertices": everyone,
                                        "positions": posed * np.float32(1.01)})
        link.wait(id)
        streamed = np.full((len(posed), 4), np.nan, np.float32)
        for note in link.notifications:
            assert note.method == "stroke.weights" and note.params["request"] == id
            assert note.params["total"] == len(posed)
            streamed[note.params["vertices"]] = note.params["weights"]
        assert len(link.notifications) > 1
        np.testing.assert_array_equal(streamed, everything(link)[1])


def test_no_stream_when_not_wanted(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link)
        link.call("stroke.apply", {"session": "sheet", "pose": "bent", "stream": False,
                                   "vertices": [4], "positions": [[0, 0, 0]]})
        assert not link.notifications


def test_the_same_bits_for_any_number_of_workers(start, folder) -> None:
    results = []
    for workers in ("1", "2", "5"):
        daemon = start("--workers", workers, socket=folder / f"{workers}.sock")
        with daemon.link(checked=False) as link:
            open_sheet(link, 30_000)
            posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
            for turn in range(3):
                vertices, targets = rigs.bump(posed, 9000 * turn + 100, 0.5, 0.03)
                link.call("stroke.apply", {"session": "sheet", "pose": "bent",
                                           "vertices": vertices, "positions": targets})
            results.append(everything(link))
    for joints, weights in results[1:]:
        np.testing.assert_array_equal(joints, results[0][0])
        np.testing.assert_array_equal(weights.view(np.uint32), results[0][1].view(np.uint32))


def test_undo_and_redo_to_the_bit(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        states = [everything(link)[1]]
        for turn in range(10):
            vertices, targets = rigs.bump(posed, 80 * turn + 40, 0.15, 0.02)
            link.call("stroke.apply", {"session": "sheet", "pose": "bent", "vertices": vertices,
                                       "positions": targets})
            states.append(everything(link)[1])
        for turn in range(9, -1, -1):
            answer = link.call("history.undo", {"session": "sheet"})
            assert (answer["undo_steps"], answer["redo_steps"]) == (turn, 10 - turn)
            np.testing.assert_array_equal(everything(link)[1], states[turn])
        with pytest.raises(SkindError, match="nothing to undo"):
            link.call("history.undo", {"session": "sheet"})
        for turn in range(1, 11):
            link.call("history.redo", {"session": "sheet"})
            np.testing.assert_array_equal(everything(link)[1], states[turn])
        with pytest.raises(SkindError, match="nothing to redo"):
            link.call("history.redo", {"session": "sheet"})
        info = link.call("session.info", {"session": "sheet"})
        assert info["revision"] == 30 and info["undo_steps"] == 10


def updates_until(link, revision: int) -> list[dict]:
    """What session.update tells, until it tells this revision."""
    seen: list[dict] = []
    deadline = time.monotonic() + 20
    while not seen or seen[-1]["revision"] < revision:
        assert time.monotonic() < deadline, f"only {seen} came"
        link.pump(0.01)
        seen += [note.params for note in link.notifications if note.method == "session.update"]
        link.notifications.clear()
    return seen


@pytest.mark.parametrize("lines", [False, True])
def test_others_hear_of_each_change(daemon, lines) -> None:
    with daemon.link("artist") as artist, daemon.link("viewer", lines=lines) as viewer:
        open_sheet(artist)
        assert viewer.call("session.attach", {"session": "sheet"})["resync"] is True
        assert viewer.call("session.attach", {"session": "sheet", "revision": 0})["resync"] is False
        mirror = np.array(viewer.call("weights.get", {"session": "sheet"})["weights"])
        artist.call("session.attach", {"session": "sheet"})
        posed = artist.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        for turn in range(3):
            vertices, targets = rigs.bump(posed, 200 * turn, 0.2, 0.02)
            artist.call("stroke.apply", {"session": "sheet", "pose": "bent",
                                         "vertices": vertices, "positions": targets})
        artist.call("history.undo", {"session": "sheet"})
        seen = updates_until(viewer, 4)
        told = [change for note in seen for change in note.get("changes", [note])]
        assert [change["revision"] for change in told] == [1, 2, 3, 4]
        assert [change["cause"] for change in told] == ["stroke", "stroke", "stroke", "undo"]
        assert {change["client"] for change in told} == {"artist"}
        for note in seen:
            mirror[np.asarray(note["vertices"])] = note["weights"]
        np.testing.assert_array_equal(mirror.astype(np.float32), everything(artist)[1])
        own = [note.params.get("cause") for note in artist.notifications
               if note.method == "session.update"]
        assert own == ["undo"]
        viewer.call("session.detach", {"session": "sheet"})
        artist.call("history.redo", {"session": "sheet"})
        viewer.notifications.clear()
        viewer.call("ping")
        assert not viewer.notifications


def test_an_update_too_large_for_a_line_is_a_resync(daemon) -> None:
    with daemon.link() as artist, daemon.link(lines=True) as viewer:
        open_sheet(artist, 120_000)
        viewer.call("session.attach", {"session": "sheet"})
        posed = artist.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        everyone = np.arange(len(posed), dtype=np.uint32)
        artist.call("stroke.apply", {"session": "sheet", "pose": "bent", "vertices": everyone,
                                     "positions": posed})
        viewer.call("ping")
        (note,) = viewer.notifications
        assert note.params["resync"] is True and "weights" not in note.params


def test_control_is_answered_while_a_large_stroke_is_solved(daemon) -> None:
    with daemon.link(checked=False) as artist, daemon.link() as other:
        open_sheet(artist, MANY)
        posed = artist.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        everyone = np.arange(len(posed), dtype=np.uint32)
        id = artist.send("stroke.apply", {"session": "sheet", "pose": "bent",
                                          "vertices": everyone, "positions": posed + 0.01})
        other.call("ping")
        assert other.call("session.list")["sessions"][0]["busy"] is True
        assert other.call("session.info", {"session": "sheet"})["revision"] == 0
        assert artist.exchange.unanswered == 1
        assert artist.wait(id)["revision"] == 1


def test_a_cancelled_stroke_changes_nothing(daemon) -> None:
    with daemon.link(checked=False) as link:
        open_sheet(link, MANY)
        before = everything(link)[1]
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        everyone = np.arange(len(posed), dtype=np.uint32)
        stroke = {"session": "sheet", "pose": "bent", "vertices": everyone,
                  "positions": posed + 0.01}
        running, waiting = link.send("stroke.apply", stroke), link.send("stroke.apply", stroke)
        link.cancel(waiting)
        link.cancel(running)
        for id in (running, waiting):
            with pytest.raises(SkindError) as refusal:
                link.wait(id)
            assert refusal.value.name == "cancelled"
        np.testing.assert_array_equal(everything(link)[1], before)
        assert link.call("session.info", {"session": "sheet"})["revision"] == 0


def test_strokes_of_one_session_are_done_in_order(daemon) -> None:
    with daemon.link(checked=False) as link:
        open_sheet(link, 20_000)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        ids = []
        for turn in range(20):
            vertices, targets = rigs.bump(posed, 900 * turn, 0.3, 0.01)
            ids.append(link.send("stroke.apply", {"session": "sheet", "pose": "bent",
                                                  "vertices": vertices, "positions": targets}))
        assert [link.wait(id)["revision"] for id in ids] == list(range(1, 21))


def test_a_stroke_outlives_its_client(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link, 20_000)
        hasty = daemon.link(checked=False)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        everyone = np.arange(len(posed), dtype=np.uint32)
        hasty.send("stroke.apply", {"session": "sheet", "pose": "bent", "vertices": everyone,
                                    "positions": posed + 0.01})
        hasty.close()
        for _ in range(1000):
            if link.call("session.info", {"session": "sheet"})["revision"] == 1:
                break
        assert link.call("weights.get", {"session": "sheet"})["revision"] == 1


def test_locks_and_methods(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        vertices, targets = rigs.bump(posed, 450, 0.2, 0.02)
        joints, before = everything(link)
        stroke = {"session": "sheet", "pose": "bent", "vertices": vertices, "positions": targets}
        link.call("stroke.apply", {**stroke, "locked_bones": ["bone.5"],
                                   "locked_vertices": vertices[:3]})
        after = everything(link)[1]
        np.testing.assert_array_equal(after[joints == 5], before[joints == 5])
        np.testing.assert_array_equal(after[vertices[:3]], before[vertices[:3]])
        assert (after != before).any()
        affine = link.call("stroke.apply", {**stroke, "constraint": "affine", "stiffness": 1e-4})
        assert affine["residual"]["after"]["mean"] <= affine["residual"]["before"]["mean"]
        link.call("stroke.apply", {**stroke, "method": "thesis"})
        np.testing.assert_allclose(everything(link)[1].sum(1), 1, atol=2e-7)


def test_a_bent_pose_turns_every_joint_by_that_angle(daemon) -> None:
    with daemon.link() as link:
        _, rig = open_sheet(link)
        rest = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
        shapes = []
        for seed in (0, 1, 0):
            link.call("pose.set", {"session": "sheet", "pose": "b", "bend": 25, "seed": seed})
            shapes.append(link.call("pose.evaluate", {"session": "sheet", "pose": "b"})["positions"])
        np.testing.assert_array_equal(shapes[0], shapes[2])
        assert np.abs(shapes[0] - shapes[1]).max() > 0.05
        # The first bone alone carries the bottom row: a turn by 25 degrees about the origin.
        joints, weights = everything(link)
        alone = ((joints == 0) & (weights == 1)).any(1)
        length = np.linalg.norm(rest[alone], axis=1)
        np.testing.assert_allclose(np.linalg.norm(shapes[0][alone], axis=1), length, atol=1e-6)
        chord = np.linalg.norm(shapes[0][alone] - rest[alone], axis=1)
        assert (chord <= 2 * length * np.sin(np.radians(12.5)) + 1e-6).all()
        link.call("pose.set", {"session": "sheet", "pose": "b", "bend": 0})
        flat = link.call("pose.evaluate", {"session": "sheet", "pose": "b"})["positions"]
        np.testing.assert_allclose(flat, rest, atol=1e-6)
