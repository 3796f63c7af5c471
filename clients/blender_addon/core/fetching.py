# SPDX-License-Identifier: GPL-3.0-or-later
"""All that a session has, in the tool's terms. A conversation with the daemon (see talk.py)."""

from __future__ import annotations

from typing import Collection, Generator

import numpy as np

from .rig import Rig, Space
from .state import Held, State

RESHAPING = {"residual.rest", "residual.shape"}  # without these nothing but weights ever changes

Fetching = Generator[tuple[str, dict], dict, Held]


def fetch(rig: Rig, space: Space, capabilities: Collection[str]) -> Fetching:
    """Takes several requests: what others change meanwhile is seen by the revision, and then it is
    asked again."""
    everything = np.arange(len(rig.positions), dtype=np.uint32)
    while True:
        listed: dict = {"shapes": [], "rest_moved": 0}
        if not RESHAPING.isdisjoint(capabilities):
            listed = yield "shapes.list", {}
        rest = rig.positions.copy()
        if listed["rest_moved"]:
            mesh = yield "mesh.get", {}
            rest = space.rest(everything, mesh["rest"]).copy()
        shapes: dict[str, np.ndarray] = {}
        for name in {each["pose"]: None for each in listed["shapes"]}:
            told = yield "shapes.get", {"pose": name}
            shapes[name] = np.zeros_like(rest)
            shapes[name][told["vertices"]] = space.offsets(told["offsets"])
        held = yield "weights.get", {}
        if held["revision"] == listed.get("revision", held["revision"]):
            joints = held["joints"].copy()
            return Held(held["revision"], joints, State(
                space.joints(joints).copy(), held["weights"].copy(), rest, shapes))
