"""Jobs for test_rig.py: what rig.py, weights.py and checks.py do with real meshes."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable

import bpy
import numpy as np

from inside import rigs
from skind.blender import checks, rig, weights
from skind.blender.snapshot import Snapshot
from skind.core import skin

SETTINGS = SimpleNamespace(influences="4", reduce=False)


def run(job: Any) -> Any:
    """A job's value."""
    while True:
        try:
            progress = next(job)
        except StopIteration as end:
            return end.value
        assert progress is None or 0 <= progress <= 1


def characters(kind: str) -> tuple[list[bpy.types.Object], bpy.types.Object]:
    """(meshes, armature): "tube", "rigify", or the path of a glTF file."""
    rigs.clear()
    if kind == "tube":
        mesh, armature = rigs.tube(2000, 8)
        return [mesh], armature
    if kind == "rigify":
        mesh, armature = rigs.rigify(levels=1)
        return [mesh], armature
    return rigs.imported(kind)


def random_pose(armature: bpy.types.Object, seed: int, degrees: float = 25.0) -> None:
    """Turns every bone about an axis of its own."""
    random = np.random.default_rng(seed)
    for bone in armature.pose.bones:
        axis = random.normal(size=3)
        half = math.radians(degrees) / 2
        bone.rotation_mode = "QUATERNION"
        bone.rotation_quaternion = (math.cos(half),
                                    *(axis / np.linalg.norm(axis) * math.sin(half)))
    bpy.context.view_layer.update()


def table(read: rig.Rig) -> tuple[np.ndarray, np.ndarray]:
    """joints u16 [V,N], weights f32 [V,N] with as many slots as the fullest vertex needs."""
    counts = np.diff(read.offsets.astype(np.int64))
    owners = np.repeat(np.arange(len(counts)), counts)
    places = np.arange(len(owners)) - read.offsets[owners]
    joints = np.full((len(counts), max(4, counts.max())), skin.NO_BONE, np.uint16)
    values = np.zeros(joints.shape, np.float32)
    joints[owners, places], values[owners, places] = read.joints, read.weights
    return joints, values


def error(mesh: bpy.types.Object, read: rig.Rig) -> float:
    """The largest distance between NumPy's posed mesh and Blender's, in parts of the length."""
    joints, values = table(read)
    matrices = skin.deformations(rig.pose(mesh, read.names, read.binds), read.binds)
    computed = skin.blend(read.positions, joints, values, matrices)
    length = np.linalg.norm(np.ptp(read.positions.astype(np.float64), axis=0))
    apart = np.linalg.norm(computed - rigs.posed(mesh), axis=1)
    return float(apart.max() / length)


def state(mesh: bpy.types.Object) -> tuple:
    """Everything that Start and Cancel must leave as it was, bit for bit."""
    return ([(group.name, group.lock_weight) for group in mesh.vertex_groups],
            mesh.vertex_groups.active_index,
            [[(entry.group, np.float32(entry.weight).tobytes()) for entry in vertex.groups]
             for vertex in mesh.data.vertices],
            rigs.co(mesh).tobytes(),
            [(modifier.name, modifier.type, modifier.show_viewport) for modifier in mesh.modifiers])


def skinning_errors(kind: str) -> dict[str, float]:
    """error() of each mesh at rest and in random poses."""
    meshes, armature = characters(kind)
    found = {}
    for mesh in meshes:
        read = run(rig.read(mesh.name))
        found[f"{mesh.name} as it comes"] = error(mesh, read)
    for seed in range(3):
        random_pose(armature, seed)
        for mesh in meshes:
            read = run(rig.read(mesh.name))
            found[f"{mesh.name} {seed}"] = error(mesh, read)
    return found


def moved_errors() -> dict[str, float]:
    """error() with objects moved, turned, scaled, mirrored, parented and not; binds kept."""
    (mesh,), armature = characters("tube")
    read = run(rig.read(mesh.name))
    random_pose(armature, 1)
    found = {}

    def measure(name: str) -> None:
        bpy.context.view_layer.update()
        found[name] = error(mesh, run(rig.read(mesh.name)))
        found[f"{name}, first binds"] = error(mesh, read)

    armature.location, armature.rotation_euler = (0.5, -0.3, 0.2), (0.4, 1.0, -0.3)
    measure("armature")
    armature.scale = (1.5, 0.7, 1.3)
    measure("scaled armature")
    mesh.location, mesh.rotation_euler, mesh.scale = (0.3, 0.1, -0.2), (0.2, 0.2, 0.3), (1, -2, 1)
    measure("mirrored mesh")
    mesh.parent = None
    measure("no parent")
    with_rest(armature)
    measure("bones moved at rest")
    return found


