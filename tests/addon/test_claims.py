"""Who else is in a session, and what they claim, in real Blenders."""

from __future__ import annotations

import getpass
import os
import re
from pathlib import Path

import numpy as np
import pytest

from blenders import Blender
from daemons import Daemon

GREYER = 0.9  # of the brightness that it had: clearly darker, and still to be read


def test_who_is_here_and_a_stroke_into_a_claim(blender: Blender, daemon: Daemon) -> None:
    seen = blender.run("claims.told")
    assert (seen["alone"], seen["shown"], seen["noticed"]) == (False, True, True)
    assert (seen["name"], seen["tool"]) == ("Ben", "skinctl")
    assert "claimed by Ben (skinctl)." in seen["warning"]
    assert seen["after"] == seen["warning"] or "claimed" not in seen["after"]


def test_the_button_claim(blender: Blender, daemon: Daemon) -> None:
    seen = blender.run("claims.claiming")
    assert len(seen["refused"]) == 3
    assert seen["user"] == getpass.getuser() and re.fullmatch(
        r"Blender [0-9.]+ \([0-9a-f]{6}\)", seen["client"])
    (bones, _), (masked, vertices), (chosen, three), (_, every) = seen["claims"]
    assert bones == {"bones": ["bone.2", "bone.4"], "vertices": 0}
    assert masked == {"bones": [], "vertices": len(vertices)}
    assert vertices == list(range(1, 2 * len(vertices), 2)) and len(vertices) > 500
    assert chosen["vertices"] == 3 and three == [0, 1, 2]
    assert every == list(range(len(every))) and len(every) == 2 * len(vertices)
    assert not any(claim["bones"] or claim["vertices"] for claim in seen["released"].values())
    assert not seen["may_release"]


def test_a_name_and_a_port_from_the_preferences(blender: Blender, start, folder: Path,
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    there = start("--tcp", "0", socket=folder / "far.sock")
    token, port = Path(f"{there.socket}.token").read_text().splitlines()
    monkeypatch.setenv("SKIND_TOKEN", token)
    path, alone = blender.run("claims.preferred", f"tcp:{port}", " Anna ")
    assert path == f"tcp:{port}" and alone["user"] == "Anna"


@pytest.fixture
def pictures(folder: Path, request: pytest.FixtureRequest) -> str:
    kept = os.environ.get("SKIND_PICTURES")
    path = Path(kept, request.node.name) if kept else folder
    path.mkdir(parents=True, exist_ok=True)
    return str(path)


def brightness(picture: np.ndarray, pixels: list[tuple[int, int]]) -> np.ndarray:
    return np.array([picture[y, x].mean() for x, y in pixels])


def test_what_others_claim_is_greyed_over_every_overlay(window, daemon: Daemon,
                                                        pictures: str) -> None:
    result = window.run("claims.overlays", pictures)
    seen, pixels = result["pictures"], result["pixels"]
    assert result["left"] == [] and "overlay was turned off" not in result["told"]
    assert min(len(each) for each in pixels.values()) > 20
    for overlay in ("NONE", "INFLUENCES", "RESIDUAL"):
        free, claimed, released = (seen[overlay, when] for when in ("free", "claimed", "released"))
        upper = brightness(claimed, pixels["upper"]) / brightness(free, pixels["upper"])
        lower = brightness(claimed, pixels["lower"]) / brightness(free, pixels["lower"])
        assert (upper < GREYER).mean() > 0.95 and (upper > 0.2).mean() > 0.95, overlay
        assert (abs(lower - 1) < 0.03).mean() > 0.95, overlay
        assert np.array_equal(free, released), overlay
    # What the overlay says is still to be read beneath it: colours that differed still do.
    colours = [seen["INFLUENCES", "claimed"][y, x] for x, y in pixels["upper"]]
    assert len({tuple(colour // 24) for colour in colours}) > 1


def test_a_clip_that_plays_is_not_held_up_for_a_claim(window, daemon: Daemon) -> None:
    still, playing, after = window.run("claims.playing")
    assert still == playing != after
