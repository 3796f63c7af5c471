"""Jobs about Refit: weights that were lost are won back from another mesh's motion."""

from __future__ import annotations

import struct
from pathlib import Path

import bpy
import numpy as np

from inside import artist, layers, rigs

LENGTH = rigs.TUBE_HEIGHT
FRAMES = (1, 41)


def _bend(rig: bpy.types.Object) -> None:
    """An action that bends every bone, each about its own axis and at its own pace."""
    for index, bone in enumerate(rig.pose.bones):
        bone.rotation_mode = "XYZ"
        for frame in range(FRAMES[0], FRAMES[1] + 1, 5):
            angles = np.radians(28) * np.sin(0.37 * frame * (1 + 0.31 * index)
                                             + np.array([0, 2.1, 4.2]) + index)
            bone.rotation_euler = angles if frame > 1 else (0, 0, 0)
            bone.keyframe_insert("rotation_euler", frame=frame)


def _nearest(thing: bpy.types.Object) -> None:
    """Each vertex belongs to the nearest bone alone."""
    names = [group.name for group in thing.vertex_groups]
    bones = np.clip((rigs.co(thing)[:, 2] / LENGTH * len(names)).astype(int), 0, len(names) - 1)
    for index, name in enumerate(names):
        group = thing.vertex_groups[name]
        group.remove(list(range(len(bones))))
        group.add(np.flatnonzero(bones == index).tolist(), 1.0, "REPLACE")


def _stage() -> tuple[bpy.types.Object, bpy.types.Object, bpy.types.Object]:
    """(mesh, armature, source): the mesh has its nearest bones, the source the true weights. The
    character travels, turns and is scaled; the source has an object space of its own."""
    mesh, rig = artist.rigged("tube")
    source = mesh.copy()
    source.data = mesh.data.copy()
    source.name = "Truth"
    bpy.context.scene.collection.objects.link(source)
    _nearest(mesh)
    _bend(rig)
    rig.scale = (1.5, 1.5, 1.5)
    for frame, x in ((1, 0.0), (41, 3.0)):
        rig.location.x = x
        rig.rotation_euler.z = x / 3
        rig.keyframe_insert("location", frame=frame)
        rig.keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_set(7)
    return mesh, rig, source


def _surroundings(rig: bpy.types.Object) -> dict:
    """What the artist has, and must have afterwards."""
    context, scene = bpy.context, bpy.context.scene
    return {
        "frame": (scene.frame_current, scene.frame_subframe),
        "scene": scene.name,
        "basis": [np.array(bone.matrix_basis).tobytes() for bone in rig.pose.bones],
        "channels": [np.array(bone.matrix_channel).tobytes() for bone in rig.pose.bones],
        "object": np.array(rig.matrix_world).tobytes(),
        "selected": sorted(thing.name for thing in context.view_layer.objects
                           if thing.select_get()),
        "active": context.view_layer.objects.active.name,
        "blocks": [sorted(block.name for block in blocks) for blocks in (
            bpy.data.scenes, bpy.data.objects, bpy.data.meshes, bpy.data.armatures,
            bpy.data.actions, bpy.data.collections)],
        "linked": [sorted(each.name for each in thing.users_collection)
                   for thing in bpy.data.objects],
    }


def _unkeyed(rig: bpy.types.Object) -> None:
    """The artist turns a bone and moves the character, and keys neither."""
    rig.pose.bones[2].rotation_euler.x += 0.4
    rig.location.y += 0.3
    bpy.context.view_layer.update()


def _refit(**named) -> str:
    """Refits and waits; what the panel says."""
    session, _ = artist.modules()
    session.tell("")
    assert bpy.ops.skind.refit(**{"first": FRAMES[0], "last": FRAMES[1], **named}) == {'FINISHED'}
    artist.until(artist.is_settled, 60)
    return session.told()


def _world(thing: bpy.types.Object) -> np.ndarray:
    """f64 [V,3]: where its vertices are seen."""
    shown = rigs.posed(thing).astype(np.float64)
    matrix = np.array(thing.matrix_world, np.float64)
    return shown @ matrix[:3, :3].T + matrix[:3, 3]


def _over_frames(thing: bpy.types.Object, frames: range) -> np.ndarray:
    """f64 [F,V,3]"""
    seen = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        seen.append(_world(thing))
    bpy.context.scene.frame_set(7)
    return np.array(seen)


def _cache(source: bpy.types.Object, folder: str) -> None:
    """Bakes the source into a point cache of an object that is turned and scaled, as importers
    leave it: without armature or parent."""
    frames = range(FRAMES[0], FRAMES[1] + 1)
    seen = _over_frames(source, frames)
    source.modifiers.clear()
    source.parent = None
    source.animation_data_clear()
    source.location, source.rotation_euler = (0.2, -0.4, 0.1), (np.pi / 2, 0, 0.3)
    source.scale = (0.5, 0.5, 0.5)
    bpy.context.view_layer.update()
    back = np.linalg.inv(np.array(source.matrix_world, np.float64))
    points = (seen @ back[:3, :3].T + back[:3, 3]).astype("<f4")
    path = Path(folder) / "truth.pc2"
    path.write_bytes(struct.pack("<12siiffi", b"POINTCACHE2", 1, points.shape[1], FRAMES[0], 1,
                                 len(points)) + points.tobytes())
    modifier = source.modifiers.new("Cache", "MESH_CACHE")
    modifier.cache_format, modifier.filepath = "PC2", str(path)
    modifier.frame_start = FRAMES[0]


