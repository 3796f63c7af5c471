"""Strokes that remember: pins over poses, mix and mask, smoothing, rest positions, shapes, refit."""

from __future__ import annotations

import numpy as np
import pytest
import rigs
from core import SkindError

ANGLES = {"bent": 0.3, "back": -0.25, "far": 0.55}


@pytest.fixture
def link(daemon):
    with daemon.link() as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(900)})
        for name, angle in ANGLES.items():
            link.call("pose.set", {"session": "sheet", "pose": name, "matrices": rigs.bent(angle)})
        yield link


def posed(link, pose: str = "bent", vertices=None) -> np.ndarray:
    some = {} if vertices is None else {"vertices": vertices}
    return link.call("pose.evaluate", {"session": "sheet", "pose": pose, **some})["positions"]


def stroke(link, vertices, positions, pose: str = "bent", **options) -> dict:
    return link.call("stroke.apply", {"session": "sheet", "pose": pose, "vertices": vertices,
                                      "positions": np.asarray(positions, np.float32), **options})


def rows(link) -> tuple[bytes, bytes]:
    answer = link.call("weights.get", {"session": "sheet"})
    return answer["joints"].tobytes(), answer["weights"].tobytes()


def reachable(link, pose: str, seed: int = 3, size: float = 0.08) -> tuple:
    """A bump's vertices, and where they would be with other weights in the slots that they have."""
    rig = rigs.sheet(900)
    answer = link.call("weights.get", {"session": "sheet"})
    weights = answer["weights"].astype(float)
    rng = np.random.default_rng(seed)
    other = rng.uniform(size=weights.shape) * (answer["joints"] != 65535)
    other /= other.sum(1, keepdims=True)
    mixed = (1 - size) * weights + size * other
    vertices, _ = rigs.bump(rig["positions"], 450, 0.25, 0.0)
    wanted = rigs.skin(rig, rigs.bent(ANGLES[pose]), answer["joints"], mixed)
    return vertices, wanted[vertices].astype(np.float32), mixed


def distance(a, b) -> float:
    return float(np.linalg.norm(np.asarray(a, float) - b, axis=-1).mean())


def test_a_stroke_in_a_second_pose_keeps_the_first(link) -> None:
    vertices, first, mixed = reachable(link, "bent")
    rig = rigs.sheet(900)
    joints = link.call("weights.get", {"session": "sheet"})["joints"]
    second = rigs.skin(rig, rigs.bent(ANGLES["back"]), joints, mixed)[vertices]
    errors = {}
    for pin in ("none", "set"):
        answer = stroke(link, vertices, first, "bent", pin=pin, stiffness=1e-3)
        assert answer["poses"] == 1
        answer = stroke(link, vertices, second, "back", pin=pin, stiffness=1e-3)
        assert answer["poses"] == (2 if pin == "set" else 1)
        errors[pin] = distance(posed(link, "bent", vertices), first)
        for _ in range(2):
            link.call("history.undo", {"session": "sheet"})
    assert errors["set"] < 0.5 * errors["none"]


def test_pins_are_listed_got_and_undone(link) -> None:
    vertices, targets, _ = reachable(link, "bent")
    assert link.call("pins.list", {"session": "sheet"})["pins"] == []
    stroke(link, vertices, targets)
    listed = link.call("pins.list", {"session": "sheet"})["pins"]
    assert listed == [{"pose": "bent", "vertices": len(vertices), "weight": 1, "current": True}]
    got = link.call("pins.get", {"session": "sheet", "pose": "bent"})
    np.testing.assert_array_equal(got["vertices"], np.sort(vertices))
    np.testing.assert_array_equal(got["positions"], targets[np.argsort(vertices)])
    assert (got["weights"] == 1).all()
    link.call("history.undo", {"session": "sheet"})
    assert link.call("pins.list", {"session": "sheet"})["pins"] == []
    link.call("history.redo", {"session": "sheet"})
    assert link.call("pins.list", {"session": "sheet"})["pins"] == listed


