"""Enabling and disabling without leftovers, the panel's states, and which options are sent."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Iterator

import pytest

from blenders import ADDON, Blender, Window
from core import options
from daemons import Daemon

EVERYTHING = frozenset(capability for capability, _ in options.NEEDS.values())
HELLO = {"server": {"name": "skind", "version": "0.1.0"}, "capabilities": ["locks"]}


def settings(**changed: object) -> SimpleNamespace:
    return SimpleNamespace(**{"stiffness": 0.008, "method": "exact", **changed})


def test_enabled_twice_nothing_is_left(blender: Blender) -> None:
    before, enabled, between, again, after = blender.run("packages.twice", str(ADDON), addon=None)
    assert before["types"] == before["operators"] == before["properties"] == []
    assert {"SKIND_PT_main", "SKIND_OT_start"} <= set(enabled["types"])
    assert "Scene.skind" in enabled["properties"]
    assert again == enabled
    assert between == after == before


@pytest.fixture
def tall(folder: Path) -> Iterator[Window]:
    """A window with room for the whole panel."""
    instance = Window(folder, screen=(900, 1150))
    yield instance
    instance.close()


def test_the_panel_draws_each_state(tall: Window, daemon: Daemon, tmp_path: Path) -> None:
    # A fault while drawing prints a traceback, which fails the job; nothing else would show it.
    seen = tall.run("panels.states", str(tmp_path))
    assert "has shape keys" in seen["shown"][0]
    assert seen["shown"][0] in seen["reported"]
    assert seen["forgotten"] == []
    assert seen["last"]["revision"] == 1
    assert seen["notes"] == ["weights_normalised"]
    pictures = {path.stem: path.read_bytes() for path in tmp_path.glob("*.png")}
    assert set(pictures) == {"idle", "refused", "connected", "sculpting"}
    assert len(set(pictures.values())) == 4


@pytest.mark.parametrize(("changed", "capabilities", "locked", "sent"), [
    ({}, frozenset(), (), {"stiffness": 0.008, "method": "exact"}),
    ({}, EVERYTHING, (), {"stiffness": 0.008, "method": "exact"}),
    # Blender's floats are single: what the artist typed goes out, not its neighbour.
    ({"stiffness": 0.00800000037997961}, EVERYTHING, (), {"stiffness": 0.008, "method": "exact"}),
    ({"method": "thesis"}, EVERYTHING, (), {"stiffness": 0.008, "method": "thesis"}),
    ({"method": "thesis"}, frozenset(), (), {"stiffness": 0.008}),
    ({}, EVERYTHING, ("hand", "arm"),
     {"stiffness": 0.008, "method": "exact", "locked_bones": ["hand", "arm"]}),
    ({}, EVERYTHING - {"locks"}, ("hand",), {"stiffness": 0.008, "method": "exact"}),
    # Members that no daemon names yet are never sent.
    ({"keep_poses": 0.5, "smoothing": 1.0, "residual": "REST"}, frozenset(), (),
     {"stiffness": 0.008, "method": "exact"}),
])
def test_only_what_the_daemon_can_do_is_sent(changed: dict, capabilities: frozenset, locked: tuple,
                                             sent: dict) -> None:
    assert options.usable(settings(**changed), capabilities, locked) == sent


def test_a_reason_names_the_daemon_and_the_capability() -> None:
    assert options.reason("locks", HELLO) == ""
    assert options.reason("influences.4", HELLO) == ""
    assert options.reason("keep_poses", HELLO) == \
        "skind 0.1.0 cannot keep other poses yet: needs capability `guards`."
    assert "once it answers" in options.reason("keep_poses", {})


def test_every_option_has_its_reason() -> None:
    for option in options.NEEDS:
        assert options.reason(option, {**HELLO, "capabilities": []})
        assert not options.reason(option, {**HELLO, "capabilities": list(EVERYTHING)})