def won_back(folder: str = "") -> dict:
    """Refit from 8 frames, with the artist in a frame and an unkeyed pose of his own; how far all
    frames are from the truth before and after. `folder`: the source is a point cache in there."""
    mesh, rig, source = _stage()
    truth = _over_frames(source, range(*FRAMES))
    if folder:
        _cache(source, folder)
    live = artist.start(mesh)
    tape = layers.Tape()

    def far() -> float:
        apart = np.linalg.norm(_over_frames(mesh, range(*FRAMES)) - truth, axis=2)
        return float(np.sqrt((apart ** 2).mean()) / (1.5 * LENGTH))

    found = {"before": far()}
    _unkeyed(rig)
    had = _surroundings(rig)
    found["told"] = _refit(source=source.name)
    found["different"] = artist.different(had, _surroundings(rig))
    tape.record()
    found |= {"equal": artist.equal(), "after": far(), "states": live.sculpt.steps.live}
    tape.go(0)
    artist.until(artist.is_settled)
    found["undone"] = layers.whole(mesh) == tape.facts[0] and artist.equal()
    tape.go(1)
    artist.until(artist.is_settled)
    found["redone"] = layers.whole(mesh) == tape.facts[1] and artist.equal()
    artist.stop("cancel")
    return found


def cancelled() -> dict:
    """Cancelled between two frames, and while skind solves."""
    mesh, rig, source = _stage()
    live = artist.start(mesh)
    before = layers.whole(mesh)
    _unkeyed(rig)
    had = _surroundings(rig)
    session, pump = artist.modules()
    found = {}
    for when in ("looking", "solving"):
        session.tell("")
        bpy.ops.skind.refit(source=source.name, first=FRAMES[0], last=FRAMES[1])
        job = live.job
        if when == "looking":
            artist.until(lambda: job.progress is not None and job.progress > 0.3)
            live.cancel_pending()
        else:
            with artist.halted():
                artist.until(lambda: session.channel().unanswered > 0)
                live.cancel_pending()
        artist.until(artist.is_settled)
        found[when] = {"told": session.told(), "different": artist.different(
            had, _surroundings(rig)), "whole": before == layers.whole(mesh),
            "equal": artist.equal()}
    artist.stop("cancel")
    return found


def refused() -> dict:
    """What the panel says to each wish that cannot be; `whole`: none of them changed anything."""
    mesh, rig, source = _stage()
    live = artist.start(mesh)
    other = rigs.add_mesh("Few", np.eye(3), np.arange(3)[None])
    fine = source.copy()
    fine.data = source.data.copy()
    fine.name = "Fine"
    fine.modifiers.new("Subdivision", "SUBSURF")
    cloth = source.copy()
    cloth.name = "Cloth"
    cloth.modifiers.new("Cloth", "CLOTH")
    hidden = source.copy()
    hidden.name, hidden.hide_viewport = "Hidden", True
    for thing in (fine, cloth, hidden):
        bpy.context.scene.collection.objects.link(thing)
    rigs.activate(mesh)
    before = layers.whole(mesh)
    _unkeyed(rig)
    had = _surroundings(rig)
    limit = artist.modules()[0].channel().hello["limits"]["target_poses"]
    wishes = {
        "nothing": {}, "missing": {"source": "Nobody"}, "itself": {"source": mesh.name},
        "armature": {"source": rig.name}, "few": {"source": other.name},
        "fine": {"source": fine.name}, "cloth": {"source": cloth.name},
        "hidden": {"source": hidden.name},
        "backwards": {"source": source.name, "first": 9, "last": 3},
        "still": {"source": source.name, "first": 60, "last": 70},
        "many": {"source": source.name, "first": 1, "last": 2 * limit, "count": limit + 1},
    }
    found = {name: _refit(**wish) for name, wish in wishes.items()}
    found["different"] = artist.different(had, _surroundings(rig))
    found["whole"] = before == layers.whole(mesh) and live.sculpt.steps.live == 0
    found["limit"] = limit
    artist.stop("cancel")
    return found


def from_a_bake() -> dict:
    """A cloth on top of the armature, baked: what is seen in our own scene against the artist's;
    and how much the cloth does."""
    from skind.blender import refit
    mesh, rig, source = _stage()
    source.vertex_groups.new(name="pinned").add(list(range(2000)), 0.9, "REPLACE")
    cloth = source.modifiers.new("Cloth", "CLOTH")
    cloth.settings.vertex_group_mass = "pinned"
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 12
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = 1, 12
    with bpy.context.temp_override(scene=scene, object=source, active_object=source,
                                   point_cache=cloth.point_cache):
        bpy.ops.ptcache.bake(bake=True)
    live = artist.start(mesh)
    frames, made = [2, 5, 9, 12], live.sculpt.rig
    work = refit.sample(mesh.name, source.name, made.names, made.binds, 2000, frames)
    _, shapes = layers._run(work)
    apart, moved = [], []
    for frame, shape in zip(frames, shapes):
        scene.frame_set(frame)
        matrix = np.array(mesh.matrix_world, np.float64)
        seen = shape @ matrix[:3, :3].T + matrix[:3, 3]
        apart.append(float(artist.apart(seen, _world(source)).max()))
        cloth.show_viewport = False
        bpy.context.view_layer.update()
        moved.append(float(artist.apart(seen, _world(source)).max()))
        cloth.show_viewport = True
    artist.stop("cancel")
    return {"baked": cloth.point_cache.is_baked, "apart": apart, "moved": moved}
