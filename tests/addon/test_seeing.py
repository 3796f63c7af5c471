"""Overlays and before/after, drawn in a real window; $SKIND_PICTURES: a folder to keep them in."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from core import colours

OVERLAYS = ("RESIDUAL", "CHANGE", "INFLUENCES", "REACH")
LEGEND_PIXELS = 15_000  # its box is about 250 x 130


@pytest.fixture
def pictures(folder: Path, request: pytest.FixtureRequest) -> str:
    kept = os.environ.get("SKIND_PICTURES")
    path = Path(kept, request.node.name) if kept else folder
    path.mkdir(parents=True, exist_ok=True)
    return str(path)


def differs(picture: np.ndarray, other: np.ndarray) -> np.ndarray:
    """bool [height,width]: clearly another colour."""
    return np.abs(picture.astype(int) - other).max(axis=2) > 8


def count_near(picture: np.ndarray, colour) -> int:
    """How many pixels have a colour of the legend, unshaded; Blender's rounding is coarse."""
    return int((np.abs(picture - np.array(colour) * 255).max(axis=2) < 12).sum())


def test_overlays_are_seen_and_leave_nothing(window, pictures) -> None:
    result = window.run("seeing.overlays", pictures)
    assert result["left"] == []
    seen = result["pictures"]
    assert not differs(seen["none"], seen["none again"]).any()
    for name in OVERLAYS:
        assert differs(seen[name], seen["none"]).sum() > 2 * LEGEND_PIXELS, name
    assert len({seen[name].tobytes() for name in OVERLAYS}) == len(OVERLAYS)
    for count in range(6):  # the legend's swatches at least
        assert count_near(seen["INFLUENCES"], colours.COUNT_COLOURS[count]) > 100
    for name, ramp in (("RESIDUAL", colours.HEAT), ("CHANGE", colours.SHARE)):
        assert all(count_near(seen[name], ramp[stop]) > 10 for stop in (2, 64, 128, 192, 253))


def test_an_overlay_follows_the_pose(window, pictures) -> None:
    bent, other, again = window.run("seeing.moved", pictures)
    assert differs(bent, other).sum() > 1000
    assert not differs(bent, again).any()


def test_a_fault_turns_the_overlay_off_and_is_told(window, pictures) -> None:
    seen = window.run("seeing.fault", pictures, quiet=False)
    assert seen["overlay"] == "NONE" and "overlay was turned off" in seen["told"]
    assert differs(seen["after"], seen["none"]).sum() > LEGEND_PIXELS  # it works again


def test_before_and_after(window, pictures) -> None:
    result = window.run("seeing.compare", pictures)
    states = {each["what"]: each for each in result["seen"]}
    assert not np.array_equal(result["start"], result["now"])
    after = states["after"]["picture"]
    for what, state in states.items():
        is_before = what in ("held", "switched")
        assert np.array_equal(state["mesh"], result["start" if is_before else "now"]), what
        assert (differs(state["picture"], after).sum() > 5000) == is_before, what


def test_the_clip_is_played_and_the_scene_put_back(window, pictures) -> None:
    seen = window.run("seeing.clip", pictures)
    assert seen["range"] == (True, 11, 31)
    assert len(set(seen["frames"])) > 3 and set(seen["frames"]) <= set(range(11, 32))
    assert seen["after"] == [seen["before"]] * 2
