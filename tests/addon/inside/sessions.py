"""Jobs about sessions, without a window, against the real daemon."""

from __future__ import annotations

import pickle
from pathlib import Path

import bpy
import numpy as np

from inside import artist, rigs


# ---- what strokes do ----


def figures(kind: str, mesh_name: str, poses: list[float], stiffnesses: list[float]) -> list[dict]:
    """Reachable and unreachable strokes in each pose with each stiffness.

    Distances are to the sculpted shape, of Blender's evaluated mesh, as shares of the length.
    `farther`: of vertices that had the weights of the start; what was changed before may go back
    towards those, as much as stiffness weighs it; then it is the sum, `energy`, that never grows.
    """
    mesh, rig = artist.rigged(kind, mesh_name)
    rigs.rest(rig)
    artist.settings().reduce = True
    live = artist.start(mesh)
    length, rest, start = live.sculpt.length, rigs.co(mesh), live.sculpt.start.weights
    random = np.random.default_rng(7)
    found = []
    for degrees in poses:
        rigs.bend(rig, degrees)
        for stiffness in stiffnesses:
            artist.stiffen(stiffness)
            for sculpt, size in ((artist.shift, 0.3), (artist.bump, 0.04 * length)):
                without = rigs.posed(mesh)
                held = artist.mesh_weights()
                fresh = (held == start).all(1)
                vertex = artist.bendable(random)
                target = sculpt(mesh, vertex, 0.15 * length, size)
                sculpted = rigs.posed(mesh)
                changed = live.solve()
                artist.until(artist.is_settled)
                after = rigs.posed(mesh)
                nearer = artist.apart(without, sculpted) - artist.apart(after, sculpted)
                gain = (energy(without, sculpted, held, start, stiffness * length)
                        - energy(after, sculpted, artist.mesh_weights(), start, stiffness * length))
                found.append({
                    "degrees": degrees, "stiffness": stiffness, "sculpt": sculpt.__name__,
                    "changed": changed,
                    "target": artist.apart(sculpted, target).max() / length,
                    "before": artist.apart(without, sculpted).max() / length,
                    "after": artist.apart(after, sculpted).max() / length,
                    "farther": -nearer[fresh].min() / length, "fresh": int(fresh.sum()),
                    "energy": -gain.min() / length ** 2,
                    "rest": bool((rigs.co(mesh) == rest).all()), "equal": artist.equal()})
                artist.edit("pins.clear", {})  # the next stroke is alone, as in the formula
    artist.stop("finish")
    return found


def energy(points: np.ndarray, targets: np.ndarray, weights: np.ndarray, start: np.ndarray,
           ridge: float) -> np.ndarray:
    """What the solver makes small for each vertex, in one pose."""
    change = np.linalg.norm(weights.astype(np.float64) - start, axis=1)
    return artist.apart(points, targets) ** 2 + (ridge * change) ** 2


# ---- undo and redo ----


class Tape:
    """Stands for Blender's undo, which there is none of in the background: the mesh, weights and
    marks as they were after each step, and put back as Blender would."""

    def __init__(self) -> None:
        self.states: list[tuple] = []
        self.at = -1
        self.record()

    def record(self) -> None:
        from skind.blender import mesh
        live = artist.modules()[0].current()
        data = live.object().data
        del self.states[self.at + 1:]
        self.states.append((artist.mesh_weights(), rigs.co(live.object()), data[mesh.STATE]))
        self.at = len(self.states) - 1

    def go(self, to: int) -> None:
        from skind.blender import history, mesh, weights
        live = artist.modules()[0].current()
        self.at = to
        rows, positions, mark = self.states[to]
        for _ in weights.write_rows(live.object_name, live.layout, np.arange(len(rows)), rows):
            pass
        artist.put(live.object(), positions)
        live.object().data[mesh.STATE] = mark
        history.follow(live)


