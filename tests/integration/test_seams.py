"""What moves one vertex moves its twins: no stroke opens a crack at a seam."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

ASSETS = Path(__file__).resolve().parents[3] / "shared" / "assets"
FILES = ["bevy_fox/Fox.glb", "variants/robot_unindexed.glb", "kaykit_adventurers/Knight.glb",
         "awkward/tube540_unindexed.glb"]


def rings(rest: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """A number for each vertex, the same for those that a file split: place and influences."""
    order = np.argsort(joints, axis=1, kind="stable")
    row = np.concatenate([rest, np.take_along_axis(np.where(weights > 0, joints, 0), order, 1),
                          np.take_along_axis(weights, order, 1)], axis=1)
    return np.unique(row, axis=0, return_inverse=True)[1]


@pytest.mark.parametrize("file", FILES)
def test_no_crack_opens(daemon, file) -> None:
    if not (ASSETS / file).exists():
        pytest.skip("the shared characters are not here")
    random = np.random.default_rng(7)
    with daemon.link() as link:
        made = link.call("session.create", {"file": str(ASSETS / file), "name": "s"})
        clip = link.call("session.info", {"session": "s"})["clips"][-1]
        for index, share in enumerate((0.3, 0.8)):
            link.call("pose.set", {"session": "s", "pose": f"p{index}", "clip": clip["name"],
                                   "time": share * clip["duration"]})
        rest = link.call("mesh.get", {"session": "s"})["positions"]
        start = link.call("weights.get", {"session": "s"})
        ring = rings(rest, start["joints"], start["weights"])
        split = np.flatnonzero(np.bincount(ring)[ring] > 1)
        assert len(split) > 20
        for _ in range(5):
            # One vertex of each of some rings, as a careless tool would name them.
            chosen = np.unique(ring[random.choice(split, 40)], return_index=False)
            vertices = np.array([np.flatnonzero(ring == r)[-1] for r in chosen], np.uint32)
            posed = link.call("pose.evaluate", {"session": "s", "pose": "p0",
                                                "vertices": vertices})["positions"]
            moved = posed + random.normal(0, 0.01 * made["length"], posed.shape)
            answer = link.call("stroke.apply", {"session": "s", "pose": "p0",
                                                "vertices": vertices,
                                                "positions": moved.astype(np.float32)})
            assert answer["vertices"] == np.isin(ring, chosen).sum()
        weights = link.call("weights.get", {"session": "s"})["weights"]
        assert (weights != start["weights"]).any()
        for pose in ("p0", "p1"):
            positions = link.call("pose.evaluate", {"session": "s", "pose": pose})["positions"]
            first = np.unique(ring, return_index=True)[1][ring]
            np.testing.assert_array_equal(positions, positions[first])


@pytest.mark.parametrize("file", FILES)
def test_weights_that_are_set_take_the_twins_along(daemon, file) -> None:
    """One vertex of each of some rings is set: no crack opens. All are set: each has its own."""
    if not (ASSETS / file).exists():
        pytest.skip("the shared characters are not here")
    random = np.random.default_rng(11)
    with daemon.link() as link:
        link.call("session.create", {"file": str(ASSETS / file), "name": "s"})
        rest = link.call("mesh.get", {"session": "s"})["positions"]
        start = link.call("weights.get", {"session": "s"})
        joints, before = start["joints"], start["weights"]
        ring = rings(rest, joints, before)
        split = np.flatnonzero(np.bincount(ring)[ring] > 1)
        chosen = np.unique(ring[random.choice(split, 40)])
        vertices = np.array([np.flatnonzero(ring == r)[0] for r in chosen], np.uint32)
        raw = np.where(joints[vertices] == 65535, 0, random.random((len(vertices), 4)))
        rows = (raw / raw.sum(1, keepdims=True)).astype(np.float32)
        answer = link.call("weights.set", {"session": "s", "vertices": vertices, "weights": rows})
        assert answer["vertices"] == np.isin(ring, chosen).sum() > len(vertices)
        after = link.call("weights.get", {"session": "s"})["weights"]
        np.testing.assert_allclose(after[vertices], rows, atol=2e-7)
        for r, vertex in zip(chosen, vertices):
            twins = np.flatnonzero(ring == r)
            assert (joints[twins] == joints[vertex]).all()
            np.testing.assert_array_equal(after[twins], np.tile(after[vertex], (len(twins), 1)))
        others = ~np.isin(ring, chosen)
        np.testing.assert_array_equal(after[others], before[others])
        everyone = np.arange(len(before), dtype=np.uint32)
        answer = link.call("weights.set", {"session": "s", "vertices": everyone[::-1].copy(),
                                           "weights": before[::-1].copy()})
        assert answer["vertices"] == len(before)
        back = link.call("weights.get", {"session": "s"})["weights"]
        np.testing.assert_array_equal(back.view(np.uint32), before.view(np.uint32))