def test_a_pose_set_again_keeps_the_old_pins_apart(link) -> None:
    vertices, targets, _ = reachable(link, "bent")
    stroke(link, vertices, targets)
    link.call("pose.set", {"session": "sheet", "pose": "bent", "matrices": rigs.bent(0.9)})
    listed = link.call("pins.list", {"session": "sheet"})["pins"]
    assert [item["current"] for item in listed] == [False]
    assert stroke(link, vertices, posed(link, "bent", vertices))["poses"] == 2


def test_twenty_strokes_to_one_target_are_one(link) -> None:
    vertices, targets = rigs.bump(posed(link), 450, 0.25, 0.02)
    shown = []
    for _ in range(20):
        stroke(link, vertices, targets, stiffness=0.008)
        shown.append(posed(link, "far"))
    np.testing.assert_allclose(shown[-1], shown[0], atol=1e-6)


@pytest.mark.parametrize("pin", ["set", "move"])
def test_ten_out_and_ten_back_leave_nothing(link, pin) -> None:
    start = posed(link)
    vertices, targets = rigs.bump(start, 450, 0.25, 0.02)
    way = (targets - start[vertices]) / 10
    for turn in range(20):
        shown = posed(link, "bent", vertices)
        if pin == "move":
            stroke(link, vertices, shown + (way if turn < 10 else -way), pin=pin, stiffness=0.008)
        else:
            steps = turn + 1 if turn < 10 else 19 - turn
            stroke(link, vertices, start[vertices] + steps * way, pin=pin, stiffness=0.008)
    assert np.abs(posed(link) - start).max() <= 1e-6 * 1.5


def test_strokes_from_the_shown_surface_add_up(link) -> None:
    start = posed(link)
    vertices, targets = rigs.bump(start, 450, 0.25, 0.02)
    way = (targets - start[vertices]) / 20
    stroke(link, vertices, targets, stiffness=0.008)
    once = posed(link, "bent", vertices) - start[vertices]
    link.call("history.undo", {"session": "sheet"})
    for _ in range(20):
        stroke(link, vertices, posed(link, "bent", vertices) + way, pin="move", stiffness=0.008)
    kept = posed(link, "bent", vertices) - start[vertices]
    assert np.vdot(kept, once) / np.vdot(once, once) >= 0.98


def test_a_pin_does_not_wind_up_where_bones_cannot_follow(link) -> None:
    start = posed(link)
    vertices, targets = rigs.bump(start, 450, 0.2, 0.02)
    up = np.array([0, 0, 0.05], np.float32)
    for _ in range(30):
        stroke(link, vertices, posed(link, "bent", vertices) + up, pin="move")
    got = link.call("pins.get", {"session": "sheet", "pose": "bent"})
    apart = np.linalg.norm(got["positions"] - posed(link, "bent", got["vertices"]), axis=1)
    length = np.linalg.norm(np.ptp(rigs.sheet(900)["positions"], axis=0))
    assert apart.max() <= 0.05 + 0.03 * length + 1e-3


def test_stiffness_comes_from_the_data_unless_it_is_set(link) -> None:
    vertices, targets, _ = reachable(link, "bent")
    assert stroke(link, vertices, targets)["stiffness"] == pytest.approx(5e-4)
    far = targets + np.float32([0, 0, 0.3])
    assert stroke(link, vertices, far)["stiffness"] == pytest.approx(0.03)
    assert stroke(link, vertices, far, stiffness=0.011)["stiffness"] == 0.011