def with_rest(armature: bpy.types.Object) -> None:
    """Moves a bone of the rest pose."""
    rigs.activate(armature, "EDIT")
    armature.data.edit_bones[3].tail.x += 0.1
    rigs.activate(armature)


def facts() -> dict[str, Any]:
    """A rig with what is awkward: groups without bones, bones without groups or deform."""
    (mesh,), armature = characters("tube")
    armature.data.bones["bone.3"].use_deform = False
    mesh.vertex_groups.remove(mesh.vertex_groups["bone.5"])
    mesh.vertex_groups.new(name="cloth").add(range(100), 0.75, "REPLACE")
    for group in mesh.vertex_groups:
        group.remove([7])
    mesh.vertex_groups["bone.0"].add([8], 0.0, "REPLACE")
    random_pose(armature, 3)
    read = run(rig.read(mesh.name))
    mesh.data.calc_loop_triangles()
    table_ = rigs.weights(mesh)
    columns = [mesh.vertex_groups.find(name) for name in read.names]
    wanted = np.stack([table_[:, column] if column >= 0 else np.zeros(len(table_), np.float32)
                       for column in columns], 1)
    dense = np.zeros_like(wanted)
    owners = np.repeat(np.arange(len(wanted)), np.diff(read.offsets.astype(np.int64)))
    dense[owners, read.joints] = read.weights
    return {"names": read.names, "parents": read.parents, "dense": dense, "wanted": wanted,
            "zeros": int((read.weights == 0).sum()), "unweighted": np.flatnonzero(read.unweighted),
            "error": error(mesh, read), "positions": read.positions, "co": rigs.co(mesh),
            "triangles": read.triangles, "dtypes": {name: str(getattr(read, name).dtype) for name
                                                   in ("positions", "triangles", "parents", "binds",
                                                       "offsets", "joints", "weights")},
            "drawn": [tuple(each.vertices) for each in mesh.data.loop_triangles]}


def _filled(read: rig.Rig) -> np.ndarray:
    """joints u16 [V,4], as the daemon fills free slots: with other bones."""
    joints, values = table(read)
    joints = np.take_along_axis(joints, np.argsort(-values, 1, kind="stable")[:, :4], 1)
    random = np.random.default_rng(5)
    for row in joints:
        others = [bone for bone in random.permutation(len(read.names)) if bone not in row]
        free = np.flatnonzero(row == skin.NO_BONE)[:len(others)]
        row[free] = others[:len(free)]
    return joints


