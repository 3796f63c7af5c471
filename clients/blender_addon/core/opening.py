# SPDX-License-Identifier: GPL-3.0-or-later
"""How a Sculpt gets its session: made from the tool's rig, joined, or resumed after a loss.

Each is a conversation with the daemon (see talk.py).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Generator

import numpy as np

from .rig import Y_UP, Rig, Space
from .sculpt import Sculpt
from .state import Held, changes_to
from .talk import Talk
from .wire import GONE, SkindError

NAME_BYTES_MAX = 64
SAME_PLACE = 1e-5  # of the size: how far a vertex may be off and still be the same


def session_name(wish: str, attempt: int = 1) -> str:
    """A session's name from any text: letters, digits, `.`, `_` and `-`, numbered from 2 on."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", wish).strip(".-") or "session"
    tail = "" if attempt == 1 else f"-{attempt}"
    return plain[:NAME_BYTES_MAX - len(tail)] + tail


def create(sculpt: Sculpt, wish: str, influences: int, reduce: bool,
           durability: str = "full") -> None:
    """Makes a session from the tool's rig; its phase is `ready` when the slots are known."""
    sculpt.phase = "creating"
    sculpt.problem = sculpt.reason = ""
    sculpt.creation = {"influences": influences, "reduce": "largest" if reduce else "refuse"}
    if "durability" in sculpt.channel.capabilities:
        sculpt.creation["durability"] = durability
    sculpt.follow(_create(sculpt, wish))


def join(sculpt: Sculpt, name: str, kept: str = "") -> None:
    """Joins a session that is there. Ends with a reason if it is of another mesh.

    `kept`: the instance of one that will do, too, if it was closed.
    """
    sculpt.phase = "joining"
    sculpt.problem = sculpt.reason = ""
    sculpt.name = name
    sculpt.follow(_reopen(sculpt, kept) if kept else _join(sculpt))


def resume(sculpt: Sculpt) -> None:
    """After the connection came back: goes on where it was, in a new session if need be."""
    sculpt.phase = "resuming"
    sculpt.follow(_resume(sculpt))


def leave(sculpt: Sculpt) -> None:
    """Lets the session go; closes it if it is ours and nobody else is there."""
    if sculpt.phase == "ready":
        sculpt.follow(_leave(sculpt))
    sculpt.end("")


def _create(sculpt: Sculpt, wish: str) -> Talk:
    params = {**sculpt.rig.params(), **sculpt.creation}
    for attempt in range(1, 100):
        sculpt.name = session_name(wish, attempt)
        try:
            made = yield "session.create", {"name": sculpt.name, **params}
        except SkindError as error:
            if error.name != "name_taken":
                raise
        else:
            break
    else:
        raise SkindError(0, "name_taken", f"a hundred sessions are called \"{wish}\"",
                         "rename the object")
    sculpt.is_ours = True
    sculpt.length, sculpt.notes, sculpt.slots = made["length"], made["notes"], made["slots"]
    yield from _attach(sculpt)


def _attach(sculpt: Sculpt) -> Talk:
    attached = yield "session.attach", {}
    sculpt.presence.attached(attached)
    held = yield from sculpt.fetch()
    if sculpt.phase == "ended":  # left while it was being opened
        yield from _leave(sculpt)
    else:
        sculpt.instance = attached.get("instance", "")
        sculpt.adopt(held)


def _reopen(sculpt: Sculpt, instance: str) -> Talk:
    """Joins it, wherever it is."""
    try:
        yield from _join(sculpt)
    except SkindError as error:
        if error.name != "no_session" or not (yield from _take_back(sculpt, instance)):
            raise
        try:
            yield from _join(sculpt)
        except SkindError:
            yield "session.close", {}  # it stays with the others
            raise


def _join(sculpt: Sculpt) -> Talk:
    info = yield "session.info", {}
    sculpt.take_info(info)
    mesh = yield "mesh.get", {}
    sculpt.length, sculpt.notes = info["length"], info["notes"]
    sculpt.source = info["source"]
    # What tools made from arrays ends with the last of them; what a file holds has its own life.
    sculpt.is_ours = not sculpt.source
    sculpt.rig, sculpt.space = match(sculpt.rig, info, mesh)
    sculpt.creation = {"reduce": "largest", **{
        name: info[name] for name in ("influences", "durability") if name in info}}
    yield from _attach(sculpt)


def match(rig: Rig, info: dict, mesh: dict) -> tuple[Rig, Space]:
    """How a session is this rig, and the rig as the session began: the mesh may have been saved
    with rest positions that strokes had moved. Raises SkindError with the reason when it is
    another."""
    def refuse(why: str) -> SkindError:
        return SkindError(0, "another_mesh", f"session \"{info['session']}\" is not of this mesh: "
                          + why, "open the mesh that it was made from")

    if info["vertices"] != len(rig.positions):
        raise refuse(f"it has {info['vertices']} vertices, and the mesh {len(rig.positions)}")
    names = [bone["name"] for bone in info["bones"]]
    missing = [name for name in names if name not in set(rig.names)]
    if missing:
        raise refuse(f"the armature has no deforming bone \"{missing[0]}\"")
    near = SAME_PLACE * max(info["length"], np.finfo(np.float32).tiny)
    start = mesh["positions"]
    rest = mesh["rest"]
    for turn in (np.eye(4), Y_UP):
        turned = rig.positions @ turn[:3, :3].T
        here = np.abs(turned - start) <= near
        if not (here | (np.abs(turned - rest) <= near)).all():
            continue
        if not here.all() or np.array_equal(turned.astype(np.float32), rest):
            moved = (rest != start).any(axis=1)
            began = (start @ turn[:3, :3]).astype(np.float32)
            rig = replace(rig, positions=np.where(moved[:, None], began, rig.positions))
        return rig, Space(rig, names, mesh["inverse_binds"].reshape(-1, 4, 4), turn, start)
    raise refuse("its vertices are in other places")


