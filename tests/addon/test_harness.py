"""The harness proves itself: each Blender answers, rigs are made, strokes change the mesh."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from blenders import ASSETS, BPY_VERSIONS, DEBIAN, Blender, Failed, Window
from characters import CHARACTERS


def test_version_and_private_folders(blender: Blender) -> None:
    facts = blender.run("harness.version", addon=None)
    expected = BPY_VERSIONS.get(blender.version, DEBIAN)
    assert ".".join(map(str, facts["version"])).startswith(expected)
    assert facts["background"]
    assert Path(facts["config"]).is_relative_to(blender.home)
    assert facts["socket"] == str(blender.socket)


def test_values_come_back(blender: Blender) -> None:
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    answer = blender.run("harness.double", values, addon=None)
    assert answer["doubled"].dtype == np.float32
    assert np.array_equal(answer["doubled"], values * 2)
    assert answer["nested"] == [(2, 3), None]


def test_failures_come_back(blender: Blender) -> None:
    with pytest.raises(Failed, match="ValueError: this is why"):
        blender.run("harness.fail", addon=None)
    with pytest.raises(Failed, match="something else in Blender failed"):
        blender.run("harness.mutter", addon=None)
    assert blender.run("harness.mutter", addon=None, quiet=False) == 1
    with pytest.raises(Failed, match=r"without a result(.|\n)*in hang"):
        blender.run("harness.hang", addon=None, seconds=2)


def test_kill(blender: Blender) -> None:
    job = blender.start("harness.hang", addon=None)
    job.kill()
    with pytest.raises(Failed, match="status -9"):
        job.result()


def test_addon_is_enabled_from_a_folder(blender: Blender, tmp_path: Path) -> None:
    """Under the name skind, with preferences, from whatever folder holds it."""
    (tmp_path / "__init__.py").write_text(
        "import bpy\n"
        "bl_info = {'name': 'trial', 'blender': (3, 4, 0), 'category': 'Mesh'}\n"
        "class Preferences(bpy.types.AddonPreferences):\n"
        "    bl_idname = __package__\n"
        "    path: bpy.props.StringProperty(default='here')\n"
        "def register(): bpy.utils.register_class(Preferences)\n"
        "def unregister():\n"
        "    bpy.utils.unregister_class(Preferences)\n"
        "    print('farewell')\n")
    job = blender.start("harness.preference", "path", addon=tmp_path)
    assert job.result() == "here"
    (tmp_path / "__init__.py").write_text("import nothing_of_this_name\n")
    with pytest.raises(Failed, match="nothing_of_this_name"):
        blender.run("harness.version", addon=tmp_path)


def assert_moves(facts: dict) -> None:
    """A skinned mesh that stands at rest as modelled and that a pose moves."""
    size = np.ptp(facts["co"], axis=0).max()
    assert facts["modifiers"] == ["ARMATURE"]
    assert np.abs(facts["rest"] - facts["co"]).max() < 1e-5 * size
    assert np.abs(facts["posed"] - facts["rest"]).max() > 0.01 * size


@pytest.mark.parametrize("vertices", [1000, 100_000])
def test_tube(blender: Blender, vertices: int) -> None:
    facts = blender.run("harness.tube", vertices, 8, addon=None)
    assert_moves(facts)
    assert facts["co"].shape == (vertices, 3)
    assert np.abs(facts["weights"].sum(1) - 1).max() < 1e-6
    assert (facts["weights"] > 0).sum(1).max() == 4


def test_rigify(blender: Blender) -> None:
    facts = blender.run("harness.rigify", addon=None)
    assert_moves(facts)
    assert facts["bones"] > facts["deform"] > 20
    assert facts["bendy"] == 0
    assert facts["weights"].shape[1] == facts["deform"]
    assert blender.run("harness.rigify", bendy=True, addon=None)["bendy"] > 0


@pytest.mark.skipif(not ASSETS.is_dir(), reason="the shared assets are not here")
def test_characters(blender: Blender) -> None:
    answers = blender.run("harness.imported", addon=None, characters=[
        (str(ASSETS / character.file), character.mesh) for character in CHARACTERS])
    for character, facts in zip(CHARACTERS, answers, strict=True):
        assert_moves(facts)
        assert not facts["keys"] and facts["users"] == 1
        assert len(facts["co"]) == character.vertices
        assert facts["bones"] == facts["deform"] == character.bones
        assert (facts["weights"] > 0).sum(1).max() == character.influences
        assert facts["clips"] == character.clips
        assert (np.abs(facts["weights"].sum(1) - 1).max() < 1e-4) == character.exact


@pytest.mark.skipif(not ASSETS.is_dir(), reason="the shared assets are not here")
def test_clip(blender: Blender) -> None:
    first, middle, again = blender.run(
        "harness.played", str(ASSETS / "bevy_fox" / "Fox.glb"), "Run", [0, 14, 0], addon=None)
    assert np.array_equal(first, again)
    assert np.abs(middle - first).max() > 1


def test_strokes_in_a_window(window: Window, tmp_path: Path) -> None:
    picture = tmp_path / "window.png"
    facts = window.run("harness.strokes", 10, str(picture), addon=None)
    assert len(facts["moved"]) == 10
    assert min(facts["moved"]) > 1e-3, facts["moved"]
    assert facts["pressed"] > 1e-3
    assert facts["undone"]
    assert facts["size"] == window.screen
    assert window.server is not None and window.server.poll() is None
    window.close()
    with pytest.raises(ProcessLookupError):
        os.kill(window.server.pid, 0)