def sequences(seed: int, length: int) -> list[dict]:
    """Strokes, undo, redo and jumps at random, some while strokes are under way."""
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    live = artist.start(mesh)
    artist.stiffen(1e-4)
    random = np.random.default_rng(seed)
    tape, seen = Tape(), []
    for _ in range(length):
        what = random.choice(["stroke", "stroke", "undo", "redo", "jump", "withdraw", "forget"])
        vertex = int(random.integers(len(mesh.data.vertices)))
        expected = None
        if what == "stroke":
            artist.stroke(mesh, vertex, 0.3, 0.05)
            tape.record()
        elif what == "withdraw":
            # A stroke that is undone before its answer is shown, at times before it is sent.
            artist.bump(mesh, vertex, 0.3, 0.05)
            live.solve()
            for _ in range(random.integers(4)):
                artist.modules()[0].channel().pump(0.0)
            expected = tape.states[tape.at][0]
            tape.go(tape.at)
        else:
            to = {"undo": tape.at - 1, "redo": tape.at + 1}.get(
                what, int(random.integers(len(tape.states))))
            if what == "forget":  # as after very many strokes
                live.sculpt.steps._steps.clear()
            tape.go(min(max(to, 0), len(tape.states) - 1))
            expected = tape.states[tape.at][0]
            if random.random() < 0.5:
                artist.until(artist.is_settled)
        if expected is not None:
            artist.until(artist.is_settled)
            seen.append((str(what), artist.equal(),
                         artist.mesh_weights().tobytes() == expected.tobytes()))
        else:
            seen.append((str(what), artist.equal(), True))
    artist.stop("cancel")
    return seen


def withdrawn() -> dict:
    """A stroke is undone while the daemon stands still; redo brings it back."""
    from skind.blender import history
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    live = artist.start(mesh)
    rest, start = rigs.co(mesh), artist.mesh_weights()
    with artist.halted():
        artist.bump(mesh, 1030, 0.3, 0.05)
        live.solve()
        sculpted = rigs.co(mesh)
        for _ in range(20):
            artist.modules()[1].tick()
        artist.put(mesh, rest)
        history.follow(live)
        pending = len(live.sculpt.pending)
    artist.until(artist.is_settled)
    undone = artist.mesh_weights().tobytes() == start.tobytes(), artist.equal()
    artist.put(mesh, sculpted)
    history.follow(live, is_redo=True)
    again = len(live.sculpt.pending)
    artist.until(artist.is_settled)
    redone = artist.mesh_weights().tobytes() != start.tobytes(), artist.equal()
    return {"pending": pending, "undone": undone, "again": again, "redone": redone,
            "strokes": live.sculpt.strokes, "rest": bool((rigs.co(mesh) == rest).all())}


# ---- beginning and ending ----


def cancelled(characters: list[tuple[str, str]]) -> list[dict]:
    """Start and Cancel, at once and after strokes; what was not as before is named."""
    found = []
    for path, name in characters:
        mesh, rig = artist.rigged(path, name)
        rigs.bend(rig, 20)
        # What a session must not touch: locks, an active group, groups and properties of others.
        mesh.vertex_groups.new(name="Cloth").add([3, 1, 2], 0.3, "REPLACE")
        mesh.vertex_groups[0].lock_weight = True
        mesh.vertex_groups.active_index = 1
        mesh["artist"], mesh.data["made"] = "me", [1.0, 2.0]
        bpy.context.scene.skind.reduce = True
        rigs.activate(mesh)
        before = artist.facts(mesh)
        artist.start(mesh)
        during = rigs.posed(mesh)
        artist.stop("cancel")
        at_once = artist.different(before, artist.facts(mesh))
        still = rigs.posed(mesh)
        live = artist.start(mesh)
        for vertex in (5, 50):
            artist.bump(mesh, vertex, 0.2 * live.sculpt.length, 0.05 * live.sculpt.length)
            live.solve()
            if vertex == 5:
                artist.until(artist.is_settled)
        strokes = live.sculpt.strokes, len(live.sculpt.pending)
        artist.stop("cancel")
        after = artist.different(before, artist.facts(mesh))
        found.append({"at once": at_once, "after strokes": after, "strokes": strokes,
                      "shown": artist.apart(during, still).max()
                      / np.ptp(still, axis=0).max(), "reduced": live.sculpt.slots})
    return found