def test_mix_and_mask_draw_targets_to_the_surface(link) -> None:
    vertices, targets, _ = reachable(link, "bent")
    shown = posed(link, "bent", vertices)
    mask = np.linspace(0, 1, len(vertices), dtype=np.float32)
    answer = stroke(link, vertices, targets, mix=0.5, mask=mask)
    assert len(answer["residuals"]) == len(vertices)
    assert answer["vertices"] == len(vertices) - 1  # the first is held by its mask
    got = link.call("pins.get", {"session": "sheet", "pose": "bent"})
    by_vertex = dict(zip(got["vertices"].tolist(), got["positions"]))
    assert vertices[0] not in by_vertex
    for vertex, at, to, share in zip(vertices[1:], shown[1:], targets[1:], 0.5 * mask[1:]):
        np.testing.assert_allclose(by_vertex[int(vertex)], at + share * (to - at), atol=1e-6)
    with pytest.raises(SkindError, match=r"mask\[1\]"):
        stroke(link, vertices[:2], targets[:2], mask=np.array([1, 1.5], np.float32))


def test_residuals_are_told_by_vertex(link) -> None:
    vertices, targets = rigs.bump(posed(link), 450, 0.25, 0.05)
    order = np.random.default_rng(1).permutation(len(vertices))
    answer = stroke(link, vertices[order], targets[order])
    apart = np.linalg.norm(posed(link, "bent", vertices[order]) - targets[order], axis=1)
    np.testing.assert_allclose(answer["residuals"], apart, atol=2e-7)


def test_smoothing_brings_neighbours_together(link) -> None:
    rng = np.random.default_rng(2)
    rig = rigs.sheet(900)
    side = 30
    vertices, targets, _ = reachable(link, "bent")
    noisy = targets + rng.normal(0, 0.01, targets.shape).astype(np.float32)
    before = link.call("weights.get", {"session": "sheet"})["weights"]

    def roughness() -> float:
        answer = link.call("weights.get", {"session": "sheet"})
        dense = np.zeros((side * side, rigs.BONES))
        np.add.at(dense, (np.arange(side * side)[:, None], np.minimum(answer["joints"], 11)),
                  (answer["weights"] - before) * (answer["joints"] < 12))
        grid = dense.reshape(side, side, -1)
        return float(np.abs(np.diff(grid, axis=0)).mean() + np.abs(np.diff(grid, axis=1)).mean())

    rough = []
    for smooth in (0.0, 0.03):
        stroke(link, vertices, noisy, stiffness=1e-3, smooth=smooth)
        rough.append(roughness())
        link.call("history.undo", {"session": "sheet"})
    assert rough[1] < 0.5 * rough[0]
    assert len(rig["positions"]) == side * side


def test_pins_solve_again(link) -> None:
    vertices, targets, _ = reachable(link, "bent")
    stroke(link, vertices, targets, stiffness=0.02)
    stiff = distance(posed(link, "bent", vertices), targets)
    answer = link.call("pins.solve", {"session": "sheet", "pose": "bent", "stiffness": 1e-4})
    assert answer["vertices"] == len(vertices)
    loose = distance(posed(link, "bent", vertices), targets)
    assert loose < 0.2 * stiff
    assert answer["residual"]["after"]["mean"] == pytest.approx(loose, rel=1e-3)
    order = link.call("pins.get", {"session": "sheet", "pose": "bent"})
    apart = np.linalg.norm(posed(link, "bent", order["vertices"]) - order["positions"], axis=1)
    np.testing.assert_allclose(answer["residuals"], apart, atol=2e-7)
    few = link.call("pins.solve", {"session": "sheet", "pose": "bent", "vertices": vertices[:5],
                                   "stiffness": 0.02})
    assert few["vertices"] == 5
    with pytest.raises(SkindError) as caught:
        link.call("pins.solve", {"session": "sheet", "pose": "far"})
    assert caught.value.name == "no_pose"


def unreachable(link, size: float = 0.03) -> tuple:
    """A patch whose rest shape bulges: no weights can do that."""
    rig = rigs.sheet(900)
    answer = link.call("weights.get", {"session": "sheet"})
    vertices, bulged = rigs.bump(rig["positions"], 450, 0.2, size)
    rig["positions"] = rig["positions"].copy()
    rig["positions"][vertices] = bulged
    return vertices, {pose: rigs.skin(rig, rigs.bent(angle), answer["joints"], answer["weights"])[
        vertices].astype(np.float32) for pose, angle in ANGLES.items()}


