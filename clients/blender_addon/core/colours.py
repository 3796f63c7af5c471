# SPDX-License-Identifier: GPL-3.0-or-later
"""What overlays show: measures of a vertex, their colours, and the legend that explains them.

Arrays in, arrays out. Colours are display-referred sRGB, f32, 0 to 1; alpha is 1. Owns no state.

Two ramps, both with a lightness that only rises, so that they read without seeing hue:

    HEAT    lengths: dark blue, purple, red, orange, pale yellow
    SHARE   parts of a whole: dark slate, teal, green, pale yellow

and six colours for counts of influences, those of the thesis (8.3), chosen within their names to
stay apart for colour-blind eyes too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Callable, Sequence

import numpy as np

from .skin import LEAST_SUM, NO_BONE

STOPS = 256
NONE = (0.46, 0.46, 0.46)  # has no value: not sculpted, not changed, not reached, no influence
COUNT_COLOURS = {  # of vertices with so many influences; 5 stands for more
    0: NONE,
    1: (0.79, 0.09, 0.13),
    2: (0.95, 0.53, 0.07),
    3: (0.97, 0.91, 0.28),
    4: (0.05, 0.62, 0.42),
    5: (0.10, 0.27, 0.80),
}
# Lightness, chroma, hue in degrees (OKLCh), evenly spaced along the ramp.
HEAT_KNOTS = ((0.30, 0.12, 280), (0.46, 0.165, 310), (0.64, 0.18, 372), (0.80, 0.14, 420),
              (0.96, 0.09, 467))
SHARE_KNOTS = ((0.32, 0.05, 265), (0.47, 0.07, 230), (0.63, 0.10, 185), (0.80, 0.155, 145),
               (0.96, 0.13, 110))


def _srgb_of_oklch(lch: np.ndarray) -> np.ndarray:
    """sRGB [n,3] of OKLCh [n,3] (B. Ottosson, "A perceptual color space for image processing")."""
    lightness, chroma, hue = lch.T
    lab = np.stack([lightness, chroma * np.cos(hue), chroma * np.sin(hue)])
    cones = np.array([[1, 0.3963377774, 0.2158037573],
                      [1, -0.1055613458, -0.0638541728],
                      [1, -0.0894841775, -1.2914855480]]) @ lab
    linear = np.array([[4.0767416621, -3.3077115913, 0.2309699292],
                       [-1.2684380046, 2.6097574011, -0.3413193965],
                       [-0.0041960863, -0.7034186147, 1.7076147010]]) @ cones ** 3
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055).T


def _ramp(knots: tuple) -> np.ndarray:
    """f32 [STOPS,3]: the knots joined by straight lines in OKLCh."""
    along = np.linspace(0.0, len(knots) - 1, STOPS)
    lch = np.stack([np.interp(along, np.arange(len(knots)), column)
                    for column in np.array(knots, np.float64).T], axis=1)
    lch[:, 2] = np.radians(lch[:, 2])
    return _srgb_of_oklch(lch).astype(np.float32)


HEAT = _ramp(HEAT_KNOTS)
SHARE = _ramp(SHARE_KNOTS)


# ---- measures ----

def weight_change(start_joints: np.ndarray, start: np.ndarray, joints: np.ndarray,
                  now: np.ndarray) -> np.ndarray:
    """f32 [n], 0 to 1: the part of a vertex's weight that went to other bones.

    Half the L1 distance, bone by bone, between rows [n,N], each divided by its sum as it is for
    skinning; a row without weight counts as nothing.
    """
    before, after = _shares(start), _shares(now)
    change = np.abs(after - before)
    rows = (start_joints != joints).any(axis=1)
    if rows.any():  # by bone, and no longer slot by slot
        alike = start_joints[rows][:, None, :] == joints[rows][:, :, None]
        was = np.where(alike, before[rows][:, None, :], 0).sum(axis=2)
        gone = np.where(alike.any(axis=1), 0, before[rows])
        change[rows] = np.abs(after[rows] - was) + gone
    return change.sum(axis=1, dtype=np.float32) * np.float32(0.5)


def _shares(weights: np.ndarray) -> np.ndarray:
    sums = weights.sum(axis=1, dtype=np.float32)
    there = sums > LEAST_SUM
    return weights * (there / np.where(there, sums, 1.0)).astype(np.float32)[:, None]


def influence_counts(joints: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """u8 [n]: how many bones move a vertex, of rows [n,N]."""
    return np.count_nonzero((weights > 0.0) & (joints != NO_BONE), axis=1).astype(np.uint8)


def reach(joints: np.ndarray, weights: np.ndarray, bone: int) -> np.ndarray:
    """f32 [n], 0 to 1: the bone's part of a vertex's weight; NaN where it is in none of the slots.

    A slot with weight 0 is within reach: the next stroke may use it.
    """
    held = joints == bone
    part = np.where(held, _shares(weights), np.float32(0.0)).sum(axis=1, dtype=np.float32)
    part[~held.any(axis=1)] = np.nan
    return part


# ---- colours ----

def ramp_colours(values: np.ndarray, top: float, ramp: np.ndarray) -> np.ndarray:
    """RGBA f32 [n,4] of values [n] from 0 to `top`, both ends clamped; NaN is NONE."""
    nothing = np.isnan(values)
    # top may be so small that top / 255 is 0 in float32: divide in float64
    along = np.where(nothing, 0.0, values.astype(np.float64)) / top
    stops = np.rint(np.clip(along, 0.0, 1.0) * (STOPS - 1)).astype(np.intp)
    rgba = np.ones((len(values), 4), np.float32)
    rgba[:, :3] = ramp[stops]
    rgba[nothing, :3] = NONE
    return rgba


_COUNT_TABLE = np.array([COUNT_COLOURS[count] for count in range(6)], np.float32)


def count_colours(counts: np.ndarray) -> np.ndarray:
    """RGBA f32 [n,4] of counts of influences [n]."""
    rgba = np.ones((len(counts), 4), np.float32)
    rgba[:, :3] = _COUNT_TABLE[np.minimum(counts, 5)]
    return rgba


def round_up(value: float, least: float) -> float:
    """The next of 1, 2, 5, 10, ... times a power of ten: an end for a scale that people can read.

    Never less than that of `least`, which is > 0.
    """
    value = max(value, least)
    decade = 10.0 ** math.floor(math.log10(value))
    for step in (1.0, 2.0, 5.0):
        if value <= step * decade * (1 + 1e-6):  # 0.2 as float32 is a bit more than 0.2
            return step * decade
    return 10.0 * decade


LIGHTS = np.array([[-0.35, -0.75, 0.55], [0.75, 0.55, 0.35]], np.float32)  # front, rim; mesh's axes
LIGHTS /= np.linalg.norm(LIGHTS, axis=1)[:, None]
DARKEST = 0.68  # a colour must stay the legend's


def shade(rgba: np.ndarray, normals: np.ndarray) -> None:
    """Darkens colours [n,4] in place by normals [n,3] of any length, so that the form shows."""
    length = np.sqrt(np.einsum("ni,ni->n", normals, normals))
    lit = np.maximum(normals @ LIGHTS.T, 0.0) @ np.array([1.0, 0.7])
    lit = np.minimum(lit / np.where(length > 0.0, length, 1.0), 1.0)
    rgba[:, :3] *= (DARKEST + (1.0 - DARKEST) * lit).astype(np.float32)[:, None]


# What others claim keeps a third of its colour: darker and greyer than NONE, so that either
# is told from the other, and a ramp still reads.
CLAIMED = (0.15, 0.15, 0.16)
CLAIMED_SHARE = 0.68


def grey(rgba: np.ndarray, claimed: np.ndarray) -> None:
    """Darkens the colours [n,4] of claimed vertices, bool [n], in place; over nothing it is a veil
    that lets what is below be seen as much."""
    share = np.where(rgba[:, 3] > 0, CLAIMED_SHARE, 1.0)[:, None]
    toned = rgba + (np.array([*CLAIMED, 1.0]) - rgba) * share
    toned[rgba[:, 3] == 0, 3] = CLAIMED_SHARE
    rgba[claimed] = toned[claimed]


# ---- legends ----

@dataclass(frozen=True)
class Legend:
    """What the colours mean: a ramp [n,3] with texts at its two ends and its middle, or swatches.

    Swatches are (colour, text), in the order to be read.
    """

    title: str
    subtitle: str = ""
    ramp: np.ndarray | None = None
    ticks: tuple[str, ...] = ()
    swatches: tuple[tuple[tuple[float, float, float], str], ...] = ()


def _percent(part: float) -> str:
    return f"{part * 100:.3g} %"


def residual_legend(top: float, largest: float, as_length: Callable[[float], str]) -> Legend:
    """`largest` is NaN while nothing was sculpted."""
    subtitle = "nothing sculpted yet" if math.isnan(largest) else f"largest {as_length(largest)}"
    return Legend("Distance left to the sculpt", subtitle, HEAT,
                  (as_length(0.0), as_length(top / 2), as_length(top)), ((NONE, "not sculpted"),))


def change_legend(top: float, largest: float) -> Legend:
    return Legend("Weight moved to other bones", f"since Start, at most {_percent(largest)}", SHARE,
                  ("0 %", _percent(top / 2), _percent(top)), ((NONE, "not changed"),))


def reach_legend(bone: str) -> Legend:
    return Legend("Reach of one bone", bone, SHARE, ("0 %", "50 %", "100 %"),
                  ((NONE, "out of reach"),))


def counts_legend(counts: np.ndarray) -> Legend:
    """`counts` [n] of all vertices: the legend tells how many there are of each."""
    found = np.bincount(np.minimum(counts, 5), minlength=6)
    names = {1: "1 bone", 2: "2 bones", 3: "3 bones", 4: "4 bones", 5: "5 or more", 0: "none"}
    return Legend("Bones per vertex", swatches=tuple(
        (COUNT_COLOURS[count], f"{name}: {found[count]:,}".replace(",", "\u2009"))
        for count, name in names.items()))


def with_claims(legend: Legend, names: Sequence[str]) -> Legend:
    """The legend, with what is claimed by those of these names."""
    if not names:
        return legend
    who = names[0] if len(names) == 1 else f"{len(names)} others"
    seen = tuple((1 - CLAIMED_SHARE) * none + CLAIMED_SHARE * veil
                 for none, veil in zip(NONE, CLAIMED))
    return replace(legend, swatches=(*legend.swatches, (seen, f"claimed by {who}")))
