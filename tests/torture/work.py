"""Rigs to torture, requests that change them, and all that a session holds, as bytes."""

from __future__ import annotations

import hashlib
import random

import numpy as np
import rigs
from core import Link, SkindError

from .yard import expect

POSES = ("a", "b", "c")
# What a recipe's requests may be refused with: there was nothing to do.
NOTHING_TO_DO = {"nothing_to_undo", "nothing_to_redo", "conflict", "unsupported", "no_pose"}


def create(link: Link, name: str, vertices: int = 400, **options: object) -> dict:
    """A new session of a rippled sheet, with three poses."""
    made = link.call("session.create", {"name": name, **rigs.sheet(vertices), **options})
    for number, pose in enumerate(POSES):
        link.call("pose.set", {"session": name, "pose": pose, "bend": 12.0 + 9 * number,
                               "seed": number})
    return made


class Recipe:
    """Random requests on one session, the same for the same seed, whatever the daemon answers.

    `positions` is its rest surface, near which targets are put; a stroke has at most `brush`
    vertices.
    """

    def __init__(self, session: str, vertices: int, seed: int, brush: int = 60) -> None:
        self.session = session
        self.most = min(brush, vertices)
        self.positions = rigs.sheet(vertices)["positions"]
        self.random = random.Random(seed)
        self.numpy = np.random.default_rng(seed)

    def brush(self) -> dict:
        """Some vertices around one, and where they should go."""
        count = len(self.positions)
        centre = self.random.randrange(count)
        near = np.argsort(np.square(self.positions - self.positions[centre]).sum(1))
        some = np.sort(near[:self.random.randrange(1, self.most)]).astype(np.uint32)
        move = self.numpy.normal(0, 0.02, (len(some), 3))
        return {"vertices": some, "positions": (self.positions[some] + move).astype(np.float32)}

    def stroke(self, **options: object) -> tuple[str, dict]:
        return "stroke.apply", {"session": self.session, "pose": self.random.choice(POSES),
                                "stream": False, **self.brush(), **options}

    def next(self) -> tuple[str, dict]:
        """Anything that is a step of the history, moves in it, or sets a pose."""
        pick, who = self.random, {"session": self.session}
        kind = pick.choices(["stroke", "move", "evidence", "rest", "shape", "set", "weigh", "solve",
                             "prune", "mirror", "undo", "redo", "pose"],
                            [10, 4, 4, 3, 3, 3, 1, 2, 1, 1, 6, 5, 2])[0]
        if kind == "stroke":
            return self.stroke(stiffness=pick.choice([0.0, 0.008]))
        if kind == "move":
            return self.stroke(pin=pick.choice(["move", "none"]), smooth=pick.choice([0, 0.1]))
        if kind == "evidence":
            return self.stroke(slots="evidence")
        if kind in ("rest", "shape"):
            return self.stroke(residual=kind)
        if kind == "set":
            some = self.brush()["vertices"]
            row = np.array([pick.uniform(0.9995, 1.0005), 0, 0, 0], np.float32)
            return "weights.set", {**who, "vertices": some, "weights": np.tile(row, (len(some), 1))}
        if kind == "weigh":
            return "pins.weigh", {**who, "pose": pick.choice(POSES), "weight": pick.choice([1, 2])}
        if kind == "solve":
            return "pins.solve", {**who, "pose": pick.choice(POSES), "stream": False}
        if kind == "prune":
            return "weights.prune", {**who, "below": 0.02}
        if kind == "mirror":
            return "weights.mirror", {**who, "origin": 0.5, "tolerance": 0.01,
                                      "vertices": self.brush()["vertices"]}
        if kind == "pose":
            return "pose.set", {**who, "pose": pick.choice(POSES), "bend": pick.uniform(5, 40),
                                "seed": pick.randrange(3)}
        return f"history.{kind}", who


def digest(link: Link, session: str) -> str:
    """All that strokes change, to the bit: weights, slots, rest, pins, shapes, posed surfaces."""
    who, hash = {"session": session}, hashlib.sha256()

    def take(method: str, *names: str, **params: object) -> dict:
        answer = link.call(method, {**who, **params})
        for name in names:
            hash.update(np.ascontiguousarray(answer[name]).tobytes())
        return answer

    take("weights.get", "joints", "weights")
    take("mesh.get", "rest")
    for kind, values in (("pins", ("vertices", "positions", "weights")),
                         ("shapes", ("vertices", "offsets"))):
        for row in sorted(take(f"{kind}.list")[kind], key=lambda row: row["pose"]):
            hash.update(repr((kind, row["pose"], row["vertices"], row["current"])).encode())
            if row["current"]:
                take(f"{kind}.get", *values, pose=row["pose"])
    for pose in sorted(set(POSES) & set(link.call("session.info", who)["poses"])):
        take("pose.evaluate", "positions", pose=pose)
    return hash.hexdigest()


def check_simplex(link: Link, session: str) -> None:
    """What holds for weights at any time."""
    weights = link.call("weights.get", {"session": session})["weights"].astype(np.float64)
    expect(np.isfinite(weights).all(), "weights that are not finite")
    expect((weights >= 0).all(), "negative weights")
    expect(np.abs(weights.sum(1) - 1).max() <= 1e-6, "weights that do not sum to one")


def answer_of(link: Link, id: int) -> tuple[dict | None, str]:
    """(result, "") of a request that was sent, or (None, the error's name)."""
    try:
        return link.wait(id), ""
    except SkindError as error:
        return None, error.name
