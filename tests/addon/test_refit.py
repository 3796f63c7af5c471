"""Refit in real Blenders: weights from another mesh that moves."""

from __future__ import annotations

import os
from typing import Iterator

import pytest

from blenders import Blender
from daemons import BIN


@pytest.fixture(autouse=True)
def programs(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The add-on starts the daemon of this build."""
    monkeypatch.setenv("PATH", str(BIN), prepend=os.pathsep)
    yield


@pytest.mark.parametrize("aside", [0.0, 3.0])
def test_weights_come_from_another_mesh(blender: Blender, aside: float) -> None:
    found = blender.run("refitting.refitted", aside)
    assert found["before"] > 1e-2 * found["length"]
    assert found["after"] <= 1e-4 * found["length"], found["told"]
    assert found["untouched"] and found["equal"] and found["undone"]
    assert "Refitted" in found["told"]


def test_what_is_no_mesh_to_refit_to(blender: Blender) -> None:
    found = blender.run("refitting.refused")
    assert "choose the mesh" in found["none"] and "choose the mesh" in found["bones"]
    assert "another object" in found["self"] and "vertices" in found["other"]
    assert "too many" in found["many"] and found["fine"] == ""
    assert found["kept"]