def finished() -> dict:
    """Finish keeps the weights, and nothing else of the session's."""
    mesh, rig = artist.rigged("thin")
    rigs.bend(rig, 25)
    before = artist.facts(mesh)
    live = artist.start(mesh)
    padded = sum(len(vertex.groups) for vertex in mesh.data.vertices)
    artist.stroke(mesh, 1030, 0.3, 0.05)
    artist.bump(mesh, 300, 0.3, 0.05)
    live.solve()  # Finish has to wait for this one
    artist.stop("finish")
    shown, sculpt = rigs.weights(mesh), live.sculpt
    table = np.zeros((len(shown), len(sculpt.bones)), np.float32)
    vertices, slots = np.nonzero(sculpt.joints != 65535)
    table[vertices, sculpt.joints[vertices, slots]] = sculpt.weights[vertices, slots]
    after = artist.facts(mesh)
    order = [mesh.vertex_groups.find(bone) for bone in sculpt.bones]
    kept = all((table[:, bone] == (shown[:, group] if group >= 0 else 0)).all()
               for bone, group in enumerate(order))
    return {"strokes": sculpt.strokes, "kept": bool(kept),
            "changed": table.tobytes() != sculpt.start.weights.tobytes(),
            "zeros": artist.added_zeros(before, mesh), "padded": padded,
            "entries": sum(len(vertex.groups) for vertex in mesh.data.vertices),
            "different": [name for name in before if before[name] != after[name]
                          and name != "object"],  # its box is larger now
            "sessions": artist.call("session.list", {})["sessions"]}


# ---- files ----


def saved(path: str, flag: str) -> dict:
    """Saves while a stroke waits, and goes on; others open the file meanwhile."""
    mesh, rig = artist.rigged("thin")
    rigs.bend(rig, 25)
    (Path(flag) / "before").write_bytes(pickle.dumps(artist.facts(mesh)))
    live = artist.start(mesh)
    rest = rigs.co(mesh)
    artist.stroke(mesh, 1030, 0.3, 0.05)
    answered = artist.mesh_weights()
    with artist.halted():
        artist.bump(mesh, 300, 0.3, 0.05)
        live.solve()
        sculpted, posed = rigs.co(mesh), rigs.posed(mesh)
        artist.modules()[1].tick()
        bpy.ops.wm.save_as_mainfile(filepath=path)
        shown = bool((rigs.co(mesh) == sculpted).all() and (rigs.posed(mesh) == posed).all())
        clean = "skind_snapshot" not in mesh.data
        pending = len(live.sculpt.pending)
    artist.until(artist.is_settled)
    solved = artist.mesh_weights()
    equal, strokes = artist.equal(), live.sculpt.strokes
    artist.signal_outside(flag, "saved")
    artist.wait_outside(flag, "rejoined")
    artist.until(artist.is_settled)
    theirs = artist.mesh_weights()
    equal = equal and artist.equal()
    artist.stop("finish")
    return {"rest": rest, "answered": answered, "solved": solved,
            "theirs": theirs, "shown": shown, "clean": clean, "pending": pending, "equal": equal,
            "strokes": strokes, "name": live.sculpt.name,
            "back": bool((rigs.co(mesh) == rest).all())}


def opened(path: str, how: str, before: dict, flag: str = "") -> dict:
    """Opens a file that was saved mid-session, rejoins, and ends it. `before`: the mesh's facts
    before Start; `flag`: where others go on when it has joined."""
    bpy.ops.wm.open_mainfile(filepath=path)
    session, _ = artist.modules()
    mesh = bpy.data.objects["Tube"]
    rigs.activate(mesh)
    found = {"rest": rigs.co(mesh), "table": rigs.weights(mesh),
             "remembered": session.remembered(mesh)}
    assert session.rejoin(bpy.context) == []
    artist.until(lambda: session.current() is None or session.current().layout is not None)
    live = session.current()
    assert live is not None, session.told()
    found |= {"joined": artist.mesh_weights(), "name": live.sculpt.name, "equal": artist.equal(),
              "marks": [key for key in mesh.data.keys() if key.startswith("skind")],
              "undo_steps": artist.call("session.info", {"session": live.sculpt.name})["undo_steps"],
              "told": session.told()}
    artist.stroke(mesh, 1500, 0.3, 0.05)
    found |= {"stroked": artist.mesh_weights(), "equal": found["equal"] and artist.equal()}
    if flag:
        artist.signal_outside(flag, "rejoined")
    artist.stop(how)
    return {**found, "facts": artist.facts(mesh), "zeros": artist.added_zeros(before, mesh),
            "remembers": session.remembered(mesh)}


