# SPDX-License-Identifier: GPL-3.0-or-later
"""Asks for weights with which a rig moves a mesh as another one moves: session.refit."""

from __future__ import annotations

import numpy as np

from .asks import Ask
from .channel import Done
from .sculpt import Sculpt


def refit(sculpt: Sculpt, poses: np.ndarray, positions: np.ndarray, labels: list[str],
          other_bones: bool, on_done: Done) -> Ask | None:
    """Asks for weights that bring all vertices to positions f32 [P,V,3], mesh space, in poses
    f64 [P,B,4,4]. It arrives; on_done hears of the answer. Returns what to cancel.

    Of poses that are the same the first counts. None and no word to on_done: they all are.
    """
    chosen: dict[str, int] = {}
    for index, (pose, label) in enumerate(zip(poses, labels)):
        chosen.setdefault(sculpt.poses.need(pose, sculpt.length, label).name, index)
    if len(chosen) < 2:
        return None
    wanted = positions[list(chosen.values())].reshape(-1, 3)
    ask = Ask("session.refit", {
        "poses": list(chosen), "positions": sculpt.space.points(wanted),
        "slots": "evidence" if other_bones else "keep"}, on_done)
    sculpt.asks.add(ask)
    return ask