def _resume(sculpt: Sculpt) -> Talk:
    attached = yield from _attach_again(sculpt)
    sculpt.presence.attached(attached)
    is_same = not sculpt.must_tell and attached.get("instance", "") == sculpt.instance
    held = None
    if sculpt.must_tell or attached["resync"]:
        held = yield from sculpt.fetch()
        if (yield from _is_another(sculpt, held)):
            sculpt.end(f"session \"{sculpt.name}\" is another one now; Finish, and Start again")
            sculpt.is_ours = sculpt.must_tell  # what we made just now; anything else is another's
            yield from _leave(sculpt)
            return
    if sculpt.must_tell:
        held = yield from _tell(sculpt, held)
        sculpt.guard.is_told = not sculpt.guard.is_set
        if sculpt.pins:
            sculpt.problem = ("skind was started again, and does not know any more what was "
                              "sculpted in which pose; weights are what they were")
    if not sculpt.guard.is_told:
        yield "guard.set", sculpt.guard.params()
        sculpt.guard.is_told = True
    if sculpt.phase == "ended":  # left meanwhile
        yield from _leave(sculpt)
        return
    if "durability" in sculpt.channel.capabilities:
        sculpt.take_info((yield "session.info", {}))
    missed = held is not None or attached["revision"] != sculpt.revision
    sculpt.instance = attached.get("instance", "")
    if held is not None:
        sculpt.replica.catch_up(held)
    sculpt.resumed(attached["revision"], missed, is_same)


def _attach_again(sculpt: Sculpt) -> Generator[tuple[str, dict], dict, dict]:
    """To the session that we had. One that was closed meanwhile is taken back; one that is nowhere
    any more is made again."""
    ways = [_take_back(sculpt, sculpt.instance), _create_again(sculpt)][sculpt.must_tell:]
    while True:
        try:
            return (yield "session.attach", _known(sculpt))
        except SkindError as error:
            if error.name != "no_session" or not ways:
                raise
        yield from ways.pop(0)


def _known(sculpt: Sculpt) -> dict:
    """What session.attach is told so that it need not all be fetched again."""
    if sculpt.must_tell or "updates.catch_up" not in sculpt.channel.capabilities:
        return {}
    return {"revision": sculpt.revision, "instance": sculpt.instance}


def _take_back(sculpt: Sculpt, instance: str) -> Generator[tuple[str, dict], dict, bool]:
    """From among the closed sessions; another one of that name stays there. Whether it is open."""
    if "session.save" not in sculpt.channel.capabilities:
        return False
    try:
        opened = yield "session.open", {"closed": sculpt.name}
    except SkindError as error:
        if error.name in GONE:
            raise
        return error.name == "name_taken"  # another tool was faster
    # One that is kept to the second gets another instance each time.
    if opened["instance"] != instance and opened["durability"] != "second":
        yield "session.close", {}
        return False
    return True


def _create_again(sculpt: Sculpt) -> Talk:
    made_from = {"file": sculpt.source} if sculpt.source else sculpt.rig.params()
    sculpt.must_tell = True  # stays until it is done, over further losses
    try:
        yield "session.create", {"name": sculpt.name, **made_from, **sculpt.creation}
    except SkindError as error:
        if error.name != "name_taken":  # another tool was faster
            raise


def _is_another(sculpt: Sculpt, held: Held) -> Generator[tuple[str, dict], dict, bool]:
    """A session of the name that is not the one we had."""
    if held.state.joints.shape != sculpt.joints.shape:
        return True
    if np.array_equal(held.state.joints, sculpt.held.joints):
        return False
    if held.revision == 0 and sculpt.first_joints is not None:
        return not np.array_equal(held.joints, sculpt.first_joints)
    info = yield "session.info", {}
    return ([bone["name"] for bone in info["bones"]] != sculpt.space.names
            or info["length"] != sculpt.length)


def _tell(sculpt: Sculpt, held: Held) -> Generator[tuple[str, dict], dict, Held]:
    """The daemon knows the start; what was answered since is ours to tell. What it holds then."""
    changes = changes_to(sculpt.held, held.state)
    for change in changes:
        if change.shape and sculpt.poses.get(change.shape) is None:
            continue  # another tool's, which alone knows the pose
        if change.shape:
            yield "pose.set", sculpt.pose_params(change.shape)
        yield "weights.set", sculpt.space.params(change)
    if changes:
        held = yield from sculpt.fetch()  # others may have been at work since
    sculpt.must_tell = False
    return held


def _leave(sculpt: Sculpt) -> Talk:
    try:
        yield "session.detach", {}
        if sculpt.is_ours:
            listed = yield "session.list", {}
            mine = [each for each in listed["sessions"] if each["session"] == sculpt.name]
            if mine and mine[0]["attached"] == 0:
                yield "session.close", {}
    except SkindError:
        pass  # it is gone already, or goes when skind is no longer needed