# ---- several tools ----


def shared(seed: int, length: int) -> dict:
    """Another tool and we, at random: strokes of both at the same time, and undo."""
    from skind.core import Link
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    live = artist.start(mesh)
    sculpt, rest = live.sculpt, rigs.co(mesh)
    random = np.random.default_rng(seed)
    session, _ = artist.modules()
    strokes, theirs, seen = 0, 0, []
    with Link.connect(session.channel().path, name="another tool") as other:
        about = {"session": sculpt.name}
        other.call("session.attach", about)
        other.call("pose.set", {**about, "pose": "mine", "matrices": live.pose()})
        for _ in range(length):
            ours = random.random() < 0.6
            if ours:
                artist.bump(mesh, int(random.integers(2000)), 0.3, 0.05)
                shape = rigs.co(mesh)
                strokes += live.solve() > 0
            for _ in range(random.integers(3)):
                if random.random() < 0.7:
                    vertices = np.sort(random.choice(2000, 150, False)).astype(np.uint32)
                    at = other.call("pose.evaluate", {**about, "pose": "mine",
                                                      "vertices": vertices})["positions"]
                    other.call("stroke.apply", {**about, "pose": "mine", "vertices": vertices,
                                                "positions": at + np.float32(0.02)})
                    theirs += 1
                else:
                    steps = other.call("session.info", about)
                    if steps["undo_steps"]:
                        other.call("history.undo", about)
                        theirs += 1
            # Nothing of ours is taken from the screen before our answer is there.
            seen.append(not ours or len(sculpt.pending) == 1
                        and bool((rigs.co(mesh) == shape).all()))
            artist.until(lambda: sculpt.revision == strokes + theirs and artist.is_settled())
            seen.append(artist.equal() and bool((rigs.co(mesh) == rest).all()))
        info = other.call("session.info", about)
    artist.stop("finish")
    return {"seen": seen, "strokes": (strokes, sculpt.strokes), "theirs": theirs,
            "revision": (info["revision"], sculpt.revision)}


def held(flag: str) -> dict:
    """Starts a session and keeps it until another Blender has left it again."""
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    live = artist.start(mesh)
    artist.stroke(mesh, 1030, 0.3, 0.05)
    artist.signal_outside(flag, "held")
    artist.wait_outside(flag, "sculpted")
    artist.until(artist.is_settled)
    found = {"weights": artist.mesh_weights(), "equal": artist.equal(),
             "strokes": live.sculpt.strokes, "told": artist.modules()[0].told()}
    artist.signal_outside(flag, "seen")
    artist.wait_outside(flag, "left")
    artist.stroke(mesh, 1030, 0.3, -0.05)
    found["alone"] = artist.equal()
    artist.stop("finish")
    return found


def joined(flag: str, name: str) -> dict:
    """Joins the session of another Blender."""
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, -25)
    session, _ = artist.modules()
    artist.until(lambda: session.channel().state == "ready")
    session.ask_sessions()
    artist.until(lambda: session.available() and not session.is_busy())
    listed = [each["session"] for each in session.available()]
    rigs.activate(mesh)
    before = artist.facts(mesh)
    assert session.join(bpy.context, name) == []
    artist.until(lambda: session.current() is None or session.current().layout is not None)
    live = session.current()
    assert live is not None, session.told()
    equal = artist.equal()
    artist.stroke(mesh, 700, 0.3, 0.05)
    weights = artist.mesh_weights()
    equal = equal and artist.equal()
    artist.signal_outside(flag, "sculpted")
    artist.wait_outside(flag, "seen")
    artist.stop("cancel")
    artist.signal_outside(flag, "left")
    return {"listed": listed, "equal": equal, "weights": weights,
            "different": artist.different(before, artist.facts(mesh))}


