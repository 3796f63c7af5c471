"""Jobs about what strokes know beyond one pose and one set of bones: pins, poses to keep, other
bones, rest positions, corrective shapes, and edits that are no strokes."""

from __future__ import annotations

import bpy
import numpy as np

from inside import artist, pen, rigs
from inside.windows import Steps, Window


def whole(thing: bpy.types.Object) -> dict:
    """Everything of a mesh that a step may change, to compare bit for bit."""
    keys = thing.data.shape_keys
    blocks = keys.key_blocks if keys is not None else []
    return {
        "co": rigs.co(thing).tobytes(),
        "groups": [group.name for group in thing.vertex_groups],
        "entries": [[(entry.group, np.float32(entry.weight).tobytes()) for entry in vertex.groups]
                    for vertex in thing.data.vertices],
        "keys": {key.name: np.array([point.co for point in key.data], np.float32).tobytes()
                 for key in blocks},
    }


def told() -> dict:
    live = artist.modules()[0].current()
    return {name: live.sculpt.last[name] for name in ("slots_changed", "rest_moved", "shaped",
                                                      "poses", "stiffness")}


# ---- pins ----


def two_poses() -> dict:
    """The same place sculpted in two poses, with its pins and with those of the first forgotten.

    How far the surface is from what was sculpted in the first pose, and in the second, in the end.
    """
    found = {}
    for how in ("kept", "forgotten"):
        mesh, rig = artist.rigged("tube")
        live = artist.start(mesh)
        poses, wanted = (25, -30), {}
        for degrees in poses:
            rigs.bend(rig, degrees)
            artist.shift(mesh, 1030, 0.4, 0.3 if degrees == poses[0] else -0.25)
            wanted[degrees] = rigs.posed(mesh)
            live.solve()
            artist.until(artist.is_settled)
            if how == "forgotten" and degrees == poses[0]:
                artist.edit("pins.clear", {})
        apart = {}
        for degrees in poses:
            rigs.bend(rig, degrees)
            apart[degrees] = float(artist.apart(rigs.posed(mesh), wanted[degrees]).max())
        artist.until(lambda: live.sculpt.pins.revision == live.sculpt.revision)
        artist.until(artist.is_settled)
        pins = live.sculpt.pins
        found[how] = {"apart": list(apart.values()), "pins": [pin["vertices"] for pin in pins],
                      "names": [pin["pose"] for pin in pins], "equal": artist.equal(), **told()}
        artist.stop("finish")
    return found


def same_pose() -> dict:
    """Strokes in one pose again and again, with its object moved and other poses in between."""
    mesh, rig = artist.rigged("tube")
    live = artist.start(mesh)
    for degrees in (25, -30, 25, 25):
        rigs.bend(rig, degrees)
        rig.location.x += 0.37  # the character as a whole: the pose is the same
        bpy.context.view_layer.update()
        artist.stroke(mesh, 1030, 0.3, 0.02)
    artist.until(lambda: live.sculpt.pins.revision == live.sculpt.revision)
    artist.until(artist.is_settled)
    names = [pin["pose"] for pin in live.sculpt.pins]
    artist.edit("pins.weigh", {"pose": names[0], "weight": 3.0})
    artist.until(lambda: live.sculpt.pins[0]["weight"] == 3.0)
    before = artist.mesh_weights()
    solved = artist.edit("pins.solve", {"pose": names[0]})
    changed = artist.mesh_weights().tobytes() != before.tobytes()
    equal = artist.equal()
    artist.edit("pins.clear", {})
    artist.until(lambda: live.sculpt.pins.revision == live.sculpt.revision)
    artist.until(artist.is_settled)
    left = len(live.sculpt.pins)
    artist.stop("cancel")
    return {"names": names, "solved": solved["vertices"], "changed": changed, "equal": equal,
            "left": left}


# ---- poses to keep ----


