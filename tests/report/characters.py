"""Rigs as arrays: the surface, the bones, the weights that are the truth, frames of the clips.

All are brought into one space, where the rest pose is the bind pose and the rest mesh's diagonal
is L = 2 m, so that a millimetre means the same on a fox and on a hand.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .lab import ASSETS, BIN, Lab

from rig_lib import Gltf  # noqa: E402  (lab sets the path)
from rig_numpy import node_matrices  # noqa: E402

L = 2.0  # metres
NO_BONE = 65535
FRAMES_MAX = 48  # of a character's clips; the longest path through them is enough for figures

FILES = {
    "fox": "bevy_fox/Fox.glb",
    "knight": "kaykit_adventurers/Knight.glb",
    "cesium man": "khronos_cesium/cesium_man.gltf",
    "robot": "raylib_robot/robot.glb",
    "hand": "webxr_generic_hand/left.glb",
    "makehuman": "makehuman/mh_body_4inf.glb",
}
MANY_INFLUENCES = "makehuman/mh_body_12inf.glb"
FINE = "makehuman/mh_body_sub1_8inf.glb"


@dataclass(frozen=True)
class Rig:
    """One character. `joints` and `weights` [V,N] are its own; NO_BONE and 0: none."""

    name: str
    real: bool
    positions: np.ndarray  # [V,3] f64, metres
    triangles: np.ndarray  # [T,3] u32
    names: list[str]
    parents: np.ndarray  # [B]
    binds: np.ndarray  # [B,4,4] bone to rest space
    joints: np.ndarray
    weights: np.ndarray
    frames: list[np.ndarray] = field(default_factory=list)  # clips' poses, [B,4,4] each

    def with_weights(self, joints: np.ndarray, weights: np.ndarray) -> "Rig":
        return replace(self, joints=joints, weights=weights)

    @cached_property
    def welds(self) -> np.ndarray:
        """[V] a number for each place of the surface: the two sides of a seam have one."""
        told = [self.positions.astype(np.float32), self.joints, self.weights]
        rows = np.ascontiguousarray(np.concatenate(told, axis=1, dtype=np.float64))
        _, places = np.unique(rows.view(np.dtype((np.void, rows.shape[1] * 8))).ravel(),
                              return_inverse=True)
        return places

    @cached_property
    def dense(self) -> np.ndarray:
        """[V,B] the weights, a column a bone."""
        table = np.zeros((len(self.positions), len(self.parents)))
        rows, slots = np.nonzero(self.joints != NO_BONE)
        np.add.at(table, (rows, self.joints[rows, slots]), self.weights[rows, slots])
        return table

    @cached_property
    def joints_bent(self) -> np.ndarray:
        """[V] share of the weight that is not the largest one's: where bones bend, up to 3/4."""
        return 1 - self.dense.max(axis=1)


def sparse_rows(table: np.ndarray, slots: int) -> tuple[np.ndarray, np.ndarray]:
    """The largest `slots` of each row of a dense table, as joints and weights that sum to one."""
    order = np.argsort(-table, axis=1, kind="stable")[:, :slots]
    weights = np.take_along_axis(table, order, axis=1)
    joints = np.where(weights > 0, order, NO_BONE).astype(np.uint16)
    return joints, weights / weights.sum(axis=1, keepdims=True)


def load(lab: Lab, name: str, path: Path, real: bool = True, influences: int = 4) -> Rig:
    """A character from its file, by way of the daemon; the clips' matrices are the file's."""
    session = lab.new_name()
    made = lab.call("session.create", file=str(path), name=session, influences=influences,
                    reduce="largest", fill="none")
    info = lab.call("session.info", session=session)
    mesh = lab.call("mesh.get", session=session)
    rows = lab.call("weights.get", session=session)
    binds = np.linalg.inv(mesh["inverse_binds"].reshape(-1, 4, 4))
    gltf = Gltf.read(path)
    nodes = gltf.json["skins"][0]["joints"]
    rest = node_matrices(gltf, None, 0.0)[nodes]
    # Where a bone's rest differs from its bind by what it does to the whole (an upright turn,
    # another unit), this is taken into the rest space.
    root = int(np.flatnonzero([bone["parent"] < 0 for bone in info["bones"]])[0])
    whole = rest[root] @ np.linalg.inv(binds[root])
    positions = mesh["positions"] @ whole[:3, :3].T + whole[:3, 3]
    binds = whole @ binds
    scale = L / np.linalg.norm(np.ptp(positions, axis=0))
    frames = []
    for clip, time in pick_frames([entry["duration"] for entry in info["clips"]]):
        matrices = node_matrices(gltf, clip, time)[nodes]
        check_frame(lab, session, info["clips"][clip]["name"], time,
                    matrices @ np.linalg.inv(rescaled(binds, 1)), positions, rows, made["length"])
        frames.append(rescaled(matrices, scale))
    lab.call("session.close", session=session)
    weights = rows["weights"].astype(np.float64)
    return Rig(name, real, positions * scale, mesh["triangles"],
               [bone["name"] for bone in info["bones"]],
               np.array([bone["parent"] for bone in info["bones"]], np.int32),
               rescaled(binds, scale), rows["joints"],
               weights / weights.sum(axis=1, keepdims=True), frames)


def pick_frames(durations: list[float]) -> list[tuple[int, float]]:
    """(clip, time) evenly over all clips, at most FRAMES_MAX."""
    total = sum(durations)
    count = min(FRAMES_MAX, int(total * 10))
    ends = np.cumsum(durations)
    picked = []
    for at in (np.arange(count) + 0.5) * total / max(count, 1):
        clip = int(np.searchsorted(ends, at))
        picked.append((clip, float(at - ends[clip] + durations[clip])))
    return picked


def check_frame(lab: Lab, session: str, clip: str, time: float, carried: np.ndarray,
                positions: np.ndarray, rows: dict, length: float) -> None:
    """The daemon and the file's reader agree on a frame, or the truth would be none."""
    lab.call("pose.set", session=session, pose="frame", clip=clip, time=time)
    told = lab.call("pose.evaluate", session=session, pose="frame")["positions"]
    used = np.where(rows["joints"] == NO_BONE, 0, rows["joints"])
    blend = np.einsum("vs,vsij->vij", rows["weights"].astype(float), carried[used])
    ours = np.einsum("vij,vj->vi", blend[:, :3, :3], positions) + blend[:, :3, 3]
    if np.abs(ours - told).max() > 1e-4 * length:
        raise RuntimeError(f"frame {clip} at {time} s is not what the file says")


def rescaled(matrices: np.ndarray, scale: float) -> np.ndarray:
    """The same in a scene `scale` times as large."""
    result = np.array(matrices, np.float64)
    result[:, :3, 3] *= scale
    return result


def generated(lab: Lab) -> Rig:
    """The character that the project makes itself."""
    path = Path(lab.folder.name) / "generated.glb"
    if not path.exists():
        subprocess.run([BIN / "skinctl", "generate", "--vertices", "6000", "--bones", "53", path],
                       check=True, stdout=subprocess.DEVNULL)
    return load(lab, "generated", path, real=False)


def everyone(lab: Lab, only: list[str] | None = None) -> list[Rig]:
    """The real characters that are there (or those named), else the generated one."""
    found = []
    for name, file in FILES.items():
        if (ASSETS / file).exists() and (not only or name in only):
            lab.say(f"reading {name}")
            found.append(load(lab, name, ASSETS / file))
    return found or [generated(lab)]