def of_a_file(path: str, name: str, export: str) -> dict:
    """Joins a session that was made from the character's file, and has the daemon export it."""
    from skind.core import Link
    mesh, rig = artist.rigged(path, name)
    rigs.bend(rig, 20)
    session, _ = artist.modules()
    rigs.activate(mesh)
    artist.start(mesh)  # which starts a daemon
    artist.stop("cancel")
    before = artist.facts(mesh)
    with Link.connect(session.channel().path, name="another tool") as other:
        other.call("session.create", {"name": "of-a-file", "file": path})
        assert session.join(bpy.context, "of-a-file") == []
        artist.until(lambda: session.current() is None or session.current().layout is not None)
        live = session.current()
        assert live is not None, session.told()
        shown = rigs.posed(mesh)
        length = live.sculpt.length
        artist.stiffen(1e-5)
        vertex = artist.bendable(np.random.default_rng(1))
        artist.shift(mesh, vertex, 0.15 * length, 0.3)
        sculpted = rigs.posed(mesh)
        live.solve()
        artist.until(artist.is_settled)
        after = rigs.posed(mesh)
        found = {"before": artist.apart(shown, sculpted).max() / length,
                 "after": artist.apart(after, sculpted).max() / length, "equal": artist.equal()}
        live.export(export)
        artist.until(lambda: not session.is_busy())
        found["told"] = session.told()
        artist.stop("cancel")
        found["different"] = artist.different(before, artist.facts(mesh))
        found["sessions"] = [each["session"] for each in other.call("session.list")["sessions"]]
        other.call("session.create", {"name": "again", "file": export})
        found["exported"] = (other.call("weights.get", {"session": "again"})["weights"],
                             other.call("weights.get", {"session": "of-a-file"})["weights"])
        for each in ("again", "of-a-file"):
            other.call("session.close", {"session": each})
    return found


# ---- odd meshes ----


def odd() -> dict:
    """Vertices without weights, with too many, with odd sums; groups that are no bones; locks."""
    mesh, rig = artist.rigged("tube")
    session, _ = artist.modules()
    groups = mesh.vertex_groups
    cloth = groups.new(name="Cloth")
    still = groups.new(name="still")
    rigs.activate(rig, "EDIT")
    extra = rig.data.edit_bones.new("still")
    extra.head, extra.tail, extra.use_deform = (0, 0, 0), (0, 1, 0), False
    rigs.activate(mesh)
    bare, other, many, light = [0, 1], [2, 3], range(100, 140), range(200, 300)
    for group in groups:
        group.remove([*bare, *other])
    cloth.add(other, 0.4, "REPLACE")
    still.add([3, *range(500, 600)], 0.9, "REPLACE")
    # In the middle of the other entries: last ones are moved into the gaps.
    groups["bone.0"].remove([*range(900, 1000)])
    cloth.add([*range(900, 1000)], 0.25, "REPLACE")
    groups["bone.0"].add([*range(900, 1000)], 0.1, "REPLACE")
    for bone in range(6):
        groups[f"bone.{bone}"].add([*many], 0.1 + 0.05 * bone, "REPLACE")
    for vertex in light:
        for entry in mesh.data.vertices[vertex].groups:
            entry.weight *= 0.77
    groups["bone.2"].lock_weight = True
    rigs.bend(rig, 25)
    before = artist.facts(mesh)
    shown = rigs.posed(mesh)

    artist.settings().reduce = False
    rigs.activate(mesh)
    refused = session.start(bpy.context), artist.different(before, artist.facts(mesh))

    artist.settings().reduce = True
    artist.stiffen(1e-4)
    live = artist.start(mesh)
    moved = artist.apart(rigs.posed(mesh), shown)
    kept_groups = [group.index for group in (cloth, still)]
    locked = (live.sculpt.joints == live.sculpt.rig.names.index("bone.2"))
    start, rest = artist.mesh_weights(), rigs.co(mesh)

    def others() -> list:
        return [[(entry.group, np.float32(entry.weight).tobytes()) for entry in vertex.groups
                 if entry.group in kept_groups] for vertex in mesh.data.vertices]

    kept = others()
    for vertex in (0, 120, 250, 550, 950, 1030):
        artist.stroke(mesh, vertex, 0.5, 0.05)
    after = artist.mesh_weights()
    result = {
        "refused": refused, "reduced": live.sculpt.slots["reduced"],
        "unweighted": np.flatnonzero(live.sculpt.rig.unweighted).tolist(),
        "moved": {name: moved[[*part]].max() for name, part in
                  (("many", many), ("light", light), ("bare", [*bare, *other]))},
        "locked": after[locked].tobytes() == start[locked].tobytes(),
        "changed": int((after != start).any(1).sum()),
        "others": others() == kept, "equal": artist.equal(), "strokes": live.sculpt.strokes,
        "rest": bool((rigs.co(mesh) == rest).all())}
    # Only vertices that no bone moves: there is nothing to solve.
    shape = rest.copy()
    shape[[*bare, *other]] += np.float32(0.1)
    artist.put(mesh, shape)
    result["nothing"] = live.solve(), session.told(), bool((rigs.co(mesh) == rest).all())
    artist.stop("cancel")
    result["different"] = artist.different(before, artist.facts(mesh))
    return result


