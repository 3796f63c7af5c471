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
    return SimpleNamespace(**{
        "automatic": True, "stiffness": 0.008, "method": "exact", "slots": "KEEP", "keep": False,
        "keep_strength": 0.3, "smoothing": 0.0, "mix": 1.0, "residual": "REPORT", **changed})


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
    assert seen["last"]["revision"] == 2
    assert seen["notes"] == ["weights_normalised"]
    pictures = {path.stem: path.read_bytes() for path in tmp_path.glob("*.png")}
    assert set(pictures) == {"idle", "refused", "connected", "sculpting", "poses",
                             "alone with one", "shared", "left", "not kept"}
    assert len(set(pictures.values())) == len(pictures)
    assert seen["pins"] == 1 and seen["kept"] == 1


ALWAYS = {"pin": "move", "guard": 0.0}  # sent to a daemon that can do everything


@pytest.mark.parametrize(("changed", "capabilities", "locked", "sent"), [
    ({}, frozenset(), (), {"stiffness": 0.008}),
    ({}, EVERYTHING, (), ALWAYS),
    # Blender's floats are single: what the artist typed goes out, not its neighbour.
    ({"automatic": False, "stiffness": 0.00800000037997961}, EVERYTHING, (),
     {**ALWAYS, "stiffness": 0.008}),
    ({"method": "thesis"}, EVERYTHING, (), {"method": "thesis"}),
    ({"method": "thesis"}, frozenset(), (), {"stiffness": 0.008}),
    # The thesis's method is asked for nothing that it does not know.
    ({"method": "thesis", "slots": "EVIDENCE", "keep": True, "mix": 0.5, "residual": "REST",
      "smoothing": 0.1, "automatic": False}, EVERYTHING, ("arm",),
     {"method": "thesis", "stiffness": 0.008, "locked_bones": ["arm"]}),
    ({}, EVERYTHING, ("hand", "arm"), {**ALWAYS, "locked_bones": ["hand", "arm"]}),
    ({}, EVERYTHING - {"locks"}, ("hand",), ALWAYS),
    ({"keep": True, "keep_strength": 0.5, "smoothing": 0.03, "residual": "SHAPE", "mix": 0.25,
      "slots": "EVIDENCE"}, EVERYTHING, (),
     {"pin": "move", "guard": 0.5, "smooth": 0.03, "residual": "shape", "mix": 0.25,
      "slots": "evidence"}),
    # Members that this daemon does not name are never sent.
    ({"keep": True, "smoothing": 1.0, "residual": "REST", "mix": 0.5, "slots": "EVIDENCE"},
     frozenset(), (), {"stiffness": 0.008}),
])
def test_only_what_the_daemon_can_do_is_sent(changed: dict, capabilities: frozenset, locked: tuple,
                                             sent: dict) -> None:
    assert options.usable(settings(**changed), capabilities, locked) == sent


def test_a_reason_names_the_daemon_and_the_capability() -> None:
    assert options.reason("locks", HELLO) == ""
    assert options.reason("influences.4", HELLO) == ""
    assert options.reason("keep", HELLO) == \
        "skind 0.1.0 cannot keep other poses yet: needs capability `guards`."
    assert "once it answers" in options.reason("keep", {})


def test_every_option_has_its_reason() -> None:
    for option in options.NEEDS:
        assert options.reason(option, {**HELLO, "capabilities": []})
        assert not options.reason(option, {**HELLO, "capabilities": list(EVERYTHING)})
