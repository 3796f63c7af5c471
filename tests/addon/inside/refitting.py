"""Jobs about refit: all weights from another mesh that moves."""

from __future__ import annotations

import bpy
import numpy as np

from inside import artist, layers, rigs


def two_tubes(aside: float = 0.0) -> tuple[bpy.types.Object, bpy.types.Object, bpy.types.Object]:
    """(mesh, source, armature): a tube that hangs on its nearest bones alone, and a copy of it,
    perhaps aside and with an armature there, that has the weights it should have. An action bends
    both."""
    mesh, rig = artist.rigged("tube")
    layers.bend_action(rig, 35)
    source, puppet = mesh.copy(), rig.copy()
    source.data = mesh.data.copy()
    source.name = "source"
    source.parent = None
    source.modifiers[0].object = puppet
    for thing in (source, puppet):
        thing.location.x += aside
        bpy.context.collection.objects.link(thing)
    shown = rigs.weights(mesh)
    for vertex, strongest in enumerate(shown.argmax(1)):
        for group in mesh.vertex_groups:
            if group.index == strongest:
                group.add([vertex], 1.0, 'REPLACE')
            else:
                group.remove([vertex])
    bpy.context.scene.frame_set(7)
    return mesh, source, rig


def apart(mesh: bpy.types.Object, source: bpy.types.Object, frames: list[int]) -> float:
    """The largest distance between the two in these frames, each in its own space."""
    found = 0.0
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        found = max(found, float(artist.apart(rigs.posed(mesh), rigs.posed(source)).max()))
    return found


def refitted(aside: float) -> dict:
    """The button, in a pose that is not keyed; what it finds, and what it leaves as it was."""
    from skind.core import Link

    mesh, source, rig = two_tubes(aside)
    unseen = [4, 13, 18, 28, 33, 39]
    found = {"before": apart(mesh, source, unseen)}
    live = artist.start(mesh)
    bpy.context.scene.frame_set(7)
    bone = rig.pose.bones[2]
    bone.rotation_euler.z += 0.3  # not keyed
    bpy.context.view_layer.update()
    kept = tuple(bone.rotation_euler), rigs.co(mesh).tobytes(), mesh.mode
    weights = artist.mesh_weights().tobytes()
    bpy.ops.skind.refit(source="source", first=1, last=41, count=8, in_place=aside == 0)
    artist.until(lambda: live.sculpt.steps.live > 0)
    artist.until(artist.is_settled)
    found["told"] = artist.modules()[0].told()
    found["untouched"] = (kept == (tuple(bone.rotation_euler), rigs.co(mesh).tobytes(), mesh.mode)
                          and bpy.context.scene.frame_current == 7)
    found["equal"] = artist.equal()
    found["length"] = live.sculpt.length
    found["after"] = apart(mesh, source, unseen)
    with Link.connect(artist.modules()[0].channel().path, name="another tool") as other:
        other.call("history.undo", {"session": live.sculpt.name})
    artist.until(lambda: live.sculpt.revision == 2 and artist.is_settled())
    found["undone"] = artist.mesh_weights().tobytes() == weights
    artist.stop("cancel")
    return found


def refused() -> dict:
    """What is no mesh to refit to, each with its sentence."""
    from skind.blender import refit

    mesh, source, rig = two_tubes()
    other = rigs.add_mesh("other", np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))
    frames = refit.chosen_frames(1, 41, 8)
    found = {
        "none": refit.problem(mesh, None, frames, 256), "self": refit.problem(mesh, mesh, frames, 256),
        "bones": refit.problem(mesh, rig, frames, 256), "other": refit.problem(mesh, other, frames, 256),
        "many": refit.problem(mesh, source, frames, 7), "fine": refit.problem(mesh, source, frames, 8)}
    artist.start(mesh)
    rig.animation_data_clear()
    before = artist.mesh_weights().tobytes()
    bpy.ops.skind.refit(source="source", first=1, last=41, count=8)
    artist.until(lambda: "does not move" in artist.modules()[0].told())
    found["kept"] = artist.mesh_weights().tobytes() == before
    artist.stop("cancel")
    return found