def bend_action(rig: bpy.types.Object, degrees: float, frames: int = 40) -> bpy.types.Action:
    """An action that bends one bone after the other."""
    for index, bone in enumerate(rig.pose.bones):
        bone.rotation_mode = "XYZ"
        for frame in (1, 1 + frames // 2, 1 + frames):
            bone.rotation_euler = (np.radians(degrees) * (frame > 1) * (-1) ** index,
                                   np.radians(degrees / 2) * (frame > 1 + frames // 2), 0)
            bone.keyframe_insert("rotation_euler", frame=frame)
    return rig.animation_data.action


def looked_at() -> dict:
    """What the poses to keep are, against Blender's own frames; what it leaves as it was."""
    from skind.blender import guards
    mesh, rig = artist.rigged("tube")
    bend_action(rig, 30)
    scene = bpy.context.scene
    scene.frame_set(7)
    rig.pose.bones[2].rotation_euler.x += 0.4  # not keyed: lost when the frame is set again
    bpy.context.view_layer.update()
    live = artist.start(mesh)
    names, binds = live.sculpt.rig.names, live.sculpt.rig.binds
    before = (scene.frame_current, live.pose(), [*bpy.data.scenes.keys()],
              [*bpy.data.objects.keys()])
    plan = guards._plan(rig, scene.skind)
    work = guards.sample(mesh.name, names, binds, plan)
    while True:
        try:
            next(work)
        except StopIteration as end:
            poses = end.value
            break
    after = (scene.frame_current, live.pose(), [*bpy.data.scenes.keys()],
             [*bpy.data.objects.keys()])
    untouched = before[0] == after[0] and (before[1] == after[1]).all() and before[2:] == after[2:]
    apart = []
    for (_, frame), pose in zip(plan, poses):
        scene.frame_set(frame)
        apart.append(np.abs(live.pose() - pose).max())
    artist.stop("cancel")
    return {"untouched": bool(untouched), "frames": [frame for _, frame in plan],
            "apart": float(max(apart))}


def kept(where: str) -> dict:
    """A stroke in one pose, and how far the frames of an action move by it, with them kept and
    without."""
    found = {}
    for keep in (False, True):
        mesh, rig = artist.rigged("tube")
        action = bend_action(rig, 35)
        scene = bpy.context.scene
        scene.timeline_markers.clear()
        for frame in (10, 21, 41):
            scene.timeline_markers.new(f"at {frame}", frame=frame)
        settings = artist.settings()
        settings.keep, settings.keep_from, settings.keep_frames = keep, where, "10, 21, 40-41"
        artist.stiffen(1e-3)
        live = artist.start(mesh)
        if where == "HAND" and keep:
            for frame in (10, 21, 41):
                scene.frame_set(frame)
                bpy.ops.skind.keep_pose()
        artist.until(lambda: live.sculpt.guard.is_set == keep and artist.is_settled())
        before = []
        for frame in range(1, 42, 4):
            scene.frame_set(frame)
            before.append(rigs.posed(mesh))
        rig.animation_data.action = None
        rigs.rest(rig)
        rigs.bend(rig, 20)
        artist.bump(mesh, 1030, 0.4, 0.05)
        sculpted = rigs.posed(mesh)
        live.solve()
        artist.until(artist.is_settled)
        edited = float(artist.apart(rigs.posed(mesh), sculpted).mean())
        rig.animation_data_create().action = action
        if hasattr(rig.animation_data, "action_slot"):
            rig.animation_data.action_slot = action.slots[0]
        moved = []
        for frame, shape in zip(range(1, 42, 4), before):
            scene.frame_set(frame)
            moved.append(artist.apart(rigs.posed(mesh), shape))
        found[keep] = {"edited": edited, "moved": float(np.mean(moved)), "equal": artist.equal(),
                       "poses": len(live.sculpt.guard.kept), "told": artist.modules()[0].told()}
        artist.stop("finish")
        settings.keep = False
    return found


# ---- other bones, rest positions, shapes ----


def twist(rig: bpy.types.Object, degrees: float) -> None:
    """Turns every bone, each about another axis and by another angle: no two of them alike."""
    rigs.pose(rig, {f"bone.{bone}": tuple(
        degrees * (1 + 0.3 * bone) / 2 * (axis == bone % 3) for axis in range(3))
        for bone in range(6)})


def damaged() -> tuple[bpy.types.Object, bpy.types.Object, list[np.ndarray], list[int]]:
    """A tube whose vertices have other bones in place of one that they need, and where they belong
    in some poses."""
    mesh, rig = artist.rigged("tube")
    poses = [25, -35, 50, -60]
    right = []
    for degrees in poses:
        twist(rig, degrees)
        right.append(rigs.posed(mesh).astype(np.float64))
    mesh.vertex_groups.remove(mesh.vertex_groups["bone.3"])
    for vertex in mesh.data.vertices:  # no slot is left for it
        bones = {entry.group for entry in vertex.groups}
        for group in [group for group in mesh.vertex_groups if group.index not in bones][
                :4 - len(bones)]:
            group.add([vertex.index], 0.02, "REPLACE")
    rigs.activate(mesh, "WEIGHT_PAINT")
    bpy.ops.object.vertex_group_normalize_all(group_select_mode="BONE_DEFORM", lock_active=False)
    rigs.activate(mesh)
    return mesh, rig, right, poses


def changed(option: str, value: str) -> dict:
    """Sculpts what is right in several poses with one option, and takes it all back to the bit.

    `states`: the mesh after each stroke; `undone`: after each is taken back, from the last on.
    """
    mesh, rig, right, poses = damaged()
    settings = artist.settings()
    setattr(settings, option, value)
    rigs.rest(rig)
    live = artist.start(mesh)
    tape = Tape()
    apart, last = [], []
    every = np.ones(len(right[0]), bool)
    for degrees, target in zip(poses, right):
        twist(rig, degrees)
        artist.sculpt_to(mesh, target, every)
        live.solve()
        artist.until(artist.is_settled)
        tape.record()
        apart.append(float(artist.apart(rigs.posed(mesh), target).max()))
        last.append({**told(), "equal": artist.equal()})
    ends = []
    for degrees, target in zip(poses, right):  # all of them, in the end
        twist(rig, degrees)
        artist.until(artist.is_settled)
        ends.append(float(artist.apart(rigs.posed(mesh), target).max()))
    live.show(True)
    before = whole(mesh)
    live.show(False)
    compared = before["co"] == tape.facts[0]["co"], whole(mesh) == tape.facts[-1]
    keys = [key.name for key in mesh.data.shape_keys.key_blocks] if mesh.data.shape_keys else []
    seen = []
    for to in [*reversed(range(len(poses))), *range(1, len(poses) + 1), 0, len(poses)]:
        tape.go(to)
        seen.append((to, whole(mesh) == tape.facts[to]))
        artist.until(artist.is_settled)
        seen.append((to, artist.equal()))
    groups = [group.name for group in mesh.vertex_groups]
    setattr(settings, option, settings_default(option))
    artist.stop("finish")
    kept_entries = min(len(vertex.groups) for vertex in mesh.data.vertices)
    return {"apart": apart, "ends": ends, "last": last, "keys": keys, "seen": seen,
            "groups": groups, "compared": compared, "length": live.sculpt.length,
            "entries": kept_entries, "zeros": sum(
                entry.weight == 0 for vertex in mesh.data.vertices for entry in vertex.groups)}


class Tape:
    """Stands for Blender's undo, which there is none of in the background: the mesh as a whole, and
    put back as Blender would."""

    def __init__(self) -> None:
        self.facts: list[dict] = []
        self.states: list[tuple] = []
        self.record()

    def record(self) -> None:
        from skind.blender import mesh, shapes
        from skind.blender.snapshot import Snapshot
        thing = artist.modules()[0].current().object()
        self.facts.append(whole(thing))
        keys = {name: shapes._read(key) for name, key in shapes.ours(thing.data).items()}
        self.states.append((_run(Snapshot.take(thing.name)), keys, thing.data[mesh.STATE]))

    def go(self, to: int) -> None:
        from skind.blender import history, mesh, shapes
        from skind.blender.snapshot import Snapshot
        live = artist.modules()[0].current()
        thing = live.object()
        snapshot, keys, mark = self.states[to]
        shapes.remove(thing)
        _run(Snapshot.restore(thing.name, snapshot))
        for name, places in {"Basis": snapshot.positions, **keys}.items() if keys else ():
            name = name if name == "Basis" else shapes.PREFIX + name
            block = thing.shape_key_add(name=name, from_mix=False)
            block.data.foreach_set("co", places.ravel())
        thing.data[mesh.STATE] = mark
        history.follow(live)


def _run(job):
    while True:
        try:
            next(job)
        except StopIteration as end:
            return end.value


def cancelled(option: str, value: str) -> list[str]:
    """Strokes with an option, and Cancel: what was not as before."""
    mesh, rig, right, poses = damaged()
    rigs.rest(rig)
    before = artist.facts(mesh)
    settings = artist.settings()
    setattr(settings, option, value)
    live = artist.start(mesh)
    for degrees, target in zip(poses[:2], right):
        twist(rig, degrees)
        artist.sculpt_to(mesh, target, np.ones(len(target), bool))
        live.solve()
        artist.until(artist.is_settled)
    setattr(settings, option, settings_default(option))
    artist.stop("cancel")
    rigs.rest(rig)
    return artist.different(before, artist.facts(mesh))


def rejoined(path: str, option: str, value: str) -> dict:
    """Saved in mid-session and opened again, while another tool keeps the session: goes on, and
    Cancel goes back to before the first Start."""
    from skind.core import Link
    mesh, rig, right, poses = damaged()
    rigs.rest(rig)
    before = artist.facts(mesh)
    settings = artist.settings()
    setattr(settings, option, value)
    live = artist.start(mesh)
    every = np.ones(len(right[0]), bool)

    def sculpt(index: int) -> None:
        twist(bpy.data.objects["TubeRig"], poses[index])
        artist.sculpt_to(bpy.data.objects["Tube"], right[index], every)
        artist.modules()[0].current().solve()
        artist.until(artist.is_settled)

    sculpt(0)
    sculpt(1)
    session, _ = artist.modules()
    with Link.connect(session.channel().path, name="another tool") as other:
        other.call("session.attach", {"session": live.sculpt.name})
        start = other.call("mesh.get", {"session": live.sculpt.name})["positions"]
        saved = whole(mesh)
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path)
        mesh = bpy.data.objects["Tube"]
        rigs.activate(mesh)
        found = {"saved": saved == whole(mesh)}
        assert session.rejoin(bpy.context) == []
        artist.until(lambda: session.current() is None or session.current().layout is not None)
        live = session.current()
        assert live is not None, session.told()
        found |= {"joined": saved == whole(mesh), "equal": [artist.equal()],
                  "start": bool((live.sculpt.rig.positions == start).all())}
        sculpt(2)
        found["equal"].append(artist.equal())
        found["apart"] = float(artist.apart(rigs.posed(mesh), right[2]).max())
        setattr(artist.settings(), option, settings_default(option))
        artist.stop("cancel")
    rigs.rest(bpy.data.objects["TubeRig"])
    after = artist.facts(mesh)
    found["different"] = [name for name in ("co", "entries", "groups")
                          if before[name] != after[name]]
    found["keys"] = mesh.data.shape_keys is not None
    return found


def settings_default(option: str) -> object:
    return artist.settings().bl_rna.properties[option].default


# ---- edits ----


def two_sided() -> tuple[bpy.types.Object, bpy.types.Object]:
    """A bar from left to right on three bones, arm.L, middle and arm.R, of four smooth weights."""
    rigs.clear()
    x, y, z = np.meshgrid(np.linspace(-1, 1, 41), [-0.1, 0.1], [-0.1, 0.1], indexing="ij")
    positions = np.stack([x, y, z], -1).reshape(-1, 3)
    index = np.arange(41 * 4).reshape(41, 4)[:, [0, 1, 3, 2]]
    after = np.roll(index, -1, axis=1)
    faces = np.stack([index[:-1], after[:-1], after[1:], index[1:]], -1).reshape(-1, 4)
    mesh = rigs.add_mesh("Bar", positions, faces)
    rig = bpy.data.objects.new("BarRig", bpy.data.armatures.new("BarRig"))
    bpy.context.scene.collection.objects.link(rig)
    rigs.activate(rig, "EDIT")
    bones = {"middle": (-0.3, 0.3), "arm.L": (0.3, 1.0), "arm.R": (-0.3, -1.0)}
    for name, (head, tail) in bones.items():
        bone = rig.data.edit_bones.new(name)
        bone.head, bone.tail = (head, 0, 0), (tail, 0, 0)
        bone.parent = rig.data.edit_bones["middle"] if name != "middle" else None
    rigs.activate(rig)
    for name, ends in bones.items():
        group = mesh.vertex_groups.new(name=name)
        for vertex, place in enumerate(positions[:, 0]):
            group.add([vertex], float(np.exp(-((place - np.mean(ends)) / 0.4) ** 2)), "REPLACE")
    rigs.activate(mesh, "WEIGHT_PAINT")
    bpy.ops.object.vertex_group_normalize_all(group_select_mode="ALL", lock_active=False)
    rigs.activate(mesh)
    rigs.bind(mesh, rig)
    return mesh, rig


def mirrored() -> dict:
    """A stroke on one side, mirrored by the panel's button; then pruned and reduced."""
    mesh, rig = two_sided()
    rigs.pose(rig, {"arm.L": (0, 0, 40), "arm.R": (0, 0, -25)})
    live = artist.start(mesh)
    artist.stroke(mesh, 4 * 30 + 1, 0.4, 0.05)

    def table() -> dict[str, np.ndarray]:
        shown = rigs.weights(mesh)
        return {group.name: shown[:, group.index] for group in mesh.vertex_groups}

    places = rigs.co(mesh)
    twins = np.array([np.linalg.norm(places - place * (-1, 1, 1), axis=1).argmin()
                      for place in places])
    bpy.ops.skind.mirror(axis="x", side="+")
    artist.until(artist.is_settled)
    after = table()
    alike = max(np.abs(after["arm.R"][twins] - after["arm.L"]).max(),
                np.abs(after["middle"][twins] - after["middle"]).max())
    found = {"alike": float(alike), "told": artist.modules()[0].told(), "equal": artist.equal()}
    bpy.ops.skind.prune(below=0.1)
    artist.until(artist.is_settled)
    shown = rigs.weights(mesh)
    found["smallest"] = float(shown[shown > 0].min())
    found["pruned"] = artist.modules()[0].told()
    bpy.ops.skind.reduce(influences=1, by="size")
    artist.until(artist.is_settled)
    found["most"] = int((rigs.weights(mesh) > 0).sum(1).max())
    found["equal"] = found["equal"] and artist.equal()
    found["states"] = live.sculpt.steps.live
    artist.stop("cancel")
    return found


# ---- masks ----


def masked() -> dict:
    """Strokes on both sides of a tube, one of them under Sculpt Mode's mask; since 4.1, where a
    mask is an attribute that anybody can make."""
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    wanted = np.where(rigs.co(mesh)[:, 0] > 0, 1.0, 0.0).astype(np.float32)
    mesh.data.attributes.new(".sculpt_mask", "FLOAT", "POINT").data.foreach_set("value", wanted)
    return _with_mask(mesh, wanted)


def masked_in_window(window: Window) -> Steps:
    """The same where only Sculpt Mode can make a mask: over all of it."""
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    yield from window.sculpt(mesh)
    with window.context():
        bpy.ops.paint.mask_flood_fill(mode="VALUE", value=1.0)
        bpy.ops.object.mode_set(mode="OBJECT")
    yield 0.1
    return _with_mask(mesh, np.ones(len(mesh.data.vertices), np.float32))


def _with_mask(mesh: bpy.types.Object, wanted: np.ndarray) -> dict:
    """How many vertices with and without mask get other weights, with the option and without."""
    from skind.blender import mesh as mesh_module
    read = mesh_module.read_mask(mesh.data)
    moved = {}
    for use in (False, True):
        artist.settings().use_mask = use
        artist.start(mesh)
        start = artist.mesh_weights()
        for vertex in (1000, 1020):
            artist.stroke(mesh, vertex, 0.9, 0.05)
        change = (artist.mesh_weights() != start).any(1)
        moved[use] = (int(change[wanted == 1].sum()), int(change[wanted == 0].sum()))
        artist.stop("cancel")
    artist.settings().use_mask = False
    return {"read": bool((read == wanted).all()), "moved": moved}


# ---- with a pen ----


def undo_redo(window: Window, count: int, option: str, value: str) -> Steps:
    """Strokes of the pen in two poses with an option; undo to the first, redo to the last."""
    setattr(bpy.context.scene.skind, option, value)
    live = yield from pen.begin(window)
    mesh = live.object()
    ways: dict[str, list] = {"forth": [whole(mesh)], "undo": [], "redo": []}
    equal, last = [], []
    for index, (x, y) in enumerate(window.surface(mesh, count, margin=90)):
        yield from window.stroke([(x + 4 * k, y + 3 * k) for k in range(6)])
        yield from pen.settled(window)
        ways["forth"].append(whole(live.object()))
        equal.append(artist.equal())
        last.append(told())
        rigs.bend(bpy.data.objects["TubeRig"], 25 if index % 2 else -25)
        with window.context():
            bpy.ops.ed.undo_push(message="Pose")
        yield from pen.settled(window)
    for way, shift in (("undo", False), ("redo", True)):
        for _ in range(count):
            for _ in range(2):  # the pose, and the stroke
                yield from window.key("Z", ctrl=True, shift=shift)
                yield from pen.settled(window)
            ways[way].append(whole(live.object()))
            equal.append(artist.equal())
    return {"ways": ways, "equal": equal, "last": last, "strokes": live.sculpt.strokes}