def meddled() -> dict:
    """Groups are added, filled and removed by others in the middle of a session."""
    mesh, rig = artist.rigged("tube")
    rigs.bend(rig, 25)
    before = artist.facts(mesh)
    artist.start(mesh)
    result = {}
    mesh.vertex_groups.new(name="Cloth")
    artist.stroke(mesh, 1030, 0.3, 0.05)
    result["added"] = artist.equal()
    mesh.vertex_groups["Cloth"].add([*range(0, 2000, 3)], 0.5, "REPLACE")
    artist.stroke(mesh, 1030, 0.3, -0.05)
    result["filled"] = artist.equal()
    mesh.vertex_groups.remove(mesh.vertex_groups["bone.5"])
    artist.stroke(mesh, 300, 0.3, 0.05)
    artist.stroke(mesh, 1990, 0.3, 0.05)
    result["removed"] = artist.equal()
    mesh.vertex_groups.remove(mesh.vertex_groups["bone.0"])
    mesh.vertex_groups.remove(mesh.vertex_groups["Cloth"])
    artist.stop("finish")
    result["zeros"] = artist.added_zeros(before, mesh)
    result["moved"] = float(np.abs(rigs.weights(mesh).sum(1) - 1).max())
    before = artist.facts(mesh)
    artist.start(mesh)
    mesh.vertex_groups.remove(mesh.vertex_groups["bone.1"])
    artist.stop("cancel")
    result["different"] = artist.different(before, artist.facts(mesh))
    return result


# ---- export ----


def exported(kind: str, mesh_name: str, path: str) -> dict:
    """A stroke, and the character as glTF from Sculpt Mode with a hidden armature and another
    stroke still on its way; and what is said when Blender's exporter is switched off."""
    import addon_utils
    mesh, rig = artist.rigged(kind, mesh_name)
    addon_utils.enable("io_scene_gltf2", default_set=True)
    rigs.bend(rig, 25)
    rig.hide_set(True)
    live = artist.start(mesh)
    bpy.ops.object.mode_set(mode="SCULPT")
    rest = rigs.co(mesh)
    length = live.sculpt.length
    artist.stroke(mesh, 30, 0.2 * length, 0.03 * length)
    artist.bump(mesh, 60, 0.2 * length, 0.03 * length)
    live.solve()
    live.export(path)
    session, _ = artist.modules()
    artist.until(lambda: artist.is_settled() and not session.is_busy(), 60)
    found = {"told": session.told(), "strokes": live.sculpt.strokes, "rest": rest,
             "co": rigs.co(mesh), "weights": artist.mesh_weights(), "bones": live.sculpt.bones,
             "joints": live.sculpt.joints, "equal": artist.equal(), "length": length,
             "scene": (mesh.mode, rig.hide_get(), mesh.select_get(), rig.select_get())}
    addon_utils.disable("io_scene_gltf2")
    live.export(path)
    artist.until(lambda: not session.is_busy())
    found["off"] = session.told()
    artist.stop("finish")
    return found
