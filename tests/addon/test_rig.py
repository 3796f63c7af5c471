"""Reading rigs, the vertex groups' slots, and refusals, in each real Blender."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from blenders import ROOT, Blender

ASSETS = ROOT.parent / "shared" / "assets"
CHARACTERS = ["bevy_fox/Fox.glb", "kaykit_adventurers/Knight.glb", "raylib_robot/robot.glb",
              "khronos_cesium/cesium_man.gltf", "makehuman/mh_body_12inf.glb",
              "webxr_generic_hand/left.glb", "awkward/zero_weight_vertices.glb",
              "awkward/weights_sum_not_one.glb"]
LARGEST_ERROR = 1e-6  # of the mesh's length

# A word or two of each refusal's cure.
CURES = {
    "an armature": "click on the character's mesh",
    "no modifier": "With Automatic Weights",
    "hidden modifier": "switch its screen icon on",
    "two armatures": "hide all but one",
    "not first": "drag the Armature modifier to the top",
    "displace after": "hide it by its screen icon",
    "nodes after": "hide it by its screen icon",
    "multires": "apply or remove it",
    "no armature": "choose it in the field Object",
    "preserve volume": "Preserve Volume",
    "envelopes": "Bind To > Bone Envelopes",
    "no groups": "Bind To > Vertex Groups",
    "vertex group": "empty the field Vertex Group",
    "multi modifier": "Multi Modifier",
    "bendy bone": "Segments to 1 for \u201cbone.2\u201d",
    "envelope multiply": "switch it off for \u201cbone.2\u201d",
    "no deform bones": "Bone Properties > Deform",
    "shape keys": "Object Data Properties > Shape Keys",
    "shared": "Object > Relations > Make Single User",
    "linked": "Object > Relations > Make Local",
    "override": "Object > Relations > Make Local",
    "no faces": "Choose another mesh",
    "not numbers": "delete them",
    "no weights": "With Automatic Weights",
    "hidden": "Show Hidden Objects",
    "flat mesh": "change its Scale",
    "flat armature": "change its Scale",
    "parent deforms": "Parent Type",
    "edit mode": "leave it first (Tab)",
    "armature edited": "leave it first (Tab)",
    "dyntopo": "switch it off in the header of Sculpt Mode",
}


def asset(name: str) -> str:
    path: Path = ASSETS / name
    if not ASSETS.is_dir():
        pytest.skip("the shared assets are not there")
    return str(path)


@pytest.mark.parametrize("kind", ["tube", "rigify", *CHARACTERS])
def test_skinning_is_blenders(blender: Blender, kind: str) -> None:
    """Linear blend skinning of what was read is the evaluated mesh, in any pose."""
    errors = blender.run("rigging.skinning_errors",
                         asset(kind) if kind in CHARACTERS else kind)
    assert len(errors) >= 4
    assert max(errors.values()) <= LARGEST_ERROR, errors


def test_skinning_follows_objects(blender: Blender) -> None:
    """Also when mesh or armature are moved, turned, scaled or mirrored, before or after Start."""
    errors = blender.run("rigging.moved_errors")
    assert len(errors) == 10
    assert max(errors.values()) <= LARGEST_ERROR, errors


def test_what_is_read(blender: Blender) -> None:
    facts = blender.run("rigging.facts")
    assert facts["names"] == [f"bone.{index}" for index in range(8) if index != 3]
    assert facts["parents"].tolist() == [-1, 0, 1, 2, 3, 4, 5]
    assert np.array_equal(facts["dense"], facts["wanted"])
    assert facts["zeros"] == 0
    assert 7 in facts["unweighted"]
    assert facts["error"] <= LARGEST_ERROR
    assert facts["positions"].tobytes() == facts["co"].tobytes()
    assert [tuple(each) for each in facts["triangles"].tolist()] == facts["drawn"]
    assert facts["dtypes"] == {
        "positions": "float32", "triangles": "uint32", "parents": "int32", "binds": "float64",
        "offsets": "uint32", "joints": "uint16", "weights": "float32"}


def expect_round_trip(found: dict) -> None:
    assert found["influences"] <= 4
    assert found["error"] <= LARGEST_ERROR
    wrong = [name for name, value in found.items() if value is False]
    assert not wrong


@pytest.mark.parametrize("kind", ["tube", "rigify", *CHARACTERS])
def test_start_write_cancel(blender: Blender, kind: str) -> None:
    """Slots show nothing; rows come back; Cancel and an idle Finish leave the mesh to the bit."""
    expect_round_trip(blender.run("rigging.round_trip",
                                  asset(kind) if kind in CHARACTERS else kind))


@pytest.mark.parametrize("meddle", ["group removed", "group renamed", "entries changed"])
def test_cancel_after_meddling(blender: Blender, meddle: str) -> None:
    """The artist may have changed groups and weights meanwhile."""
    expect_round_trip(blender.run("rigging.round_trip", "tube", meddle))


def test_mesh_without_groups(blender: Blender) -> None:
    found = blender.run("rigging.bare")
    assert found["made"] == ["bone.0", "bone.1", "bone.2"]
    assert found["skipped"] == 0 and found["least"] > 0
    assert found["restored"]


def test_stale_layout_is_told(blender: Blender) -> None:
    found = blender.run("rigging.stale")
    assert all("made again" in sentence for sentence in found.values()), found


def test_weights_keep_their_bits(blender: Blender) -> None:
    assert blender.run("rigging.exact_bits")


def test_broken_snapshots(blender: Blender) -> None:
    """What a file holds is checked: cut, changed or hostile bytes are a ValueError."""
    found = blender.run("rigging.broken_snapshots")
    assert found["accepted"] == []
    assert found["tried"] > 100


def test_work_comes_in_pieces(blender: Blender) -> None:
    """Of 500 vertices and less, so that Blender lives meanwhile; test_pen.py has the time."""
    found = blender.run("rigging.pieces", 20000)
    assert min(found.values()) >= 20000 / 500, found


def test_refusals(blender: Blender) -> None:
    found = blender.run("rigging.all_refused")
    assert set(found) == set(CURES)
    for case, (before, after) in found.items():
        assert before == [], case
        assert len(after) == 1, (case, after)
        assert CURES[case] in after[0], (case, after)
    assert "click on" in blender.run("rigging.nothing")[0]


def test_influences_that_do_not_fit(blender: Blender) -> None:
    found = blender.run("rigging.limits")
    assert found["8"] == found["reduce"] == found["join"] == []
    assert found["4"][0].startswith("3 vertices have more than 4 influences (up to 8)")


def test_what_is_not_refused(blender: Blender) -> None:
    found = blender.run("rigging.allowed")
    assert len(found) == 10
    assert {name: told for name, told in found.items() if told} == {}


def test_rigify_as_it_is_made(blender: Blender) -> None:
    """Rigify gives its bones segments; the sentence tells what to do about them."""
    told = blender.run("rigging.rigify_bendy")
    assert len(told) == 1 and "Segments to 1" in told[0] and "more" in told[0]