def _rows(joints: np.ndarray, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    rows = random.random(joints.shape).astype(np.float32) + np.float32(1e-3)
    rows[joints == skin.NO_BONE] = 0
    return (rows / rows.sum(1, keepdims=True)).astype(np.float32)


def round_trip(kind: str, meddle: str = "") -> dict[str, Any]:
    """Start, a stroke's write, Cancel; then Start and Finish without a stroke."""
    mesh = characters(kind)[0][0]
    mesh.vertex_groups.new(name="cloth").add(range(0, 50), 1 / 3, "REPLACE")
    mesh.vertex_groups[1].lock_weight = True
    mesh.vertex_groups.active_index = 2
    before, shown = state(mesh), rigs.posed(mesh)
    read = run(rig.read(mesh.name))
    snapshot = run(Snapshot.take(mesh.name))
    snapshot = Snapshot.from_bytes(snapshot.to_bytes())
    joints = _filled(read)
    layout = run(weights.make_slots(mesh.name, read.names, joints, read.unweighted))
    mesh.data.update()
    now = run(weights.entries(mesh.name))
    found = {"same shape": bool((rigs.posed(mesh) == shown).all()),
             "layout fits": (now.offsets.tolist() == layout.offsets.tolist()
                             and now.groups.tolist() == layout.members.tolist())}

    vertices = np.flatnonzero(np.arange(len(joints)) % 3 > 0).astype(np.uint32)
    rows = _rows(joints[vertices])
    cloth = mesh.vertex_groups["cloth"].index
    others = rigs.weights(mesh)[:, cloth].copy()
    run(weights.write_rows(mesh.name, layout, vertices, rows))
    mesh.data.update()
    takes = ~read.unweighted[vertices]
    back = weights.read_rows(mesh.name, layout, vertices)
    found["rows"] = bool((back[takes] == rows[takes]).all())
    found["other groups"] = bool((rigs.weights(mesh)[:, cloth] == others).all())
    changed = run(rig.read(mesh.name))
    found["error"] = error(mesh, changed)
    counts = np.diff(changed.offsets.astype(np.int64))[vertices][takes]
    found["influences"] = int(counts.max())

    rigs_co = rigs.co(mesh) + np.float32(0.01)
    mesh.data.vertices.foreach_set("co", rigs_co.ravel())
    MEDDLING[meddle](mesh)
    run(Snapshot.restore(mesh.name, snapshot))
    found["restored"] = state(mesh) == before
    found["shape restored"] = bool((rigs.posed(mesh) == shown).all())

    layout = run(weights.make_slots(mesh.name, read.names, joints, read.unweighted))
    run(weights.remove_padding(mesh.name, layout))
    found["padding gone"] = state(mesh) == before
    return found


def _remove_group(mesh: bpy.types.Object) -> None:
    mesh.vertex_groups.remove(mesh.vertex_groups[0])


def _rename_group(mesh: bpy.types.Object) -> None:
    mesh.vertex_groups[1].name = "renamed"


def _change_entries(mesh: bpy.types.Object) -> None:
    mesh.vertex_groups[0].add(range(0, 200, 3), 0.5, "REPLACE")
    mesh.vertex_groups[1].remove(range(0, 200, 2))
    mesh.vertex_groups[1].add(range(0, 100, 2), 0.25, "REPLACE")  # back, but behind the others
    mesh.vertex_groups[1].lock_weight = False
    mesh.vertex_groups.new(name="more").add(range(10, 60), 1.0, "REPLACE")


def _leave_alone(mesh: bpy.types.Object) -> None:
    del mesh


MEDDLING: dict[str, Callable[[bpy.types.Object], None]] = {
    "": _leave_alone, "group removed": _remove_group, "group renamed": _rename_group,
    "entries changed": _change_entries}


def bare() -> dict[str, Any]:
    """A mesh without any group gets them, and loses them again."""
    (mesh,), _ = characters("tube")
    names = [group.name for group in mesh.vertex_groups]
    mesh.vertex_groups.clear()
    before = state(mesh)
    snapshot = run(Snapshot.take(mesh.name))
    count = len(mesh.data.vertices)
    joints = np.tile(np.array([2, 0, 1, skin.NO_BONE], np.uint16), (count, 1))
    skip = np.arange(count) < 10
    layout = run(weights.make_slots(mesh.name, names, joints, skip))
    run(weights.write_rows(mesh.name, layout, np.arange(count, dtype=np.uint32), _rows(joints)))
    values = rigs.weights(mesh)
    made = [group.name for group in mesh.vertex_groups]
    run(Snapshot.restore(mesh.name, snapshot))
    return {"made": made, "skipped": float(abs(values[:10]).max()),
            "least": float(values[10:].min()), "restored": state(mesh) == before}


def stale() -> dict[str, str]:
    """What write_rows says when the groups are no longer those of the layout."""
    found = {}
    for meddle in ("group removed", "group renamed", "entries changed", "vertices"):
        (mesh,), _ = characters("tube")
        read = run(rig.read(mesh.name))
        joints = _filled(read)
        layout = run(weights.make_slots(mesh.name, read.names, joints, read.unweighted))
        if meddle == "vertices":
            mesh.data.vertices.add(1)
        else:
            MEDDLING[meddle](mesh)
        try:
            run(weights.write_rows(mesh.name, layout, np.arange(len(joints)), _rows(joints)))
            found[meddle] = ""
        except weights.MeshChanged as problem:
            found[meddle] = str(problem)
    return found


def exact_bits() -> bool:
    """Weights that Blender's own fields would clamp or round come back as they were."""
    (mesh,), _ = characters("tube")
    odd = np.array([1.5, -0.25, 1e-40, 1.0000001], np.float32)
    mesh.data.vertices[0].groups.foreach_set("weight", odd)
    before = state(mesh)
    snapshot = Snapshot.from_bytes(run(Snapshot.take(mesh.name)).to_bytes())
    mesh.data.vertices[0].groups.foreach_set("weight", np.zeros(4, np.float32))
    run(Snapshot.restore(mesh.name, snapshot))
    return state(mesh) == before


def broken_snapshots() -> dict[str, Any]:
    """Which damaged snapshots were taken for good ones of something else."""
    (mesh,), _ = characters("tube")
    good = run(Snapshot.take(mesh.name)).to_bytes()
    head = 8 + int.from_bytes(good[4:8], "little")
    bad = {"empty": b"", "magic": b"XXXX" + good[4:], "longer": good + b"x"}
    bad |= {f"cut {at}": good[:at] for at in [*range(0, head, 3), head, head + 9, len(good) - 1]}
    for old, new in ((b'"bone.1"', b'"bone.0"'), (b"[false", b"[12345"),
                     (b'"active": 7', b'"active": 9'),
                     (b'"vertices": 2', b'"vertices": 9'), (b'"entries": 8', b'"entries": -')):
        assert old in good[:head], old
        bad[str(new)] = good[:head].replace(old, new) + good[head:]
    for at in range(head, len(good), max(1, (len(good) - head) // 60)):
        bad[f"bit {at}"] = good[:at] + bytes([good[at] ^ 16]) + good[at + 1:]
    accepted = []
    for name, data in bad.items():
        try:
            # A few bits of a packed stream mean nothing: then it is the same snapshot.
            if Snapshot.from_bytes(data).to_bytes() != good:
                accepted.append(name)
        except ValueError:
            pass
    return {"accepted": accepted, "tried": len(bad)}


def pieces(vertices: int) -> dict[str, int]:
    """Into how many pieces each job is cut."""
    rigs.clear()
    mesh, _ = rigs.tube(vertices, 8)
    found = {}

    def counted(name: str, job: Any) -> Any:
        found[name] = 1
        while True:
            try:
                next(job)
            except StopIteration as end:
                return end.value
            found[name] += 1

    read = counted("read", rig.read(mesh.name))
    snapshot = counted("take", Snapshot.take(mesh.name))
    joints = _filled(read)
    layout = counted("slots", weights.make_slots(mesh.name, read.names, joints, read.unweighted))
    rows = _rows(joints)
    counted("write", weights.write_rows(mesh.name, layout, np.arange(vertices), rows))
    counted("restore", Snapshot.restore(mesh.name, snapshot))
    return found


# --- Refusals -----------------------------------------------------------------------------------


def refused(case: str) -> tuple[list[str], list[str]]:
    """What is refused before and after a case of REFUSED, on a tube that is fine."""
    (mesh,), armature = characters("tube")
    rigs.activate(mesh)
    before = checks.refusals(mesh, SETTINGS)
    subject = REFUSED[case](mesh, armature)
    bpy.context.view_layer.update()
    return before, checks.refusals(mesh if subject is None else subject, SETTINGS)


def all_refused() -> dict[str, tuple[list[str], list[str]]]:
    return {case: refused(case) for case in REFUSED}


def nothing() -> list[str]:
    return checks.refusals(None, SETTINGS)


def limits() -> dict[str, list[str]]:
    """What eight influences a vertex are told under different settings."""
    (mesh,), _ = characters("tube")
    for group in mesh.vertex_groups:
        group.add([3, 4, 5], 0.125, "REPLACE")
    def told(influences: str, reduce: bool, **more: bool) -> list[str]:
        return checks.refusals(mesh, SimpleNamespace(influences=influences, reduce=reduce), **more)
    return {"4": told("4", False), "8": told("8", False), "reduce": told("4", True),
            "join": told("4", False, any_influences=True)}


def _modifier(kind: str, first: bool = False, **values: Any) -> Callable:
    def change(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
        made = mesh.modifiers.new(kind.title(), kind)
        for name, value in values.items():
            setattr(made, name, value)
        if first:
            bpy.ops.object.modifier_move_to_index(modifier=made.name, index=0)
    return change


def _set_modifier(**values: Any) -> Callable:
    def change(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
        for name, value in values.items():
            setattr(mesh.modifiers["Armature"], name, value)
    return change


def _set_bone(name: str, **values: Any) -> Callable:
    def change(_mesh: bpy.types.Object, armature: bpy.types.Object) -> None:
        for field, value in values.items():
            setattr(armature.data.bones[name], field, value)
    return change


def _set_mesh(**values: Any) -> Callable:
    def change(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
        for name, value in values.items():
            setattr(mesh, name, value)
    return change


def _flat_armature(mesh: bpy.types.Object, armature: bpy.types.Object) -> None:
    mesh.parent = None  # it would be flat as well
    armature.scale = (1, 1, 0)


def _no_deform(_mesh: bpy.types.Object, armature: bpy.types.Object) -> None:
    for bone in armature.data.bones:
        bone.use_deform = False


def _share(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
    bpy.data.objects.new("Twin", mesh.data)


def _no_faces(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
    mesh.data.clear_geometry()


def _not_numbers(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
    values = rigs.co(mesh)
    values[3, 1] = np.nan
    mesh.data.vertices.foreach_set("co", values.ravel())


def _link(mesh: bpy.types.Object, _armature: bpy.types.Object) -> bpy.types.Object:
    path = str(Path(bpy.app.tempdir) / "library.blend")
    bpy.data.libraries.write(path, {mesh})
    with bpy.data.libraries.load(path, link=True) as (_, into):
        into.objects = [mesh.name]
    return into.objects[0]


def _override(mesh: bpy.types.Object, armature: bpy.types.Object) -> bpy.types.Object:
    return _link(mesh, armature).override_create()


def _dyntopo(mesh: bpy.types.Object, _armature: bpy.types.Object) -> None:
    rigs.activate(mesh, "SCULPT")
    bpy.ops.sculpt.dynamic_topology_toggle()


REFUSED: dict[str, Callable] = {
    "an armature": lambda _mesh, armature: armature,
    "no modifier": lambda mesh, _: mesh.modifiers.clear(),
    "hidden modifier": _set_modifier(show_viewport=False),
    "two armatures": _modifier("ARMATURE"),
    "not first": _modifier("SUBSURF", first=True),
    "displace after": _modifier("DISPLACE"),
    "nodes after": _modifier("NODES"),
    "multires": _modifier("MULTIRES"),
    "no armature": _set_modifier(object=None),
    "preserve volume": _set_modifier(use_deform_preserve_volume=True),
    "envelopes": _set_modifier(use_bone_envelopes=True),
    "no groups": _set_modifier(use_vertex_groups=False),
    "vertex group": _set_modifier(vertex_group="bone.1"),
    "multi modifier": _set_modifier(use_multi_modifier=True),
    "bendy bone": _set_bone("bone.2", bbone_segments=3),
    "envelope multiply": _set_bone("bone.2", use_envelope_multiply=True),
    "no deform bones": _no_deform,
    "shape keys": lambda mesh, _: mesh.shape_key_add(name="Basis") and None,
    "shared": _share,
    "linked": _link,
    "override": _override,
    "no faces": _no_faces,
    "not numbers": _not_numbers,
    "no weights": lambda mesh, _: mesh.vertex_groups.clear(),
    "hidden": lambda mesh, _: mesh.hide_set(True),
    "flat mesh": _set_mesh(scale=(1, 0, 1)),
    "flat armature": _flat_armature,
    "parent deforms": _set_mesh(parent_type="ARMATURE"),
    "edit mode": lambda mesh, _: rigs.activate(mesh, "EDIT"),
    "armature edited": lambda _, armature: rigs.activate(armature, "EDIT"),
    "dyntopo": _dyntopo,
}


def allowed() -> dict[str, list[str]]:
    """What must not be refused."""
    found = {}
    for name, change in {
            "subdivision": _modifier("SUBSURF"), "mirror": _modifier("MIRROR"),
            "solidify": _modifier("SOLIDIFY"),
            "hidden displace": _modifier("DISPLACE", show_viewport=False),
            "hidden first": _modifier("DISPLACE", first=True, show_viewport=False),
            "bendy without group": _bendy_without_group,
            "fake user": lambda mesh, _: setattr(mesh.data, "use_fake_user", True),
            "mirrored": _set_mesh(scale=(-1, 1, 1)),
            "sculpt mode": lambda mesh, _: rigs.activate(mesh, "SCULPT"),
            "weight paint": lambda mesh, _: rigs.activate(mesh, "WEIGHT_PAINT")}.items():
        (mesh,), armature = characters("tube")
        rigs.activate(mesh)
        change(mesh, armature)
        bpy.context.view_layer.update()
        found[name] = checks.refusals(mesh, SETTINGS)
    return found


def _bendy_without_group(mesh: bpy.types.Object, armature: bpy.types.Object) -> None:
    mesh.vertex_groups.remove(mesh.vertex_groups["bone.2"])
    armature.data.bones["bone.2"].bbone_segments = 4


def rigify_bendy() -> list[str]:
    rigs.clear()
    body, _ = rigs.rigify(bendy=True, levels=1)
    return checks.refusals(body, SimpleNamespace(influences="4", reduce=True))
