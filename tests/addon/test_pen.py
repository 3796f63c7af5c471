"""Real strokes with real events in a window, against the real daemon."""

from __future__ import annotations

import numpy as np
import pytest
from blenders import ASSETS

SAME = ("co", "mesh", "mirror", "truth", "state")


def is_same(state: dict, other: dict) -> bool:
    """The same state of the mesh and of the daemon's weights, bit for bit."""
    return all(np.array_equal(state[part], other[part]) for part in SAME)


def holds(state: dict) -> bool:
    """The mesh has what the daemon has."""
    return (np.array_equal(state["mesh"], state["truth"])
            and np.array_equal(state["mirror"], state["truth"]))


KNIGHT = ASSETS / "kaykit_adventurers" / "Knight.glb"
CHARACTERS = ["rigify", *([str(KNIGHT)] if KNIGHT.exists() else [])]


@pytest.mark.parametrize("character", CHARACTERS, ids=lambda each: str(each).rpartition("/")[2])
def test_fifty_strokes_are_seen(window, character) -> None:
    result = window.run("pen.strokes", 50, character)
    assert result["seen"] == list(range(1, 51))
    assert holds(result)
    assert np.array_equal(result["co"], result["rest"])  # what was sculpted is in the weights


@pytest.mark.parametrize("character, mode", [(2000, "SCULPT"), (2000, "OBJECT"),
                                             *[(each, "SCULPT") for each in CHARACTERS]],
                         ids=lambda each: str(each).rpartition("/")[2])
def test_undo_and_redo_over_ten_strokes(window, character, mode) -> None:
    """To both ends, one Ctrl+Z a stroke, in Sculpt Mode and out of it."""
    ways = window.run("pen.undo_redo", 10, mode, character)
    forth = ways["forth"]
    assert len({state["mesh"].tobytes() for state in forth}) == 11
    for state, as_then in zip(ways["undo"], reversed(forth[:-1])):
        assert is_same(state, as_then)
    for state, as_then in zip(ways["redo"], forth[1:]):
        assert is_same(state, as_then)
    assert all(holds(state) for way in ("forth", "undo", "redo") for state in ways[way])


def test_strokes_wait_and_are_undone_while_they_wait(window) -> None:
    """The daemon is stopped meanwhile. What is sculpted stays on screen; then all is as it should
    be, with one Ctrl+Z a stroke."""
    seen = window.run("pen.pending")
    assert [state["what"] for state in seen] == [
        "begin", "stroke", "stroke", "stroke", "undo", "redo", "undo", "answered", "undo", "undo",
        "redo", "redo"]
    assert [state["pending"] for state in seen] == [0, 1, 2, 3, 2, 3, 2, 0, 0, 0, 0, 0]
    rest, shapes = seen[0]["co"], [state["co"] for state in seen[1:4]]
    assert len({shape.tobytes() for shape in [rest, *shapes]}) == 4
    for state, shape in zip(seen[4:7], (shapes[1], shapes[2], shapes[1])):
        assert np.array_equal(state["co"], shape)
    assert all(np.array_equal(state["mesh"], seen[0]["mesh"]) for state in seen[:7])
    answered, once, never, again, twice = seen[7:]
    assert all(np.array_equal(state["co"], rest) for state in seen[7:])
    assert is_same(never, seen[0]) and is_same(again, once) and is_same(twice, answered)
    assert len({state["mesh"].tobytes() for state in (answered, once, never)}) == 3
    assert all(holds(state) for state in seen)


def test_every_kind_of_stroke(window) -> None:
    """Brushes, Ctrl, Shift, a pen held still: each stroke gives one solve, of vertices that moved."""
    result = window.run("pen.kinds")
    assert [tool for tool, how, solved in result["seen"] if len(solved) != 1 or solved[0] == 0] == []
    assert holds(result)


def test_symmetry(window) -> None:
    result = window.run("pen.symmetry")
    left, right = (result["changed"][:, 0] < -0.01), (result["changed"][:, 0] > 0.01)
    assert left.sum() > 10 and abs(int(left.sum()) - int(right.sum())) <= 0.1 * left.sum()


def test_strokes_that_are_none(window) -> None:
    """Beside the mesh, with a mask, and with a brush that would change the topology."""
    result = window.run("pen.odd")
    assert not any(result[case][0] for case in ("escaped", "beside", "simplify", "mask", "after",
                                                "dyntopo"))
    assert result["beside"][1] == result["escaped"][1] == result["simplify"][1] == result["mask"][1]
    assert "changes the mesh's topology" in result["simplify"][2]
    assert result["after"][1] == result["mask"][1] + 1
    assert "Dyntopo" in result["dyntopo"][2] and result["dyntopo"][1] == result["after"][1]
    # Back from Dyntopo the vertices have another order: nothing is solved until that is undone.
    assert result["reordered"][1] == 0 and "another order" in result["reordered"][2]
    assert result["mended"] == (True, 0, "")
    assert holds(result)


def test_undo_to_before_start_and_back(window) -> None:
    seen = window.run("pen.outside")
    assert seen["outside"] == [False, False, True, False, False]
    assert is_same(seen["states"][0], seen["states"][-1])
    assert np.array_equal(seen["groups_before"], seen["groups_outside"])
    assert holds(seen["end"]) and seen["strokes"] == 2


def test_undo_into_an_earlier_session(window) -> None:
    """It had the same name, and states of the same numbers; they are not ours."""
    found = window.run("pen.across")
    assert found["same name"]
    assert [outside for outside, _ in found["seen"]] == [
        False, False, True, True, True, False, False]
    assert [mark for _, mark in found["seen"][1:5]] == ["Tube", None, "Tube", None]
    assert is_same(found["end"], found["again"]) and holds(found["again"])


def test_what_a_stroke_costs(window) -> None:
    """10k changed of 100k, each the best of some rounds. How long a slice is, a busy machine decides;
    that it is a small part of the whole, we do."""
    result = window.run("pen.cost", 100_000, 30, 10, seconds=200)
    changed = [row["changed"] for row in result["rows"]]
    assert min(changed) > 9_000 and result["thesis_changed"] > 9_000
    longest = min(max(row["slices"]) for row in result["rows"])
    whole = min(row["whole"] for row in result["rows"])
    print(f"longest slice {1e3 * longest:.1f} ms; whole {1e3 * whole:.0f} ms, "
          f"thesis {1e3 * result['thesis']:.0f} ms: {whole / result['thesis']:.3f}")
    assert longest <= 0.1 * whole
    assert whole <= 0.25 * result["thesis"]
