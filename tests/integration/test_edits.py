"""Edits of a session: mirror, prune, reduce, guard poses, pins that are weighed and cleared, and
bringing back what a daemon that died had held. Oracles in NumPy."""

from __future__ import annotations

import os
import subprocess
import time

import numpy as np
import pytest
import rigs
from core import SkindError
from daemons import BIN, ROOT
from followers import next_update
from test_seams import FILES, rings
from test_setting import bits, longest_ping, random_rows

NONE = 65535
MANY = 200_000 if os.environ.get("SKIND_QUICK") else 1_000_000
ASSETS = ROOT.parent / "shared" / "assets"
MAKEHUMAN = ASSETS / "makehuman" / "mh_body_12inf.glb"
KNIGHT = ASSETS / "kaykit_adventurers" / "Knight.glb"


class Body:
    """The project's own character, open in a daemon as "body"."""

    def __init__(self, link, folder, vertices: int = 3000, **more) -> None:
        path = folder / "body.glb"
        subprocess.run([BIN / "skinctl", "generate", "--vertices", str(vertices), path], check=True,
                       capture_output=True)
        self.link, self.path = link, path
        self.call("session.create", name="body", file=str(path), **more)
        info = self.call("session.info")
        self.names = [bone["name"] for bone in info["bones"]]
        self.length = info["length"]
        self.rest = np.asarray(self.call("mesh.get")["positions"])

    def call(self, method: str, arrays: dict | None = None, **params) -> dict:
        if method != "session.create":
            params["session"] = "body"
        return self.link.call(method, params, arrays or {})

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        got = self.call("weights.get")
        return np.asarray(got["joints"], np.uint16), np.asarray(got["weights"], np.float32)

    def dense(self) -> np.ndarray:
        """Weights [V,B], whatever the slots."""
        joints, weights = self.state()
        out = np.zeros((len(joints), len(self.names) + 1), np.float32)
        for slot in range(joints.shape[1]):
            columns = np.where(joints[:, slot] == NONE, len(self.names), joints[:, slot])
            out[np.arange(len(joints)), columns] += weights[:, slot]
        assert (out[:, -1] == 0).all()
        return out[:, :-1]

    def partners(self) -> np.ndarray:
        swap = {".L": ".R", ".R": ".L"}
        return np.array([self.names.index(name[:-2] + swap[name[-2:]])
                         if name[-2:] in swap else bone for bone, name in enumerate(self.names)])

    def posed(self, pose: str) -> np.ndarray:
        return np.asarray(self.call("pose.evaluate", pose=pose)["positions"], np.float64)

    def bump(self, pose: str, centre: int, radius: float = 0.25, **more) -> np.ndarray:
        vertices, targets = rigs.bump(self.posed(pose), centre, radius, 0.03)
        self.call("stroke.apply", {"vertices": vertices, "positions": targets}, pose=pose, **more)
        return vertices

    def scramble(self, seed: int, influences: int | None = None) -> None:
        """Random weights on the slots that there are, so many of them where told."""
        joints, _ = self.state()
        rows = random_rows(joints, seed)
        if influences is not None:
            order = np.argsort(-rows, axis=1)
            np.put_along_axis(rows, order[:, influences:], 0, 1)
            rows /= rows.sum(1, keepdims=True)
        self.call("weights.set", {"vertices": np.arange(len(rows), dtype=np.uint32),
                                  "weights": rows.astype(np.float32)})


@pytest.fixture
def body(daemon, folder):
    with daemon.link() as link:
        yield Body(link, folder)


def is_one(weights: np.ndarray) -> bool:
    return bool((np.abs(weights.astype(np.float64).sum(1) - 1) <= 1e-7).all())


# ---- mirror ---------------------------------------------------------------------------------


def test_a_symmetric_character_is_its_own_mirror(body) -> None:
    """All but the few vertices that make up the count that was asked for."""
    before = body.dense()
    answer = body.call("weights.mirror")
    assert answer["unmatched"] < 5 and answer["unpaired_bones"] == []
    np.testing.assert_allclose(body.dense(), before, atol=2e-6, rtol=0)


