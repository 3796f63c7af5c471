"""Chapter 8 of the thesis again, as rendered pictures: slots, one bone's reach, a sculpted limb."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from .brush import normals
from .characters import MANY_INFLUENCES, NO_BONE, Rig, load, rescaled
from .damage import smoothed
from .lab import ASSETS, Lab
from .measure import apart
from .raster import Camera, draw, heat
from .session import Session

COUNT_COLOURS = {0: (235, 235, 235), 1: (214, 60, 52), 2: (240, 150, 50), 3: (245, 220, 80),
                 4: (80, 175, 90), 5: (70, 110, 200)}
REACH_COLOURS = {"none": (95, 130, 200), "free": (245, 220, 80), "weight": (80, 175, 90)}
SKIN = (205, 200, 192)
MUCH_SMOOTHED = 60  # rounds: an elbow as soft as a hose
SCULPTED = 0.3  # metres around the joint, on a body of L = 2 m
BULGE, BULGE_RADIUS = 0.014, 0.09
FULL_HEAT = 0.015
LIMB_BONES = ("lowerarm01.L", "forearm.L", "lowerarm.l")
SHOULDER_BONES = ("upperarm01.L", "upper_arm.L", "upperarm.l")


# How the limb is solved, and the poses that are sculpted for it.
WAYS = {"Before": ({}, ()),
        "Solved by the thesis": ({"method": "thesis"}, ("edited",)),
        "Solved by this": ({"slots": "evidence"}, ("edited",)),
        "This, both sculpted, + rest": ({}, ("edited", "other"))}


@dataclass(frozen=True)
class Picture:
    title: str
    png: bytes
    note: str = ""


def subject(lab: Lab, rigs: list[Rig]) -> Rig:
    """Who is shown: MakeHuman's body, the thesis's own source, if it is there."""
    return next((rig for rig in rigs if rig.name == "makehuman"), rigs[0])


def find_bone(rig: Rig, names: tuple[str, ...]) -> int:
    """A bone by the names that it may have, else the one that shares most with its parent."""
    for name in names:
        if name in rig.names:
            return rig.names.index(name)
    shared = [0.0 if up < 0 else float((rig.dense[:, bone] * rig.dense[:, up]).sum())
              for bone, up in enumerate(rig.parents)]
    return int(np.argmax(shared))


def below(rig: Rig, bone: int) -> np.ndarray:
    """[B] whether a bone is this one or hangs from it."""
    found = np.zeros(len(rig.parents), bool)
    for index in range(len(rig.parents)):
        up = index
        while up >= 0 and up != bone:
            up = rig.parents[up]
        found[index] = up == bone
    return found


def turned(rig: Rig, turns: list[tuple[int, np.ndarray, float]]) -> np.ndarray:
    """Posed matrices [B,4,4]: each (bone, axis, degrees) turns a joint with all that hangs from it.

    Axes are those of the rest pose; the joint nearest the root comes last.
    """
    posed = rig.binds.copy()
    for bone, axis, degrees in turns:
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * np.asarray(axis)).as_matrix()
        head = rig.binds[bone][:3, 3]
        turn[:3, 3] = head - turn[:3, :3] @ head
        moves = below(rig, bone)
        posed[moves] = turn @ posed[moves]
    return posed


def front(rig: Rig) -> Camera:
    """The whole character from the front."""
    return Camera(np.zeros(3), 1.0, pixels=(260, 420)).fitted(rig.positions)


def counted(rig: Rig, camera: Camera, joints: np.ndarray) -> bytes:
    colours = np.array([COUNT_COLOURS[min(int(count), 5)] for count in (joints != NO_BONE).sum(1)],
                       float)
    return draw(camera, rig.positions, rig.triangles, normals(rig, rig.positions), colours, False)


def slot_pictures(lab: Lab, rigs: list[Rig]) -> list[Picture]:
    """Bones that influence each vertex, in the file and after the slots were filled."""
    rig, options = subject(lab, rigs), {}
    if rig.name == "makehuman" and (ASSETS / MANY_INFLUENCES).exists():
        rig = load(lab, rig.name, ASSETS / MANY_INFLUENCES, influences=8)
        options = {"reduce": "posed"}
    with Session(lab, rig, fill="hop", **options) as session:
        filled = session.call("weights.get")["joints"]
    own = np.where(rig.weights > 0, rig.joints, NO_BONE)
    return [Picture("Before", counted(rig, front(rig), own), "the file's own influences"),
            Picture("After", counted(rig, front(rig), filled), "four slots, filled by hops")]


def reach_pictures(lab: Lab, rigs: list[Rig]) -> list[Picture]:
    """One bone at a time: vertices that it moves, those it could move, those it cannot."""
    rig = subject(lab, rigs)
    forearm = find_bone(rig, LIMB_BONES)
    chain, up = [forearm], int(rig.parents[forearm])
    while up >= 0 and len(chain) < 5:
        chain.append(up)
        up = int(rig.parents[up])
    shoulders = [bone for bone in chain[:-1] if rig.names[bone] in SHOULDER_BONES]
    chosen = [chain[-1], *shoulders, forearm]
    camera = Camera(rig.binds[chain[1]][:3, 3], 0.75, pixels=(250, 280))
    shading, pictures = normals(rig, rig.positions), []
    with Session(lab, rig, fill="hop") as session:
        rows = session.call("weights.get")
    for bone in dict.fromkeys(chosen):
        has = rows["joints"] == bone
        weighs = (has & (rows["weights"] > 0)).any(axis=1)
        colours = np.where(weighs[:, None], REACH_COLOURS["weight"],
                           np.where(has.any(axis=1)[:, None], REACH_COLOURS["free"],
                                    REACH_COLOURS["none"])).astype(float)
        pictures.append(Picture(rig.names[bone],
                                draw(camera, rig.positions, rig.triangles, shading, colours, False),
                                f"{int(weighs.sum())} vertices moved, "
                                f"{int((has.any(1) & ~weighs).sum())} more within reach"))
    return pictures


@dataclass(frozen=True)
class Limb:
    """A limb whose weights are too soft, and what an artist wants instead, in two poses."""

    rig: Rig
    soft: Rig
    vertices: np.ndarray  # that are sculpted
    triangles: np.ndarray  # of the limb alone
    poses: dict[str, np.ndarray]
    wanted: dict[str, np.ndarray]
    camera: dict[str, Camera]


def muscular(rig: Rig, centre: np.ndarray) -> Rig:
    """The rig with more flesh around a place: nothing that weights can do."""
    distance = np.linalg.norm(rig.positions - centre, axis=1)
    falloff = np.clip(1 - (distance / BULGE_RADIUS) ** 2, 0, None) ** 2
    return replace(rig, positions=rig.positions
                   + BULGE * falloff[:, None] * normals(rig, rig.positions))


def make_limb(lab: Lab, rig: Rig) -> Limb:
    bone = find_bone(rig, LIMB_BONES)
    joint = rig.binds[bone][:3, 3]
    carried = rig.dense[:, below(rig, bone)].sum(axis=1)
    tip = rig.positions[carried > 0.9].mean(axis=0) - joint
    tip /= np.linalg.norm(tip)
    parent = joint - rig.binds[rig.parents[bone]][:3, 3]
    hinge = np.cross(parent, tip)
    if np.linalg.norm(hinge) < 1e-3 * np.linalg.norm(parent):
        hinge = np.cross(tip, [0, 0, 1])
    hinge /= np.linalg.norm(hinge)
    above = int(rig.parents[bone])
    top = max(int(rig.parents[max(above, 0)]), 0)
    part = rig.dense[:, below(rig, top)].sum(axis=1) > 0.5
    child = max(np.flatnonzero(rig.parents == bone), key=lambda index: below(rig, index).sum(),
                default=bone)
    along = parent / max(np.linalg.norm(parent), 1e-9)
    # As arms do, it bends at the joint and twists above and below it.
    poses = {"edited": turned(rig, [(child, tip, 50.0), (bone, hinge, 75.0), (above, along, 25.0)]),
             "other": turned(rig, [(child, tip, -40.0), (bone, hinge, 35.0),
                                   (above, along, -30.0)])}
    body = muscular(rig, joint - 0.06 * along + 0.03 * tip)
    near = np.flatnonzero((np.linalg.norm(rig.positions - joint, axis=1) < SCULPTED) & part)
    wanted, camera = {}, {}
    with Session(lab, body) as session:
        for name, matrices in poses.items():
            session.call("pose.set", pose=name, matrices=matrices.reshape(-1, 16))
            wanted[name] = session.evaluate(name)
            side = hinge if hinge[2] > 0 else -hinge
            camera[name] = Camera(joint, 1.0, side + [0, 0, 0.6], pixels=(250, 250)).fitted(
                wanted[name][near])
    return Limb(rig, smoothed(rig, rounds=MUCH_SMOOTHED), near,
                rig.triangles[part[rig.triangles].all(axis=1)], poses, wanted, camera)


def solve_limb(lab: Lab, limb: Limb) -> dict[str, dict[str, np.ndarray]]:
    """The surface by way and pose: as it is, and after strokes by the thesis and by this."""
    shown: dict[str, dict] = {}
    for way, (options, sculpted) in WAYS.items():
        with Session(lab, limb.soft, "cm") as session:
            for name, matrices in limb.poses.items():
                placed = rescaled(matrices, session.scale)
                session.call("pose.set", pose=name, matrices=placed.reshape(-1, 16))
            for number, name in enumerate(sculpted):
                last = {"residual": "rest"} if number == 1 else {}
                session.stroke(name, limb.vertices, limb.wanted[name][limb.vertices], **options,
                               **last)
            shown[way] = {name: session.evaluate(name) for name in limb.poses}
    return shown


def limb_pictures(lab: Lab, rigs: list[Rig]) -> dict[str, list[Picture]]:
    """A posed limb before, sculpted, solved by the thesis and by this; the same in a pose that was
    not edited; and for each the distance to what is wanted as a heat-map."""
    limb = make_limb(lab, subject(lab, rigs))
    shown = solve_limb(lab, limb)
    rows: dict[str, list[Picture]] = {}
    for name in limb.poses:
        wanted = limb.wanted[name]
        surfaces = {"Before": shown["Before"][name],
                    "Sculpted" if name == "edited" else "As it should be": wanted,
                    **{way: found[name] for way, found in shown.items() if way != "Before"}}
        plain, hot = [], []
        for title, surface in surfaces.items():
            shading = normals(limb.rig, surface)
            grey = np.tile(np.array(SKIN, float), (len(surface), 1))
            away = apart(surface, wanted)
            near = away[limb.vertices]
            picture = (limb.camera[name], surface, limb.triangles, shading)
            plain.append(Picture(title, draw(*picture, grey)))
            hot.append(Picture(title, draw(*picture, heat(away, FULL_HEAT)),
                               "what is wanted" if surface is wanted else
                               f"{1e3 * near.mean():.1f} mm, at most {1e3 * near.max():.0f}"))
        rows[name], rows[f"{name}, heat"] = plain, hot
    return rows