@pytest.mark.parametrize("slots", ["keep", "evidence"])
def test_rest_positions_take_what_weights_cannot(link, slots) -> None:
    vertices, targets = unreachable(link)
    with pytest.raises(SkindError, match="second pose") as caught:
        stroke(link, vertices, targets["bent"], residual="rest")
    assert caught.value.name == "unsupported"
    before = rows(link), posed(link, "rest").tobytes()
    stroke(link, vertices, targets["bent"])
    answer = stroke(link, vertices, targets["back"], "back", residual="rest", slots=slots)
    assert 0 < answer["rest_moved"] <= len(vertices)
    length = link.call("session.info", {"session": "sheet"})["length"]
    for pose in ("bent", "back", "far"):
        assert distance(posed(link, pose, vertices), targets[pose]) < 2e-3 * length, pose
    rest = [link.call("mesh.get", {"session": "sheet"})[name] for name in ("rest", "positions")]
    moved = np.flatnonzero((rest[0] != rest[1]).any(1))
    assert len(moved) == answer["rest_moved"] and np.isin(moved, vertices).all()
    assert link.call("shapes.list", {"session": "sheet"})["rest_moved"] == len(moved)
    for _ in range(2):
        link.call("history.undo", {"session": "sheet"})
    assert (rows(link), posed(link, "rest").tobytes()) == before


def test_a_corrective_shape_is_for_its_pose(link) -> None:
    vertices, targets = unreachable(link)
    plain = posed(link, "far").tobytes(), posed(link, "bent").tobytes()
    weights = rows(link)
    answer = stroke(link, vertices, targets["bent"], residual="shape", stiffness=0.03)
    assert 0 < answer["shaped"] <= len(vertices)
    assert answer["residual"]["after"]["max"] < 1e-5
    np.testing.assert_allclose(posed(link, "bent", vertices), targets["bent"], atol=2e-6)
    got = link.call("shapes.get", {"session": "sheet", "pose": "bent"})
    assert len(got["vertices"]) == answer["shaped"]
    listed = link.call("shapes.list", {"session": "sheet"})["shapes"]
    assert listed == [{"pose": "bent", "vertices": answer["shaped"], "current": True}]
    again = stroke(link, vertices, targets["bent"] + np.float32([0, 0, 0.01]), stiffness=0.03)
    assert again["residual"]["after"]["max"] < 1e-5  # a shape that is there follows
    for _ in range(2):
        link.call("history.undo", {"session": "sheet"})
    assert (posed(link, "far").tobytes(), posed(link, "bent").tobytes()) == plain
    assert rows(link) == weights


def test_listeners_are_told_rest_and_shape(daemon, link) -> None:
    vertices, targets = unreachable(link)
    with daemon.link(name="other") as other:
        other.call("session.attach", {"session": "sheet", "revision": 0})
        stroke(link, vertices, targets["bent"])
        stroke(link, vertices, targets["back"], "back", residual="rest")
        stroke(link, vertices, targets["far"], "far", residual="shape")
        link.call("history.undo", {"session": "sheet"})
        other.call("ping", {})
        notes = [note.params for note in other.notifications]
    assert [note["revision"] for note in notes] == [1, 2, 3, 4]
    assert "rest" in notes[1] and notes[2]["shape"] == "far" == notes[3]["shape"]
    assert not np.asarray(notes[3]["offsets"]).any()
    mesh = link.call("mesh.get", {"session": "sheet"})
    np.testing.assert_array_equal(mesh["rest"][notes[1]["vertices"]], notes[1]["rest"])