def nearest_by_looking(rest: np.ndarray, side: np.ndarray, limit: float) -> tuple:
    """(targets, sources): for each vertex not read the nearest to its reflection among those that
    are, or itself; without those that nothing is near enough to."""
    eps = 0.01 * limit
    sources = np.flatnonzero(side > eps)
    targets = np.flatnonzero(side <= eps)
    reflected = rest[targets] * [-1, 1, 1]
    found, near = np.empty(len(targets), int), np.empty(len(targets))
    for first in range(0, len(targets), 500):
        part = slice(first, first + 500)
        apart = np.linalg.norm(reflected[part, None] - rest[sources][None], axis=-1)
        own = 2 * np.abs(side[targets[part]])
        best = apart.argmin(1)
        itself = (own <= apart.min(1)) | (own <= 2 * eps)
        found[part] = np.where(itself, targets[part], sources[best])
        near[part] = np.where(itself, own, apart.min(1))
    return targets[near <= limit], found[near <= limit], int((near > limit).sum())


@pytest.mark.parametrize("side", ["+", "-"])
def test_mirror_against_numpy(body, side) -> None:
    body.scramble(1)
    joints, before = body.state()
    start, partners = body.dense(), body.partners()
    rest = body.rest.astype(np.float64)
    size = np.linalg.norm(rest.max(0) - rest.min(0))
    sign = 1 if side == "+" else -1
    targets, sources, unmatched = nearest_by_looking(rest, sign * rest[:, 0], 1e-3 * size)
    answer = body.call("weights.mirror", **{"from": side})
    after = body.dense()
    expected = start.copy()
    mirrored = start[:, partners]  # partners is its own inverse
    apart = sources != targets
    expected[targets[apart]] = mirrored[sources[apart]]
    np.testing.assert_array_equal(bits(after[targets[apart]]), bits(expected[targets[apart]]))
    read = np.setdiff1d(np.arange(len(rest)), targets)
    np.testing.assert_array_equal(bits(after[read]), bits(start[read]))
    plane = targets[~apart]
    assert len(plane) > 20
    np.testing.assert_allclose(after[plane], after[plane][:, partners], atol=3e-7, rtol=0)
    whole = 0.5 * (start[plane] + mirrored[plane])
    fits = (whole > 0).sum(1) <= 4
    np.testing.assert_allclose(after[plane][fits], whole[fits], atol=2e-7, rtol=0)
    assert answer["unmatched"] == unmatched and answer["vertices"] > 0.4 * len(rest)
    assert is_one(body.state()[1])
    body.call("history.undo")
    undone = body.state()
    np.testing.assert_array_equal(undone[0], joints)
    np.testing.assert_array_equal(bits(undone[1]), bits(before))


def test_a_real_character_is_its_own_mirror(daemon) -> None:
    if not MAKEHUMAN.exists():
        pytest.skip("the real characters are not here")
    with daemon.link() as link:
        link.call("session.create", {"name": "mh", "file": str(MAKEHUMAN), "influences": 8,
                                     "reduce": "largest"})
        answer = link.call("weights.mirror", {"session": "mh"})
        assert (answer["vertices"], answer["unmatched"], answer["unpaired_bones"]) == (0, 0, [])


def test_bones_without_names_are_told_about(daemon) -> None:
    """Nothing says which is whose partner, so what lies off the plane is named."""
    positions = np.array([[x, y, 0] for x in (-2, -1, 0, 1, 2) for y in (0, 1)], np.float32)
    binds = np.tile(np.eye(4), (3, 1, 1))
    binds[:, 0, 3] = [0, 1, -1]
    with daemon.link() as link:
        link.call("session.create", {
            "name": "plain", "positions": positions,
            "triangles": np.array([[0, 1, 2]], np.uint32),
            "bones": {"names": ["a", "b", "c"], "parents": np.array([-1, 0, 0], np.int32),
                      "binds": binds.reshape(-1, 16)},
            "influence_offsets": np.arange(11, dtype=np.uint32),
            "influence_joints": np.repeat([2, 2, 0, 1, 1], 2).astype(np.uint16),
            "influence_weights": np.ones(10, np.float32)})
        assert link.call("weights.mirror", {"session": "plain"})["unpaired_bones"] == ["b"]


def test_mirror_twice_is_mirror_once(body) -> None:
    body.scramble(2)
    body.call("weights.mirror")
    once = body.state()
    answer = body.call("weights.mirror")
    assert answer["vertices"] == 0 and answer["revision"] == 2
    np.testing.assert_array_equal(bits(body.state()[1]), bits(once[1]))
    before = body.dense()
    body.call("weights.mirror", **{"from": "-"})
    assert (bits(body.dense()) == bits(before)).all(1).mean() > 0.995


