"""weights.set: rows that a client knows become the session's, as one step of its history."""

from __future__ import annotations

import os
import threading
import time

import numpy as np
import pytest
import rigs
from core import SkindError

MANY = 200_000 if os.environ.get("SKIND_QUICK") else 1_000_000


def open_sheet(link, count: int = 900, influences: int = 4, **more) -> None:
    link.call("session.create", {"name": "sheet", "influences": influences, **rigs.sheet(count),
                                 **more})
    link.call("pose.set", {"session": "sheet", "pose": "bent", "matrices": rigs.bent(0.3)})


def weights_of(link) -> np.ndarray:
    return np.asarray(link.call("weights.get", {"session": "sheet"})["weights"], np.float32)


def bits(weights: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(weights, np.float32).view(np.uint32)


def stroke(link, centre: int, **more) -> np.ndarray:
    """Solves a bump and returns the vertices it moved."""
    posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
    vertices, targets = rigs.bump(np.asarray(posed), centre, 0.3, 0.02)
    link.call("stroke.apply", {"session": "sheet", "pose": "bent", "vertices": vertices,
                               "positions": targets, **more})
    return vertices


def put(link, vertices, weights) -> dict:
    return link.call("weights.set", {"session": "sheet"},
                     {"vertices": np.asarray(vertices, np.uint32),
                      "weights": np.asarray(weights, np.float32)})


def random_rows(joints: np.ndarray, seed: int) -> np.ndarray:
    """Rows that sum to one but for float32's rounding, 0 where there is no bone."""
    raw = np.where(joints == 65535, 0, np.random.default_rng(seed).random(joints.shape) ** 3)
    raw[:, 0] += 0.01
    return (raw / raw.sum(1, keepdims=True)).astype(np.float32)


def test_hello_names_it(daemon) -> None:
    with daemon.link() as link:
        assert "weights.set" in link.hello["capabilities"]


def updates(link) -> list[dict]:
    """What it heard of changes; who is here may be told at any moment."""
    return [note.params for note in link.notifications if note.method == "session.update"]


@pytest.mark.parametrize("lines", [False, True])
@pytest.mark.parametrize("influences", [4, 8])
def test_a_tool_comes_back_after_the_daemon_died(start, folder, lines, influences) -> None:
    """What strokes of either method left is taken back by a new daemon to the bit."""
    first, second = (start(socket=folder / f"{name}.sock") for name in "ab")
    with first.link() as link:
        open_sheet(link, influences=influences)
        stroke(link, 450)
        stroke(link, 100, method="thesis" if influences == 4 else "exact")
        held = weights_of(link)
    with second.link(lines=lines) as link:
        open_sheet(link, influences=influences)
        assert (weights_of(link) != held).any()
        vertices = np.random.default_rng(3).permutation(len(held))
        answer = put(link, vertices, held[vertices])
        assert answer == {"session": "sheet", "revision": 1, "vertices": len(held),
                          "undo_steps": 1, "redo_steps": 0}
        np.testing.assert_array_equal(bits(weights_of(link)), bits(held))


def test_set_undo_redo_among_strokes(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link)
        joints = link.call("weights.get", {"session": "sheet"})["joints"]
        states = [weights_of(link)]
        for turn in range(6):
            if turn % 2:
                stroke(link, 150 * turn)
            else:
                some = np.arange(turn, 900, 7)
                put(link, some, random_rows(joints, turn)[some])
            states.append(weights_of(link))
        for turn in range(5, -1, -1):
            link.call("history.undo", {"session": "sheet"})
            np.testing.assert_array_equal(bits(weights_of(link)), bits(states[turn]))
        for turn in range(1, 7):
            link.call("history.redo", {"session": "sheet"})
            np.testing.assert_array_equal(bits(weights_of(link)), bits(states[turn]))
        for _ in range(2):
            link.call("history.undo", {"session": "sheet"})
        answer = put(link, [0], states[0][:1])
        assert (answer["undo_steps"], answer["redo_steps"]) == (5, 0)
        with pytest.raises(SkindError, match="nothing to redo"):
            link.call("history.redo", {"session": "sheet"})
        info = link.call("session.info", {"session": "sheet"})
        assert info["undo_steps"] == 5 and info["revision"] == answer["revision"]


def test_only_what_needs_it_is_scaled(daemon) -> None:
    """The rule is the sum as sent: within 1e-7 of one nothing changes, else it is scaled."""
    with daemon.link() as link:
        open_sheet(link)
        joints = link.call("weights.get", {"session": "sheet"})["joints"]
        rows = random_rows(joints, 1)
        off = np.abs(rows.astype(np.float64).sum(1) - 1)
        rows[::3] = (rows[::3] * np.float32(1.0007)).astype(np.float32)
        rows[1::3] = (rows[1::3] * np.float32(0.9993)).astype(np.float32)
        sums = rows.astype(np.float64).sum(1)
        good = np.abs(sums - 1) <= 1e-7
        assert 100 < good.sum() < 400 and (off < 1e-6).all()
        put(link, np.arange(len(rows)), rows)
        stored = weights_of(link)
        np.testing.assert_array_equal(bits(stored[good]), bits(rows[good]))
        np.testing.assert_allclose(stored.astype(np.float64).sum(1), 1, atol=1e-7, rtol=0)
        np.testing.assert_allclose(stored, rows / sums[:, None], atol=2e-7, rtol=0)
        assert (stored >= 0).all() and (stored[joints == 65535] == 0).all()


@pytest.mark.parametrize("lines", [False, True])
def test_the_others_hear_of_it_and_the_sender_does_not(daemon, lines) -> None:
    with daemon.link("painter") as painter, daemon.link("viewer", lines=lines) as viewer:
        open_sheet(painter)
        for link in (painter, viewer):
            link.call("session.attach", {"session": "sheet"})
        joints = painter.call("weights.get", {"session": "sheet"})["joints"]
        mirror = weights_of(painter)
        rows = random_rows(joints, 4) * np.float32(1.0005)
        put(painter, [7, 3, 500], rows[[7, 3, 500]])
        viewer.call("ping")
        painter.call("ping")
        assert not updates(painter)
        (told,) = updates(viewer)
        assert (told["cause"], told["revision"], told["client"]) == ("set", 1, "painter")
        assert list(np.asarray(told["vertices"])) == [7, 3, 500]
        mirror[np.asarray(told["vertices"])] = told["weights"]  # as stored, not as sent
        np.testing.assert_array_equal(bits(mirror), bits(weights_of(painter)))


def test_nothing_is_no_step(daemon) -> None:
    with daemon.link() as link:
        open_sheet(link)
        stroke(link, 450)
        link.call("history.undo", {"session": "sheet"})
        answer = put(link, [], np.zeros((0, 4)))
        assert answer == {"session": "sheet", "revision": 2, "vertices": 0, "undo_steps": 0,
                          "redo_steps": 1}


ROW = [[0.5, 0.5, 0, 0]]
NAN, INF = float("nan"), float("inf")

# what: (params beyond the session, error, what the sentence says); vertex 0 has one bone, and
# the rig's fill is "none", so its other slots have none
REFUSED = {
    "index out of range": ({"vertices": [900], "weights": ROW}, "bad_index", "900 vertices"),
    "named twice": ({"vertices": [31, 31], "weights": 2 * ROW}, "bad_index", "second time"),
    "NaN": ({"vertices": np.array([31], np.uint32),
             "weights": np.array([[NAN, 1, 0, 0]], np.float32)}, "not_finite", "vertex 31"),
    "infinite": ({"vertices": np.array([31], np.uint32),
                  "weights": np.array([[1, INF, 0, 0]], np.float32)}, "not_finite", "slot 1"),
    "negative": ({"vertices": [31], "weights": [[1.0005, -0.0005, 0, 0]]}, "bad_params",
                 "-0.0005 in slot 1"),
    "above one": ({"vertices": [31], "weights": [[1.5, 0, 0, 0]]}, "bad_params", "1.5 in slot 0"),
    "sum too large": ({"vertices": [31], "weights": [[0.5, 0.502, 0, 0]]}, "bad_params",
                      "sums to 1.002"),
    "sum too small": ({"vertices": [31], "weights": [[0.5, 0.498, 0, 0]]}, "bad_params",
                      "sums to 0.998"),
    "no weight": ({"vertices": [31], "weights": [[0, 0, 0, 0]]}, "bad_params", "sums to 0"),
    "without a bone": ({"vertices": [0], "weights": ROW}, "bad_params", "no bone"),
    "good rows first": ({"vertices": [31, 32, 0], "weights": 3 * ROW}, "bad_params", "no bone"),
    "rows of 8": ({"vertices": [31], "weights": [[1, 0, 0, 0, 0, 0, 0, 0]]}, "count_mismatch",
                  "4 influences"),
    "too few rows": ({"vertices": [31, 32], "weights": ROW}, "count_mismatch", "2"),
    "rows of 3": ({"vertices": [31], "weights": [[1, 0, 0]]}, "bad_params", "rows of 4"),
    "wrong dtype": ({"vertices": [31], "weights": np.array(ROW, np.float64)}, "bad_params",
                    "send f32"),
    "no weights": ({"vertices": [31]}, "bad_params", "weights is missing"),
    "no vertices": ({"weights": ROW}, "bad_params", "vertices is missing"),
    "no such session": ({"session": "other", "vertices": [31], "weights": ROW}, "no_session",
                        "other"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_refused_changes_nothing(daemon, what) -> None:
    params, name, said = REFUSED[what]
    with daemon.link(checked=False) as link, daemon.link("viewer") as viewer:
        open_sheet(link, fill="none")
        viewer.call("session.attach", {"session": "sheet"})
        before, info = weights_of(link), link.call("session.info", {"session": "sheet"})
        with pytest.raises(SkindError) as refusal:
            link.call("weights.set", {"session": "sheet", **params})
        assert refusal.value.name == name, str(refusal.value)
        assert said in str(refusal.value) and "\n" not in str(refusal.value)
        np.testing.assert_array_equal(bits(weights_of(link)), bits(before))
        assert link.call("session.info", {"session": "sheet"}) == info
        viewer.call("ping")
        assert not updates(viewer)


def test_it_keeps_the_sessions_order(daemon) -> None:
    """Strokes and sets that are sent at once are done in turn, each one revision."""
    with daemon.link(checked=False) as link:
        open_sheet(link, 20_000)
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "bent"})["positions"]
        start = weights_of(link)
        everyone = np.arange(len(start), dtype=np.uint32)
        ids = []
        for turn in range(5):
            vertices, targets = rigs.bump(posed, 900 * turn, 0.3, 0.01)
            ids.append(link.send("stroke.apply", {"session": "sheet", "pose": "bent",
                                                  "vertices": vertices, "positions": targets}))
            ids.append(link.send("weights.set", {"session": "sheet", "vertices": everyone,
                                                 "weights": start}))
        assert [link.wait(id)["revision"] for id in ids] == list(range(1, 11))
        np.testing.assert_array_equal(bits(weights_of(link)), bits(start))


def longest_ping(daemon, work) -> float:
    """The longest that a ping took on another connection while `work` was done, in seconds."""
    longest, over = 0.0, threading.Event()

    def ask() -> None:
        nonlocal longest
        with daemon.link(checked=False) as link:
            while not over.is_set():
                begun = time.perf_counter()
                link.call("ping")
                longest = max(longest, time.perf_counter() - begun)

    asking = threading.Thread(target=ask)
    asking.start()
    try:
        work()
    finally:
        over.set()
        asking.join()
    return longest


def test_a_million_vertices_and_a_loop_that_goes_on(daemon) -> None:
    with daemon.link(checked=False) as link:
        open_sheet(link, MANY)
        got = link.call("weights.get", {"session": "sheet"})
        before, count = got["weights"], len(got["weights"])
        rows = random_rows(got["joints"], 9)
        everyone = np.arange(count, dtype=np.uint32)
        ids = []
        set_s = longest_ping(daemon, lambda: ids.append(put(link, everyone, rows)))
        assert ids[0]["vertices"] == count and ids[0]["undo_steps"] == 1
        good = np.abs(rows.astype(np.float64).sum(1) - 1) <= 1e-7
        stored = weights_of(link)
        np.testing.assert_array_equal(bits(stored[good]), bits(rows[good]))
        np.testing.assert_allclose(stored.astype(np.float64).sum(1), 1, atol=1e-7, rtol=0)
        undo_s = longest_ping(daemon, lambda: link.call("history.undo", {"session": "sheet"}))
        np.testing.assert_array_equal(bits(weights_of(link)), bits(before))
        print(f"longest ping: {1e3 * set_s:.1f} ms in weights.set, {1e3 * undo_s:.1f} ms in undo")
        assert set_s < 0.5  # some 5 ms; generous, because sanitizers and busy machines are slow
