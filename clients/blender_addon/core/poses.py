# SPDX-License-Identifier: GPL-3.0-or-later
"""Names for the poses that an artist sculpts in: the same pose, the same name.

The daemon keeps a vertex's target for each pose, and knows a pose by its matrices, bit for bit. So
a pose that is the same but for rounding (the character was moved meanwhile, say) is sent with the
matrices of its first time. The name tells people where it is from, and other tools' poses apart.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass

import numpy as np

SAME = 1e-5  # of matrix entries, and of lengths per length of the character
DIGITS = 6
LABEL_BYTES_MAX = 40


@dataclass(frozen=True, eq=False)
class Pose:
    """matrices f64 [B,4,4], bone to mesh space."""

    name: str
    matrices: np.ndarray


class Poses:
    """The poses met so far."""

    def __init__(self) -> None:
        self._poses: dict[str, Pose] = {}

    def get(self, name: str) -> Pose | None:
        return self._poses.get(name)

    def find(self, matrices: np.ndarray, length: float) -> Pose | None:
        """The pose that is this one but for rounding."""
        slack = np.full((4, 4), SAME)
        slack[:3, 3] *= max(length, np.finfo(np.float32).tiny)
        for pose in self._poses.values():
            if (np.abs(pose.matrices - matrices) <= slack).all():
                return pose
        return None

    def need(self, matrices: np.ndarray, length: float, label: str) -> Pose:
        """The same, made where there is none; `label` begins its name."""
        pose = self.find(matrices, length)
        if pose is None:
            pose = Pose(self._name(matrices, label), matrices.copy())
            self._poses[pose.name] = pose
        return pose

    def _name(self, matrices: np.ndarray, label: str) -> str:
        plain = re.sub(r"[^A-Za-z0-9 ._-]+", "-", label).strip(" .-")[:LABEL_BYTES_MAX] or "pose"
        digest = hashlib.sha256(np.round(matrices, 5).tobytes()).hexdigest()
        digits = DIGITS
        while f"{plain} {digest[:digits]}" in self._poses:
            digits += 1
        return f"{plain} {digest[:digits]}"