def test_a_stroke_goes_on_after_slots_changed(body) -> None:
    """The anchor follows: with no pull at all the next stroke leaves what was at the start."""
    body.call("pose.set", pose="bent", bend=25, seed=3)
    start = body.posed("bent")
    body.scramble(3)
    body.call("weights.mirror")
    assert np.abs(body.posed("bent") - start).max() > 0.01
    everyone = np.arange(len(start), dtype=np.uint32)
    body.call("stroke.apply", {"vertices": everyone, "positions": start.astype(np.float32)},
              pose="bent", stiffness=1e-4)
    assert np.abs(body.posed("bent") - start).mean() < 1e-3 * body.length
    for _ in range(3):
        body.call("history.undo")
    np.testing.assert_allclose(body.posed("bent"), start, atol=1e-7)


def test_what_lies_nowhere_is_unmatched(body) -> None:
    answer = body.call("weights.mirror", axis="y", origin=0.9, tolerance=1e-6)
    assert answer["unmatched"] > 500 and answer["vertices"] == 0
    assert answer["revision"] == 0


@pytest.mark.parametrize("lines", [False, True])
def test_everyone_hears_of_slots_that_changed(daemon, folder, lines) -> None:
    with daemon.link("painter") as link, daemon.link("viewer", lines=lines) as viewer:
        body = Body(link, folder)
        for other in (link, viewer):
            other.call("session.attach", {"session": "body"})
        body.scramble(4)
        joints, weights = (part.copy() for part in body.state())
        while next_update(viewer)["revision"] < body.call("session.info")["revision"]:
            pass
        link.notifications.clear()
        for method, more in (("mirror", {}), ("prune", {"below": 0.05}), ("reduce", {
                "influences": 2, "by": "size"})):
            body.call(f"weights.{method}", **more)
            for other in (link, viewer):
                told = next_update(other)
                assert (told["cause"], told["client"]) == (method, "painter")
            named = np.asarray(told["vertices"])
            weights[named] = told["weights"]
            if "joints" in told:
                joints[named] = told["joints"]
        now = body.state()
        np.testing.assert_array_equal(now[0], joints)
        np.testing.assert_array_equal(bits(now[1]), bits(weights))


# ---- prune ----------------------------------------------------------------------------------


@pytest.mark.parametrize("below", [0, 0.01, 0.1, 0.3, 1])
def test_prune_against_numpy(body, below) -> None:
    body.scramble(5)
    joints, before = body.state()
    answer = body.call("weights.prune", below=below)
    now_joints, after = body.state()
    key = np.where(before == before.max(1, keepdims=True), joints.astype(int), 1 << 20)
    largest = np.arange(before.shape[1]) == key.argmin(1)[:, None]
    gone = (before > 0) & (before < np.float32(below)) & ~largest
    expected = np.where(gone, 0, before.astype(np.float64))
    expected /= expected.sum(1, keepdims=True)
    np.testing.assert_array_equal(now_joints, joints)
    np.testing.assert_allclose(after, expected, atol=1.5e-7, rtol=0)
    same = ~gone.any(1)
    np.testing.assert_array_equal(bits(after[same]), bits(before[same]))
    assert is_one(after) and ((after > 0) == (expected > 0)).all()
    assert answer["removed"] == gone.sum() and answer["vertices"] == (~same).sum()
    if gone.any():
        body.call("history.undo")
        np.testing.assert_array_equal(bits(body.state()[1]), bits(before))


def test_prune_only_where_told(body) -> None:
    body.scramble(6)
    _, before = body.state()
    some = np.arange(100, 200, dtype=np.uint32)
    answer = body.call("weights.prune", {"vertices": some}, below=0.2)
    _, after = body.state()
    changed = np.flatnonzero((bits(after) != bits(before)).any(1))
    assert answer["vertices"] == len(changed) > 50
    assert np.isin(changed, some).all()


# ---- reduce ---------------------------------------------------------------------------------


