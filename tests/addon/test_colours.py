"""Measures, ramps and legends of the overlays.

The oracles are CIE L*a*b*, and Machado, Oliveira and Fernandes' matrices (2009) for what people
see who lack one kind of cone.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from core import colours

EYES = {
    "all cones": np.eye(3),
    "no red cones": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                     [-0.003882, -0.048116, 1.051998]],
    "no green cones": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                       [-0.011820, 0.042940, 0.968881]],
    "no blue cones": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                      [0.004733, 0.691367, 0.303900]],
}
NO_BONE = 65535


def lab(rgb: np.ndarray, eye: str = "all cones") -> np.ndarray:
    """L*a*b* [n,3] of sRGB [n,3], D65, as seen with these cones."""
    rgb = np.asarray(rgb, np.float64)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear @ np.array(EYES[eye]).T, 0, 1)
    xyz = linear @ np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                             [0.0193339, 0.1191920, 0.9503041]]).T / (0.95047, 1.0, 1.08883)
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("ramp", [colours.HEAT, colours.SHARE], ids=["heat", "share"])
def test_ramps_read_for_everybody(ramp: np.ndarray, eye: str) -> None:
    """Lightness only rises, evenly enough that no value stands out which is not there."""
    seen = lab(ramp, eye)
    assert (np.diff(seen[:, 0]) > 0).all()
    assert seen[-1, 0] - seen[0, 0] > 60
    steps = np.diff(seen[::16, 0])
    assert steps.min() > 2 and steps.max() < 3 * steps.min()


@pytest.mark.parametrize("eye", EYES)
def test_counts_are_told_apart_by_everybody(eye: str) -> None:
    seen = lab(np.array([colours.COUNT_COLOURS[count] for count in range(6)]), eye)
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)[np.triu_indices(6, 1)]
    assert apart.min() > 12


def test_counts_have_the_colours_of_the_thesis() -> None:
    """By hue: red 1, orange 2, yellow 3, green 4, blue more; grey has none."""
    rgba = colours.count_colours(np.array([0, 1, 2, 3, 4, 5, 8, 200], np.uint8))
    assert (rgba[:, 3] == 1).all()
    assert (rgba[5:] == rgba[5]).all()
    a, b = lab(rgba[:6, :3])[:, 1:].T
    assert math.hypot(a[0], b[0]) < 1
    hues = np.degrees(np.arctan2(b, a))[1:] % 360
    for hue, (least, most) in zip(hues, ((20, 45), (50, 75), (85, 110), (130, 180), (260, 310))):
        assert least < hue < most


def test_ramp_colours_clamp_and_mark_what_has_no_value() -> None:
    values = np.array([0, 1, 2, 3, np.nan, -1, np.inf], np.float32)
    rgba = colours.ramp_colours(values, 2.0, colours.HEAT)
    assert rgba.dtype == np.float32 and rgba.shape == (7, 4) and (rgba[:, 3] == 1).all()
    low, high = colours.HEAT[0], colours.HEAT[-1]
    for row, expected in zip(rgba, (low, None, high, high, colours.NONE, low, high)):
        assert expected is None or np.array_equal(row[:3], np.float32(expected))
    assert lab(low[None])[0, 0] < lab(rgba[1:2, :3])[0, 0] < lab(high[None])[0, 0]
    values = np.sort(np.random.default_rng(1).random(500).astype(np.float32)) * 1e-30
    seen = lab(colours.ramp_colours(values, 1e-30, colours.HEAT)[:, :3])
    assert (np.diff(seen[:, 0]) >= 0).all() and seen[-1, 0] > 90


def test_weight_change_is_the_part_that_moved() -> None:
    start = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0], [0.4, 0.2, 0, 0],
                      [0, 0, 0, 0], [0, 0, 0, 0]], np.float32)
    now = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0.25, 0.5, 0.25, 0], [0.8, 0.4, 0, 0],
                    [0, 0, 0, 0], [1, 0, 0, 0]], np.float32)
    bones = np.tile(np.arange(4, dtype=np.uint16), (6, 1))
    moved = colours.weight_change(bones, start, bones, now)
    assert moved.dtype == np.float32
    assert moved == pytest.approx([0, 1, 0.25, 0, 0, 0.5], abs=1e-6)


def test_weight_change_is_a_distance() -> None:
    random = np.random.default_rng(2)
    bones = np.tile(np.arange(8, dtype=np.uint16), (400, 1))

    def change(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return colours.weight_change(bones, one, bones, other)

    a, b, c = random.dirichlet(np.ones(8), (3, 400)).astype(np.float32)
    ab, bc, ac = (change(*pair) for pair in ((a, b), (b, c), (a, c)))
    assert (change(a, a) == 0).all()
    assert np.array_equal(ab, change(b, a))
    assert (ac <= ab + bc + 1e-6).all() and (ab >= 0).all() and (ab <= 1 + 1e-6).all()
    # What some bones lose is what the others gain.
    assert ab == pytest.approx(np.maximum(b - a, 0).sum(1), abs=1e-6)


def test_weight_change_goes_by_bones() -> None:
    """Slots with other bones, in any order: as a loop over bones has it."""
    random = np.random.default_rng(4)
    joints = np.stack([random.permutation(9)[:4] for _ in range(400)]).astype(np.uint16)
    joints = joints.reshape(2, 200, 4)
    joints[1, :50] = joints[0, :50, ::-1]
    joints[0, 60:70, 3] = joints[1, 65:80, 2] = NO_BONE
    rows = random.dirichlet(np.ones(4), (2, 200)).astype(np.float32)
    rows[joints == NO_BONE] = 0
    rows /= rows.sum(2, keepdims=True)
    found = colours.weight_change(joints[0], rows[0], joints[1], rows[1])
    for vertex in range(200):
        was, now = ({int(bone): float(weight) for bone, weight in zip(joints[side, vertex],
                                                                     rows[side, vertex])
                     if weight} for side in (0, 1))
        expected = sum(abs(was.get(bone, 0) - now.get(bone, 0)) for bone in {*was, *now}) / 2
        assert found[vertex] == pytest.approx(expected, abs=1e-6)


def test_counts_and_reach_agree_with_a_loop() -> None:
    random = np.random.default_rng(3)
    joints = np.stack([random.permutation(12)[:8] for _ in range(300)]).astype(np.uint16)
    joints[random.random(joints.shape) < 0.3] = NO_BONE
    weights = random.random(joints.shape).astype(np.float32)
    weights[(random.random(joints.shape) < 0.3) | (joints == NO_BONE)] = 0
    rows = [{bone: weight for bone, weight in zip(*row) if bone != NO_BONE}
            for row in zip(joints.tolist(), weights.tolist())]
    counts = [sum(weight > 0 for weight in row.values()) for row in rows]
    assert colours.influence_counts(joints, weights).tolist() == counts
    for bone in (0, 5, 11, 12):
        expected = [row[bone] / (sum(row.values()) or 1) if bone in row else math.nan
                    for row in rows]
        assert colours.reach(joints, weights, bone) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(("value", "least", "top"), [
    (0.0, 1e-3, 1e-3), (0.0135, 1e-3, 0.02), (0.02, 1e-3, 0.02), (np.float32(0.2), 0.1, 0.2),
    (0.21, 0.1, 0.5), (0.6, 0.1, 1.0), (7e5, 1.0, 1e6), (0.0, 0.0017, 0.002),
])
def test_scales_end_at_round_numbers(value: float, least: float, top: float) -> None:
    assert colours.round_up(float(value), least) == pytest.approx(top)


def test_scales_hold_every_value_and_waste_little() -> None:
    for value in 10.0 ** np.random.default_rng(4).uniform(-9, 9, 500):
        top = colours.round_up(value, 1e-12)
        assert value <= top * (1 + 1e-5) and top <= 2.5 * value * (1 + 1e-5)


def test_shade_shows_the_form_and_leaves_the_colour() -> None:
    normals = np.random.default_rng(5).normal(size=(1000, 3)) * 1e-3
    normals[0] = 0
    rgba = np.full((1000, 4), (0.8, 0.4, 0.2, 1.0), np.float32)
    colours.shade(rgba, normals)
    assert (rgba[:, 3] == 1).all()
    light = rgba[:, 0] / np.float32(0.8)
    assert light.min() >= 0.6 and light.max() <= 1 + 1e-6 and np.ptp(light) > 0.25
    assert rgba[:, :3] / rgba[:, :1] == pytest.approx(np.tile([1, 0.5, 0.25], (1000, 1)), abs=1e-5)


def test_legends_say_the_scale() -> None:
    legend = colours.residual_legend(0.02, 0.0135, lambda length: f"{length * 100:.3g} cm")
    assert legend.ticks == ("0 cm", "1 cm", "2 cm") and "1.35 cm" in legend.subtitle
    assert "nothing" in colours.residual_legend(0.02, math.nan, str).subtitle
    assert colours.change_legend(0.2, 0.155).ticks == ("0 %", "10 %", "20 %")
    assert colours.reach_legend("spine").subtitle == "spine"
    legend = colours.counts_legend(np.array([1] * 1500 + [4, 4, 6, 7, 8], np.uint8))
    found = {words.partition(":")[0]: int("".join(filter(str.isdigit, words.partition(":")[2])))
             for _, words in legend.swatches}
    assert found == {"1 bone": 1500, "2 bones": 0, "3 bones": 0, "4 bones": 2, "5 or more": 3,
                     "none": 0}
    assert [colour for colour, _ in legend.swatches] == [
        colours.COUNT_COLOURS[count] for count in (1, 2, 3, 4, 5, 0)]


def test_what_is_claimed_is_told_from_the_rest_and_still_reads() -> None:
    every = np.array([*colours.HEAT, *colours.SHARE, *colours.COUNT_COLOURS.values()], np.float32)
    rgba = np.concatenate([every, np.ones((len(every), 1), np.float32)], axis=1)
    claimed = np.arange(len(every)) % 2 == 0
    toned = rgba.copy()
    colours.grey(toned, claimed)
    assert np.array_equal(toned[~claimed], rgba[~claimed]) and (toned[:, 3] == 1).all()
    whole = rgba.copy()
    colours.grey(whole, np.ones(len(every), bool))
    for eye in EYES:
        assert np.linalg.norm(lab(whole[:, :3], eye) - lab([colours.NONE], eye), axis=1).min() > 5
    for ramp in (slice(0, 256), slice(256, 512)):  # lightness rises beneath it, too
        assert (np.diff(lab(whole[ramp, :3])[::16, 0]) > 0.5).all()


def test_over_no_overlay_a_claim_is_a_veil() -> None:
    rgba = np.zeros((2, 4), np.float32)
    colours.grey(rgba, np.array([True, False]))
    assert rgba[0] == pytest.approx([*colours.CLAIMED, colours.CLAIMED_SHARE])
    assert not rgba[1].any()


def test_legends_name_who_claims() -> None:
    legend = colours.reach_legend("spine")
    assert colours.with_claims(legend, []) is legend
    assert colours.with_claims(legend, ["Ben"]).swatches[-1][1] == "claimed by Ben"
    assert colours.with_claims(legend, ["Ben", "Eva"]).swatches[-1][1] == "claimed by 2 others"
    assert colours.with_claims(legend, ["Ben"]).swatches[:-1] == legend.swatches
