"""Refit in real Blenders: weights that were lost are won back from another mesh's motion, and
nothing of the artist's is touched."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Iterator

import pytest

from blenders import Blender
from daemons import BIN


@pytest.fixture(autouse=True)
def programs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The add-on starts the daemon of this build."""
    monkeypatch.setenv("PATH", str(BIN), prepend=os.pathsep)
    yield


@pytest.mark.parametrize("source", ["copy", "cache"])
def test_lost_weights_are_won_back(blender: Blender, tmp_path: Path, source: str) -> None:
    found = blender.run("refitting.won_back", str(tmp_path) if source == "cache" else "")
    assert found["before"] > 0.01 and found["after"] <= 1e-4, found["told"]
    assert found["told"].startswith("Refitted 2,000 vertices: off by ")
    assert found["different"] == []
    assert found["equal"] and found["undone"] and found["redone"]
    assert found["states"] == 1


def test_a_baked_cloth_is_seen_as_the_artist_sees_it(blender: Blender) -> None:
    found = blender.run("refitting.from_a_bake")
    assert found["baked"] and max(found["apart"]) < 1e-5 and min(found["moved"]) > 1e-3


def test_cancelled(blender: Blender) -> None:
    for found in blender.run("refitting.cancelled").values():
        assert found["told"] == "Refit: cancelled."
        assert found["different"] == [] and found["whole"] and found["equal"]


def test_refused(blender: Blender) -> None:
    found = blender.run("refitting.refused")
    said = {
        "nothing": "choose the mesh to follow",
        "missing": "there is no object \u201cNobody\u201d",
        "itself": "is the mesh that you sculpt",
        "armature": "is not a mesh",
        "few": "has 3 vertices and not 2,000",
        "fine": "hide the modifiers that add or remove some",
        "cloth": "is not baked",
        "hidden": "is disabled in viewports",
        "backwards": "the last frame, 3, comes before the first, 9",
        "still": "the armature does not move in the frames 60 to 70",
        "many": f"{found['limit'] + 1} frames are more than skind takes, {found['limit']}",
    }
    for wish, sentence in said.items():
        assert found[wish].startswith("Refit: ") and sentence in found[wish], wish
        assert found[wish].endswith(".") and found[wish].count(". ") == 0
    assert found["different"] == [] and found["whole"]