def test_a_refit_finds_the_weights_of_a_clip_of_meshes(daemon) -> None:
    rig = rigs.sheet(900)
    nearest = dict(rig)
    along = np.linalg.norm(
        rig["positions"][:, None, 1:2] - np.arange(rigs.BONES)[None, :, None] / rigs.BONES, axis=-1)
    count = len(rig["positions"])
    nearest["influence_offsets"] = np.arange(count + 1, dtype=np.uint32)
    nearest["influence_joints"] = along.argmin(1).astype(np.uint16)
    nearest["influence_weights"] = np.ones(count, np.float32)
    with daemon.link() as link:
        link.call("session.create", {"name": "truth", **rig})
        link.call("session.create", {"name": "sheet", **nearest})
        frames, names = [], []
        for index, angle in enumerate((0.3, -0.4, 0.2, 0.6, -0.7)):
            names.append(f"frame {index}")
            for session in ("truth", "sheet"):
                link.call("pose.set", {"session": session, "pose": names[-1],
                                       "matrices": rigs.bent(angle)})
            frames.append(link.call("pose.evaluate", {"session": "truth", "pose": names[-1]})[
                "positions"])
        answer = link.call("session.refit", {"session": "sheet", "poses": names[:4],
                                             "positions": np.concatenate(frames[:4])})
        assert answer["vertices"] == count and answer["poses"] == 4
        left = [link.call("pose.evaluate", {"session": "sheet", "pose": name})["positions"] - frame
                for name, frame in zip(names[:4], frames[:4])]
        np.testing.assert_allclose(answer["residuals"],
                                   np.sqrt((np.stack(left) ** 2).sum(2).mean(0)), atol=1e-6)
        shown = link.call("pose.evaluate", {"session": "sheet", "pose": names[4]})["positions"]
        assert np.sqrt(((shown - frames[4]) ** 2).sum(1).mean()) < 1e-3
        link.call("history.undo", {"session": "sheet"})
        joints = link.call("weights.get", {"session": "sheet"})["joints"]
        assert (joints[:, 0] == nearest["influence_joints"]).all()
        with pytest.raises(SkindError) as caught:
            link.call("session.refit", {"session": "sheet", "poses": names[:2],
                                        "positions": frames[0]})
        assert caught.value.name == "count_mismatch"


def test_poses_that_tell_too_little_are_told(link) -> None:
    everyone = np.arange(900, dtype=np.uint32)
    for angle, warned in ((0.002, ["poses_alike"]), (0.4, [])):
        for name, sign in (("first", 1), ("second", -1)):
            link.call("pose.set", {"session": "sheet", "pose": name,
                                   "matrices": rigs.bent(sign * angle)})
            answer = stroke(link, everyone, posed(link, name), name, slots="evidence")
        assert [warning["name"] for warning in answer["warnings"]] == warned
        for _ in range(2):
            link.call("history.undo", {"session": "sheet"})


@pytest.mark.parametrize("method", ["weights.set", "weights.mirror"])
def test_weights_that_are_not_solved_for_take_pins_away(link, method) -> None:
    vertices, targets, _ = reachable(link, "bent")
    stroke(link, vertices, targets)
    listed = link.call("pins.list", {"session": "sheet"})["pins"]
    if method == "weights.set":
        weights = link.call("weights.get", {"session": "sheet", "vertices": vertices})["weights"]
        link.call(method, {"session": "sheet", "vertices": vertices, "weights": weights})
    else:
        # Written side: what lies below the middle of the sheet, half of the pinned patch or so.
        link.call(method, {"session": "sheet", "axis": "x", "origin": 0.5})
    left = link.call("pins.list", {"session": "sheet"})["pins"]
    assert sum(item["vertices"] for item in left) < listed[0]["vertices"]
    link.call("history.undo", {"session": "sheet"})
    assert link.call("pins.list", {"session": "sheet"})["pins"] == listed


def test_a_locked_vertex_gets_no_pin(link) -> None:
    vertices, targets, _ = reachable(link, "bent")
    answer = stroke(link, vertices, targets, locked_vertices=vertices[:7])
    assert answer["poses"] == 1
    pinned = link.call("pins.get", {"session": "sheet", "pose": "bent"})["vertices"]
    np.testing.assert_array_equal(pinned, np.sort(vertices[7:]))
