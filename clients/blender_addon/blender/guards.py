# SPDX-License-Identifier: GPL-3.0-or-later
"""The poses that should stay as they are: frames of actions, of markers, by number, and by hand.

Main thread. Frames are looked at in a scene of our own that holds nothing but a copy of the
armature, so that neither the artist's frame nor an unkeyed pose is touched, and the mesh is not
evaluated. The scene is there for the length of a slice only: undo never sees it. The daemon picks
from what is sent the poses that are far from each other.
"""

from __future__ import annotations

import re
import time
from contextlib import contextmanager
from typing import Iterator

import bpy
import numpy as np

from . import jobs, rig
from .messages import tell

PER_SECOND = 10  # frames of an action that are looked at
CANDIDATES_MAX = 192
KEPT = 16  # that the daemon is to pick; they cost nothing
SLICE_S = 0.02  # of frames in one piece; what Blender takes for one of them is its own
FRAME = re.compile(r"\s*(-?\d+)\s*(?:-\s*(-?\d+)\s*)?$")

Plan = "list[tuple[str, int]]"  # an action's name ("": as the scene plays it), and a frame


def frames_named(text: str) -> list[int]:
    """The frames that a text like "1, 12, 20-30" names. Raises jobs.Refused."""
    found: list[int] = []
    for part in filter(str.strip, text.split(",")):
        match = FRAME.match(part)
        if match is None:
            raise jobs.Refused(f"\u201c{part.strip()}\u201d names no frames: write 1, 12, 20-30")
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if not 0 <= last - first < 10 * CANDIDATES_MAX:
            raise jobs.Refused(f"\u201c{part.strip()}\u201d names no frames, or too many")
        found += range(first, last + 1)
    return list(dict.fromkeys(found))


def _curves(action: bpy.types.Action) -> Iterator[bpy.types.FCurve]:
    if hasattr(action, "fcurves"):  # gone in 5.0
        yield from action.fcurves
        return
    for layer in action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                yield from bag.fcurves


def actions_of(armature: bpy.types.Object) -> list[bpy.types.Action]:
    """The file's actions that move bones of this armature."""
    def moves(action: bpy.types.Action) -> bool:
        for curve in _curves(action):
            match = re.match(r'pose\.bones\["(.+?)"\]', curve.data_path)
            if match is not None:
                return match[1] in armature.pose.bones
        return False

    return [action for action in bpy.data.actions if moves(action)]


def _plan(armature: bpy.types.Object, settings: bpy.types.PropertyGroup) -> Plan:
    """What to look at. Raises jobs.Refused where there is nothing."""
    scene = bpy.context.scene
    if settings.keep_from == 'HAND':
        return []
    if settings.keep_from == 'MARKERS':
        plan = [("", marker.frame) for marker in scene.timeline_markers]
        if not plan:
            raise jobs.Refused("the timeline has no markers: add some (M), or choose other frames")
    elif settings.keep_from == 'CHOSEN':
        plan = [("", frame) for frame in frames_named(settings.keep_frames)]
        if not plan:
            raise jobs.Refused("name the frames to keep, for instance 1, 12, 20-30")
    else:
        step = max(1, round(scene.render.fps / scene.render.fps_base / PER_SECOND))
        plan = []
        for action in actions_of(armature):
            first, last = (round(end) for end in action.frame_range)
            plan += [(action.name, frame) for frame in range(first, last + 1, step)]
        if not plan:
            raise jobs.Refused("no action of this file moves the armature: use markers, frames, or "
                               "Keep This Pose")
    if len(plan) > CANDIDATES_MAX:
        plan = [plan[index] for index in np.linspace(0, len(plan) - 1, CANDIDATES_MAX).astype(int)]
    return plan


class _Probe:
    """A copy of an armature alone in a scene."""

    def __init__(self, scene: bpy.types.Scene, copy: bpy.types.Object) -> None:
        self._scene, self._copy = scene, copy
        self._action = ""

    def channels(self, action: str, frame: int, names: list[str]) -> np.ndarray:
        """rig.channels() of the armature at a frame."""
        if action != self._action:
            self._action = action
            self._play(bpy.data.actions[action])
        self._scene.frame_set(frame)
        graph = self._scene.view_layers[0].depsgraph
        return rig.channels(self._copy.evaluated_get(graph), names)

    def _play(self, action: bpy.types.Action) -> None:
        data = self._copy.animation_data or self._copy.animation_data_create()
        data.use_nla = False
        for bone in self._copy.pose.bones:  # what the action does not move is at rest
            bone.matrix_basis.identity()
        data.action = action
        if hasattr(data, "action_slot") and data.action_slot is None:
            slots = [slot for slot in action.slots
                     if slot.target_id_type in {'OBJECT', 'UNSPECIFIED'}]
            data.action_slot = slots[0] if slots else None


@contextmanager
def _probe(armature: bpy.types.Object) -> Iterator[_Probe]:
    scene = bpy.data.scenes.new("Skind")
    copy = armature.copy()
    try:
        point_at(copy, armature)
        scene.collection.objects.link(copy)
        yield _Probe(scene, copy)
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(copy)


def point_at(copy: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Constraints and drivers of the copy that look at the armature look at the copy."""
    for bone in copy.pose.bones:
        for constraint in bone.constraints:
            for place in (constraint, *getattr(constraint, "targets", ())):
                for name in ("target", "pole_target"):
                    if getattr(place, name, None) == armature:
                        setattr(place, name, copy)
    animation = copy.animation_data
    for curve in animation.drivers if animation is not None else ():
        for variable in curve.driver.variables:
            for target in variable.targets:
                if target.id == armature:
                    target.id = copy


def sample(obj_name: str, names: list[str], binds: np.ndarray, plan: Plan):
    """Job: f64 [Q,B,4,4], the poses of a plan in mesh space."""
    found: list[np.ndarray] = []
    while len(found) < len(plan):
        obj = bpy.data.objects[(obj_name, None)]
        armature = rig.armature_of(obj)
        end = time.perf_counter() + SLICE_S
        with _probe(armature) as probe:
            while len(found) < len(plan) and time.perf_counter() < end:
                moves = probe.channels(*plan[len(found)], names)
                found.append(rig.in_mesh(obj, armature, moves, binds))
        yield len(found) / len(plan)
    return np.array(found).reshape(-1, *binds.shape)


def gather(live):
    """Job: has the daemon keep the poses that the artist's settings name, or none."""
    settings, sculpt = bpy.context.scene.skind, live.sculpt
    poses = np.empty((0, *sculpt.rig.binds.shape))
    if settings.keep:
        plan = _plan(rig.armature_of(live.object()), settings)
        poses = yield from sample(live.object_name, sculpt.rig.names, sculpt.rig.binds, plan)
        by_hand = [matrices for _, matrices in live.kept]
        poses = np.concatenate([poses, np.array(by_hand).reshape(-1, *poses.shape[1:])])
        if len(poses) == 0:
            raise jobs.Refused("no pose is kept yet: press Keep This Pose in each")
    elif not sculpt.guard.is_set:
        return
    answered: list = []
    count = min(64, KEPT + len(live.kept))
    sculpt.keep(poses if len(poses) else None, count, lambda: answered.append(True))
    while not answered:
        yield jobs.WAIT
    if sculpt.guard.is_set:
        kept = len(sculpt.guard.kept)
        tell(f"Keeps {kept} {'pose' if kept == 1 else 'poses'}, picked from {len(poses)}.")