@pytest.mark.parametrize("keep", [1, 2, 3, 8])
def test_reduce_by_size_against_numpy(body, keep) -> None:
    body.scramble(7)
    joints, before = body.state()
    answer = body.call("weights.reduce", influences=keep, by="size")
    _, after = body.state()
    order = np.lexsort((joints, -before.astype(np.float64)), axis=1)
    expected = before.astype(np.float64)
    np.put_along_axis(expected, order[:, keep:], 0, 1)
    expected /= expected.sum(1, keepdims=True)
    np.testing.assert_allclose(after, expected, atol=1.5e-7, rtol=0)
    assert is_one(after)
    assert answer["vertices"] == ((before > 0).sum(1) > keep).sum()
    assert (answer["moved"]["max"] > 0) == (answer["vertices"] > 0)


def moved_by(body: Body, poses: list[str], before: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([np.linalg.norm(body.posed(pose) - before[pose], axis=-1) for pose in poses])


@pytest.mark.parametrize("keep", [2, 3])
def test_reduce_by_poses_moves_less(body, keep) -> None:
    """In the poses named, and what is told is what NumPy measures."""
    poses = [f"bend{seed}" for seed in range(5)]
    for seed, pose in enumerate(poses):
        body.call("pose.set", pose=pose, bend=25, seed=seed)
    body.scramble(8)
    joints, start = body.state()
    before = {pose: body.posed(pose) for pose in poses}
    errors = {}
    for by, more in (("size", {}), ("poses", {"poses": poses})):
        answer = body.call("weights.reduce", influences=keep, by=by, **more)
        _, after = body.state()
        cut = np.flatnonzero((start > 0).sum(1) > keep)
        moved = moved_by(body, poses, before)[:, cut]
        assert ((after > 0).sum(1) <= keep).all() and is_one(after)
        np.testing.assert_array_equal(body.state()[0], joints)
        errors[by] = np.sqrt((moved**2).mean(0))
        if by == "poses":
            assert answer["moved"]["poses"] == 5
            changed = (bits(after) != bits(start)).any(1)[cut]
            assert answer["moved"]["mean"] == pytest.approx(moved[:, changed].mean(), rel=1e-4)
            assert answer["moved"]["max"] == pytest.approx(moved.max(), rel=1e-4)
        body.call("history.undo")
    assert errors["poses"].mean() < 0.75 * errors["size"].mean()
    assert (errors["poses"] <= errors["size"] * 1.001 + 1e-7).mean() > 0.97


def test_reduce_looks_at_the_guard(body) -> None:
    """Without poses the guard's count; without a guard frames of the clips and bends."""
    body.scramble(9)
    assert body.call("weights.reduce", influences=2)["moved"]["poses"] == 48
    body.call("history.undo")
    body.call("pose.set", pose="a", bend=30, seed=1)
    body.call("pose.set", pose="b", bend=30, seed=2)
    body.call("guard.set", poses=["a", "b"])
    own = body.call("weights.reduce", influences=2)
    assert own["moved"]["poses"] == 2
    rows = body.state()[1]
    body.call("history.undo")
    body.call("weights.reduce", influences=2, poses=["a", "b"])
    np.testing.assert_allclose(body.state()[1], rows, atol=1e-5)


@pytest.mark.parametrize("influences", [4, 8])
def test_a_session_begins_with_what_poses_want(daemon, influences) -> None:
    """session.create reduces by posed error: fewer millimetres than the largest ones give."""
    if not MAKEHUMAN.exists():
        pytest.skip("the real characters are not here")
    with daemon.link() as link:
        told = {}
        for reduce in ("largest", "posed"):
            told[reduce] = link.call("session.create", {
                "name": reduce, "file": str(MAKEHUMAN), "influences": influences,
                "reduce": reduce})["slots"]
            got = link.call("weights.get", {"session": reduce})
            assert is_one(np.asarray(got["weights"]))
        assert told["posed"]["reduced"] == told["largest"]["reduced"] > 0
        assert told["posed"]["moved"]["mean"] < 0.5 * told["largest"]["moved"]["mean"]
        assert told["posed"]["largest_cut"] >= told["largest"]["largest_cut"]


# ---- guard poses ----------------------------------------------------------------------------


def pick_by_looking(shown: list[np.ndarray], rest: np.ndarray, most: int) -> list[int]:
    nearest = [np.sqrt(((one - rest) ** 2).sum(-1).mean()) for one in shown]
    picked: list[int] = []
    while len(picked) < most:
        best = int(np.argmax(nearest))
        picked.append(best)
        nearest = [min(old, np.sqrt(((one - shown[best]) ** 2).sum(-1).mean()))
                   for old, one in zip(nearest, shown)]
    return picked


def test_guard_picks_the_farthest_frames(body) -> None:
    clips = {clip["name"]: clip["duration"] for clip in body.call("session.info")["clips"]}
    names = sorted(clips)[:2]
    frames = [(name, gap * clips[name] / gaps) for name in names
              for gaps in [int(np.ceil(clips[name] * 10))] for gap in range(gaps + 1)]
    assert len(frames) <= 256
    shown = []
    for name, when in frames:
        body.call("pose.set", pose="frame", clip=name, time=when)
        shown.append(body.posed("frame"))
    some = np.arange(2000) * len(body.rest) // 2000
    picked = pick_by_looking([one[some] for one in shown], body.posed("rest")[some], 6)
    body.scramble(10)  # the start's weights count, not those of now
    answer = body.call("guard.set", clips=names, count=6)
    assert answer["candidates"] == len(frames)
    assert [pose["source"] for pose in answer["poses"]] == ["clip"] * 6
    assert [pose["name"] for pose in answer["poses"]] == [frames[i][0] for i in picked]
    np.testing.assert_allclose([pose["time"] for pose in answer["poses"]],
                               [frames[i][1] for i in picked], atol=1e-9)
    assert body.call("guard.get") == answer
    assert body.call("session.info")["revision"] == 1  # no step


def test_guard_takes_poses_clips_and_matrices_together(body) -> None:
    clip = body.call("session.info")["clips"][0]["name"]
    body.call("pose.set", pose="near", bend=1, seed=1)
    body.call("pose.set", pose="far", bend=80, seed=1)
    binds = np.linalg.inv(np.asarray(body.call("mesh.get")["inverse_binds"]).reshape(-1, 4, 4))
    thrown = np.eye(4)
    thrown[:3, 3] = 50
    sent = np.concatenate([binds, thrown @ binds]).reshape(-1, 16)
    answer = body.call("guard.set", {"matrices": sent}, poses=["near", "far"], clips=[clip],
                       count=3)
    first, second, _ = answer["poses"]
    assert first == {"source": "matrices", "name": "", "time": 0, "index": 1}
    assert (second["source"], second["name"], second["index"]) == ("pose", "far", 1)
    assert body.call("guard.set") == {"session": "body", "candidates": 0, "poses": []}
    assert body.call("guard.get")["poses"] == []


def test_many_frames_are_thinned_evenly(daemon) -> None:
    if not KNIGHT.exists():
        pytest.skip("the real characters are not here")
    with daemon.link() as link:
        link.call("session.create", {"name": "knight", "file": str(KNIGHT)})
        clips = {clip["name"]: clip["duration"]
                 for clip in link.call("session.info", {"session": "knight"})["clips"]}
        frames = [(name, gap) for name, seconds in clips.items()
                  for gap in range(int(np.ceil(seconds * 10)) + 1)]
        assert len(frames) > 512
        kept = [frames[i * (len(frames) - 1) // 255] for i in range(256)]
        begun = time.perf_counter()
        answer = link.call("guard.set", {"session": "knight", "clips": list(clips), "count": 64})
        print(f"64 guard poses of {answer['candidates']} in {time.perf_counter() - begun:.2f} s")
        assert answer["candidates"] == 256 and len(answer["poses"]) == 64
        picked = {(pose["name"], pose["index"]) for pose in answer["poses"]}
        assert len(picked) == 64 and picked <= set(kept)


GUARDS_REFUSED = {
    "no such pose": ({"poses": ["nobody"]}, "no_pose"),
    "no such clip": ({"clips": ["nobody"]}, "no_clip"),
    "nothing but rest": ({"poses": ["rest"]}, "bad_params"),
    "no whole pose": ({"matrices": np.tile(np.eye(4).ravel(), (5, 1))}, "count_mismatch"),
    "too many": ({"poses": ["kept"] * 256, "matrices": np.tile(np.eye(4).ravel(), (53, 1))},
                 "too_large"),
    "count": ({"poses": ["kept"], "count": 65}, "bad_params"),
    "no session": ({"session": "other"}, "no_session"),
}


@pytest.mark.parametrize("what", GUARDS_REFUSED)
def test_a_refused_guard_leaves_the_old_one(daemon, folder, what) -> None:
    params, name = GUARDS_REFUSED[what]
    with daemon.link(checked=False) as link:
        body = Body(link, folder)
        body.call("pose.set", pose="kept", bend=20, seed=5)
        before = body.call("guard.set", poses=["kept"])
        with pytest.raises(SkindError) as refusal:
            link.call("guard.set", {"session": "body", **params})
        assert refusal.value.name == name, str(refusal.value)
        assert body.call("guard.get") == before


def test_a_guard_holds_other_poses(body) -> None:
    """A stroke in one pose moves another one less where that is a guard pose."""
    body.call("pose.set", pose="edited", bend=25, seed=1)
    body.call("pose.set", pose="other", bend=25, seed=2)
    start = body.posed("other")
    centre = int(np.argmax(body.rest[:, 0]) * 0.5)
    moved = {}
    for guarded in (False, True):
        body.call("guard.set", **({"poses": ["other"]} if guarded else {}))
        body.bump("edited", centre, stiffness=1e-3, **({"guard": 3} if guarded else {}))
        moved[guarded] = np.linalg.norm(body.posed("other") - start, axis=-1).max()
        body.call("history.undo")
    assert moved[True] < 0.7 * moved[False]


# ---- pins -----------------------------------------------------------------------------------


def pins(body: Body) -> dict[str, tuple]:
    return {pin["pose"]: (pin["vertices"], pin["weight"])
            for pin in body.call("pins.list")["pins"]}


def test_pins_are_weighed_and_cleared(body) -> None:
    for seed, pose in enumerate(("a", "b")):
        body.call("pose.set", pose=pose, bend=25, seed=seed)
    beside = int(np.argmin(np.abs(np.linalg.norm(body.rest - body.rest[300], axis=-1) - 0.1)))
    touched = {"a": body.bump("a", 300, 0.12), "b": body.bump("b", beside, 0.12)}
    count = {pose: len(vertices) for pose, vertices in touched.items()}
    both = np.intersect1d(touched["a"], touched["b"])
    assert 5 < len(both) < min(count.values())
    weights = body.state()[1]
    answer = body.call("pins.weigh", pose="a", weight=0.25)
    assert answer["vertices"] == count["a"] and answer["undo_steps"] == 3
    assert pins(body) == {"a": (count["a"], 0.25), "b": (count["b"], 1)}
    assert body.call("pins.weigh", pose="a", weight=0.25)["revision"] == answer["revision"]
    body.call("pins.weigh", {"vertices": touched["a"][:3]}, pose="a", weight=0)
    got = body.call("pins.get", pose="a")
    assert (np.asarray(got["weights"]) == 0).sum() == 3
    answer = body.call("pins.clear", {"vertices": both})
    assert answer["vertices"] == len(both)
    assert pins(body)["b"][0] == count["b"] - len(both)
    body.call("pins.clear", pose="b")
    assert set(pins(body)) == {"a"}
    body.call("pins.clear")
    assert pins(body) == {}
    assert body.call("pins.clear")["vertices"] == 0
    np.testing.assert_array_equal(bits(body.state()[1]), bits(weights))
    for _ in range(4):
        body.call("history.undo")
    assert pins(body) == {"a": (count["a"], 0.25), "b": (count["b"], 1)}
    body.call("history.redo")
    assert (np.asarray(body.call("pins.get", pose="a")["weights"]) == 0).sum() == 3


def test_pins_of_no_pose_are_refused(daemon, folder) -> None:
    with daemon.link(checked=False) as link:
        body = Body(link, folder)
        for method, more in (("pins.weigh", {"weight": 2}), ("pins.clear", {})):
            with pytest.raises(SkindError) as refusal:
                body.call(method, pose="nobody", **more)
            assert refusal.value.name == "no_pose"
        with pytest.raises(SkindError) as refusal:
            body.call("pins.weigh", pose="rest", weight=-1)
        assert refusal.value.name == "bad_params"
        assert body.call("pins.weigh", pose="rest", weight=2)["vertices"] == 0


# ---- weights.set with all that a step may change -----------------------------------------------


def test_a_tool_brings_back_slots_rest_and_shapes(start, folder) -> None:
    first, second = (start(socket=folder / f"{name}.sock") for name in "ab")
    shape = np.random.default_rng(2).normal(0, 0.01, (50, 3)).astype(np.float32)
    some = np.arange(400, 450, dtype=np.uint32)
    with first.link() as link:
        body = Body(link, folder)
        body.scramble(11)
        body.call("weights.mirror")
        joints, weights = body.state()
    with second.link() as link:
        body = Body(link, folder)
        body.call("pose.set", pose="bent", bend=25, seed=1)
        begun = body.state()
        assert (begun[0] != joints).any()
        moved = body.rest + np.float32(0.01)
        everyone = np.arange(len(joints), dtype=np.uint32)
        body.call("weights.set", {"vertices": everyone, "weights": weights, "joints": joints,
                                  "rest": moved})
        body.call("weights.set", {"vertices": some, "weights": weights[some], "offsets": shape},
                  shape="bent")
        now = body.state()
        np.testing.assert_array_equal(now[0], joints)
        np.testing.assert_array_equal(bits(now[1]), bits(weights))
        np.testing.assert_array_equal(bits(body.call("mesh.get")["rest"]), bits(moved))
        got = body.call("shapes.get", pose="bent")
        np.testing.assert_array_equal(got["vertices"], some)
        np.testing.assert_array_equal(bits(got["offsets"]), bits(shape))
        for _ in range(2):
            body.call("history.undo")
        now = body.state()
        np.testing.assert_array_equal(now[0], begun[0])
        np.testing.assert_array_equal(bits(now[1]), bits(begun[1]))
        np.testing.assert_array_equal(bits(body.call("mesh.get")["rest"]), bits(body.rest))
        assert body.call("shapes.list")["shapes"] == []


ROW, NAN = [[0.5, 0.5, 0, 0]], float("nan")
JOINTS = np.array([[0, 1, NONE, NONE]], np.uint16)
SET_REFUSED = {
    "no such bone": ({"joints": np.array([[0, 900, 1, 2]], np.uint16)}, "bad_index"),
    "a bone twice": ({"joints": np.array([[0, 1, 1, 2]], np.uint16)}, "bad_params"),
    "weight without a bone": ({"joints": np.array([[0, NONE, 1, 2]], np.uint16)}, "bad_params"),
    "rest that is nowhere": ({"joints": JOINTS, "rest": np.array([[0, NAN, 0]], np.float32)},
                             "not_finite"),
    "no such pose": ({"shape": "nobody", "offsets": np.zeros((1, 3), np.float32)}, "no_pose"),
    "offsets that are nowhere": ({"shape": "rest", "offsets": np.full((1, 3), NAN, np.float32)},
                                 "not_finite"),
}


@pytest.mark.parametrize("what", SET_REFUSED)
def test_what_cannot_be_set_changes_nothing(daemon, folder, what) -> None:
    params, name = SET_REFUSED[what]
    with daemon.link(checked=False) as link:
        body = Body(link, folder)
        before = body.state()
        with pytest.raises(SkindError) as refusal:
            link.call("weights.set", {"session": "body", "vertices": [5], "weights": ROW, **params})
        assert refusal.value.name == name, str(refusal.value)
        now = body.state()
        np.testing.assert_array_equal(now[0], before[0])
        np.testing.assert_array_equal(bits(now[1]), bits(before[1]))
        assert body.call("session.info")["revision"] == 0


# ---- refusals, seams, order, size ----------------------------------------------------------------


EDITS = {
    "weights.mirror": {}, "weights.prune": {"below": 0.5},
    "weights.reduce": {"influences": 1, "by": "size"}, "pins.clear": {},
}


@pytest.mark.parametrize("method", EDITS)
def test_bad_vertices_change_nothing(daemon, folder, method) -> None:
    with daemon.link(checked=False) as link:
        body = Body(link, folder)
        body.scramble(12)
        before = body.state()
        for vertices, said in (([3000], "3000 vertices"), ([7, 8, 7], "second time")):
            with pytest.raises(SkindError, match=said) as refusal:
                body.call(method, {"vertices": np.array(vertices, np.uint32)}, **EDITS[method])
            assert refusal.value.name == "bad_index"
        answer = body.call(method, {"vertices": np.zeros(0, np.uint32)}, **EDITS[method])
        assert (answer["vertices"], answer["revision"], answer["undo_steps"]) == (0, 1, 1)
        np.testing.assert_array_equal(bits(body.state()[1]), bits(before[1]))


@pytest.mark.parametrize("file", FILES)
def test_twins_stay_together(daemon, file) -> None:
    """One vertex of each ring is named, and all of it ends alike, slot by slot."""
    if not (ASSETS / file).exists():
        pytest.skip("the real characters are not here")
    with daemon.link() as link:
        link.call("session.create", {"file": str(ASSETS / file), "name": "s"})
        rest = link.call("mesh.get", {"session": "s"})["positions"]
        start = link.call("weights.get", {"session": "s"})
        ring = rings(rest, start["joints"], start["weights"])
        first = np.unique(ring, return_index=True)[1]
        split = np.flatnonzero(np.bincount(ring) > 1)
        assert len(split) > 20
        named = {"vertices": first[split].astype(np.uint32)}
        changed = 0
        # Half of the rings get a row of their own, so that there is something to mirror.
        some = first[split[::2]]
        raw = np.where(start["joints"][some] == NONE, 0, np.linspace(4, 1, 4)) + 1e-9
        rows = np.where(start["joints"][some] == NONE, 0, raw / raw.sum(1, keepdims=True))
        link.call("weights.set", {"session": "s", "vertices": some.astype(np.uint32),
                                  "weights": (rows / rows.sum(1, keepdims=True)).astype("f4")})
        for method, more in (("weights.mirror", {"tolerance": 0.5}),
                             ("weights.prune", {"below": 0.2}),
                             ("weights.reduce", {"influences": 1, "by": "size"})):
            before = link.call("weights.get", {"session": "s"})
            answer = link.call(method, {"session": "s", **more}, named)
            now = link.call("weights.get", {"session": "s"})
            differ = ((bits(now["weights"]) != bits(before["weights"])) |
                      (now["joints"] != before["joints"])).any(1)
            assert answer["vertices"] == differ.sum() and np.isin(ring[differ], split).all()
            np.testing.assert_array_equal(now["joints"], now["joints"][first][ring])
            np.testing.assert_array_equal(bits(now["weights"]), bits(now["weights"][first][ring]))
            changed += differ.sum()
        assert changed > 20


def test_edits_keep_the_sessions_order(daemon, folder) -> None:
    with daemon.link(checked=False) as link:
        body = Body(link, folder, 20_000)
        body.scramble(13)
        ids = [link.send(method, {"session": "body", **more}) for _ in range(3)
               for method, more in (("weights.prune", {"below": 0.02}), ("weights.mirror", {}),
                                    ("weights.reduce", {"influences": 3, "by": "size"}),
                                    ("guard.get", {}), ("history.undo", {}), ("history.undo", {}))]
        answers = [link.wait(id) for id in ids]
        revisions = [answer["revision"] for answer in answers if "revision" in answer]
        assert revisions == sorted(revisions)
        assert body.call("session.info")["revision"] == revisions[-1]


def test_an_edit_is_cancelled(daemon, folder) -> None:
    """One that waits or works ends at once or soon, and leaves all as it was."""
    with daemon.link(checked=False) as link:
        body = Body(link, folder, 100_000, influences=8)
        body.scramble(14)
        before = body.state()
        ids = [link.send("weights.reduce", {"session": "body", "influences": 3}) for _ in range(3)]
        for id in ids:
            link.cancel(id)
        cancelled = 0
        for id in ids:
            try:
                link.wait(id)
            except SkindError as refusal:
                assert refusal.name == "cancelled"
                cancelled += 1
        assert cancelled >= 2
        if cancelled == 3:
            np.testing.assert_array_equal(bits(body.state()[1]), bits(before[1]))


def test_a_million_vertices(daemon, folder) -> None:
    """Quick enough to wait for, and the loop goes on meanwhile."""
    with daemon.link(checked=False) as link:
        body = Body(link, folder, MANY)
        body.scramble(15)
        for method, more in (("weights.mirror", {}), ("weights.prune", {"below": 0.05}),
                             ("weights.reduce", {"influences": 2, "by": "size"}),
                             ("weights.reduce", {"influences": 1})):
            begun = time.perf_counter()
            answers = []
            ping_s = longest_ping(daemon, lambda: answers.append(body.call(method, **more)))
            print(f"{method} {more}: {time.perf_counter() - begun:.2f} s for "
                  f"{answers[0]['vertices']} vertices, longest ping {1e3 * ping_s:.1f} ms")
            assert answers[0]["vertices"] > 0.1 * MANY and ping_s < 0.5
        assert is_one(body.state()[1])
