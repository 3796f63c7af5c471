"""Everything that changes a session, in random order: undo and redo give each revision back to the
bit, and who only listens ends with what is there.

Each run is seeded. The model keeps a picture of the session at each step of its history; what the
daemon shows after any request must be the picture of where the history stands.
"""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
from core import SkindError
from daemons import BIN, ROOT
from test_storms import Storm, anchors_of, check_session, take_steps

QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")
STEPS = 60 if QUICK else 75
SEEDS = range(2) if QUICK else range(3)
NONE = 65535
FOX = ROOT.parent / "shared" / "assets" / "bevy_fox" / "Fox.glb"
NAMES = ["rest", "bent", "back", "far", "moving", "equal", "mirrored", "flat"]
SHAPED = [name for name in NAMES if name != "moving"]  # its name goes to other poses meanwhile

# What a request with random members may be refused with; nothing may have changed then.
REFUSED = {"cancelled", "unsupported", "nothing_to_undo", "nothing_to_redo", "no_pose",
           "not_finite", "bad_params", "bad_index", "count_mismatch"}


def open_sheet(link, folder: Path, influences: int, fill: str) -> int:
    rig = rigs.sheet(256)
    link.call("session.create", {"name": "s", "influences": influences, "fill": fill, **rig})
    for name, angle in (("bent", 0.3), ("back", -0.25), ("far", 0.55), ("moving", 0.1)):
        link.call("pose.set", {"session": "s", "pose": name, "matrices": rigs.bent(angle)})
    return len(rig["positions"])


def open_file(link, path: Path, influences: int, fill: str) -> int:
    made = link.call("session.create", {"name": "s", "file": str(path), "influences": influences,
                                        "fill": fill, "reduce": "posed"})
    for seed, name in enumerate(("bent", "back", "far", "moving")):
        link.call("pose.set", {"session": "s", "pose": name, "bend": 30, "seed": seed})
    return made["vertices"]


def open_body(link, folder: Path, influences: int, fill: str) -> int:
    path = folder / "body.glb"
    subprocess.run([BIN / "skinctl", "generate", "--vertices", "1000", path], check=True,
                   capture_output=True)
    return open_file(link, path, influences, fill)


def open_fox(link, folder: Path, influences: int, fill: str) -> int:
    if not FOX.exists():
        pytest.skip("the shared characters are not here")
    return open_file(link, FOX, influences, fill)


class Follower:
    """Holds a session by its messages alone."""

    def __init__(self, link) -> None:
        self.link, self.revision = link, 0
        self.shapes: dict[str, np.ndarray] = {}
        link.call("session.attach", {"session": "s", "revision": 0})
        rows = link.call("weights.get", {"session": "s"})
        self.joints = np.array(rows["joints"], np.uint16)
        self.weights = np.array(rows["weights"], np.float32)
        self.rest = np.array(link.call("mesh.get", {"session": "s"})["rest"], np.float32)

    def take(self, params: dict) -> None:
        vertices = np.asarray(params["vertices"], np.int64)
        count = len(vertices)
        self.weights[vertices] = np.asarray(params["weights"], np.float32).reshape(count, self.weights.shape[1])
        if "joints" in params:
            self.joints[vertices] = np.asarray(params["joints"], np.uint16).reshape(count, self.weights.shape[1])
        if "rest" in params:
            self.rest[vertices] = np.asarray(params["rest"], np.float32).reshape(count, 3)
        if "shape" in params:
            offsets = np.zeros((len(self.rest), 3), np.float32)
            shape = self.shapes.setdefault(params["shape"], offsets)
            shape[vertices] = np.asarray(params["offsets"], np.float32).reshape(count, 3)

    def follow(self, revision: int) -> None:
        """Up to that revision."""
        deadline = time.monotonic() + 20
        while self.revision < revision:
            assert time.monotonic() < deadline, f"revision {self.revision + 1} was not told"
            self.link.pump(0 if self.link.notifications else 0.01)
            while self.link.notifications:
                note = self.link.notifications.popleft()
                if note.method == "session.presence":
                    continue
                assert note.method == "session.update"
                assert note.params["since"] == self.revision
                self.revision = note.params["revision"]
                self.take(note.params)

    def follow_own(self, answered: bool) -> None:
        """The same for who asked: what streams counts when its answer comes."""
        while self.link.notifications:
            note = self.link.notifications.popleft()
            if note.method == "session.presence":
                continue
            if note.method == "session.update" or (note.method == "stroke.weights" and answered):
                self.take(note.params)

    def fetch(self, picture: dict) -> None:
        """Who sets weights is not told which twins went along."""
        for part in ("joints", "weights", "rest"):
            held = getattr(self, part)
            held[:] = np.frombuffer(picture[part], held.dtype).reshape(held.shape)
        self.shapes = {}
        for name, (vertices, offsets) in picture["shapes"].items():
            shape = self.shapes[name] = np.zeros((len(self.rest), 3), np.float32)
            shape[np.frombuffer(vertices, np.uint32)] = np.frombuffer(
                offsets, np.float32).reshape(-1, 3)

    def compare(self, picture: dict) -> None:
        assert self.joints.tobytes() == picture["joints"]
        assert self.weights.tobytes() == picture["weights"]
        assert self.rest.tobytes() == picture["rest"]
        held = {name: (np.flatnonzero(shape.any(1)).tolist(), shape[shape.any(1)].tobytes())
                for name, shape in self.shapes.items() if shape.any()}
        assert held == {name: (np.frombuffer(vertices, np.uint32).tolist(), offsets)
                        for name, (vertices, offsets) in picture["shapes"].items()}


class Walk:
    """Random requests to one session, and the model of its history."""

    def __init__(self, daemon, folder: Path, seed: int, opened, influences: int, fill: str) -> None:
        self.random = np.random.default_rng(seed)
        self.link = daemon.link()
        self.count = opened(self.link, folder, influences, fill)
        self.influences = influences
        self.affine = False
        info = self.link.call("session.info", {"session": "s"})
        self.bones = [bone["name"] for bone in info["bones"]]
        self.length = info["length"]
        self.odd_poses()
        self.own = Follower(self.link)
        self.others = [Follower(daemon.link("frames")), Follower(daemon.link("lines", lines=True))]
        self.revision, self.table = 0, 0
        self.picture = self.look()
        self.history, self.position = [self.picture], 0

    def call(self, method: str, **params) -> dict:
        return self.link.call(method, {"session": "s", **params})

    def odd_poses(self) -> None:
        one = np.eye(4)
        one[:3, 3] = 0.1 * self.length
        mirrored, flat = np.diag([-1.0, 1, 1, 1]), np.diag([0.0, 0, 0, 1])
        binds = np.asarray(self.call("mesh.get")["inverse_binds"]).reshape(-1, 4, 4)
        for name, matrix in (("equal", one), ("mirrored", mirrored), ("flat", flat)):
            # Bone matrices such that every skin matrix is this one.
            matrices = matrix @ np.linalg.inv(binds)
            self.call("pose.set", pose=name, matrices=matrices.reshape(-1, 16))

    def look(self) -> dict:
        """All that a step may change, as bytes."""
        rows, pins, shapes = self.call("weights.get"), {}, {}
        weights = np.asarray(rows["weights"])
        assert np.isfinite(weights).all() and self.revision == rows["revision"]
        np.testing.assert_allclose(weights.astype(float).sum(1), 1, atol=1e-5)
        assert self.affine or weights.min() >= 0
        assert not weights[rows["joints"] == NONE].any()
        listed = self.call("pins.list")["pins"]
        for name in {item["pose"] for item in listed}:
            got = self.call("pins.get", pose=name)
            assert np.isfinite(got["positions"]).all()
            pins[name] = tuple(got[part].tobytes() for part in ("vertices", "positions", "weights"))
        listed_shapes = self.call("shapes.list")
        for item in listed_shapes["shapes"]:
            got = self.call("shapes.get", pose=item["pose"])
            assert np.isfinite(got["offsets"]).all() and item["current"]
            shapes[item["pose"]] = (got["vertices"].tobytes(), got["offsets"].tobytes())
        rest = self.call("mesh.get")["rest"]
        assert np.isfinite(rest).all()
        return {"joints": rows["joints"].tobytes(), "weights": weights.tobytes(),
                "rest": rest.tobytes(), "shapes": shapes, "pins": pins, "table": self.table,
                "listed": [(item["pose"], item["vertices"], item["weight"]) for item in listed]}

    def pick(self, *words):
        return words[self.random.integers(len(words))]

    def some(self, most: int = 60) -> np.ndarray:
        count = self.count if self.random.random() < 0.05 else self.random.integers(0, most)
        return self.random.permutation(self.count)[:count].astype(np.uint32)

    def targets(self, pose: str, vertices=None) -> np.ndarray:
        named = {} if vertices is None else {"vertices": vertices}
        shown = np.asarray(self.call("pose.evaluate", pose=pose, **named)["positions"])
        size = self.pick(0, 1e-3, 0.02, 0.02, 0.3, 1e3) * self.length
        if self.random.random() < 0.04:
            size = self.pick(1e30, np.nan, 1e38)
        return (shown + size * self.random.normal(size=shown.shape)).astype(np.float32)

    def options(self) -> dict:
        """Of a stroke's options some, those that cannot be together now and then."""
        pick, chance = self.pick, self.random.random
        chosen: dict = {"stream": bool(chance() < 0.5)}
        for name, share, values in (
                ("stiffness", 0.5, (0, 1e-4, 0.008, 10)), ("slots", 0.4, ("evidence",)),
                ("guard", 0.3, (0, 1, 1000)), ("smooth", 0.25, (0, 0.01, 10)),
                ("residual", 0.5, ("rest", "shape", "shape")), ("constraint", 0.08, ("affine",))):
            if chance() < share:
                chosen[name] = pick(*values)
        if chance() < 0.2:
            chosen["locked_bones"] = [pick(*self.bones), pick(*self.bones)]
        if chance() < 0.2:
            chosen["locked_vertices"] = self.some()
        return chosen

    def stroke(self) -> tuple[str, dict]:
        vertices, chance = self.some(), self.random.random
        asked = {"vertices": vertices, "pin": self.pick("set", "set", "move", "none"),
                 **self.options()}
        asked["pose"] = pose = self.pick(*(SHAPED if "residual" in asked else NAMES))
        asked["positions"] = self.targets(pose, vertices)
        if chance() < 0.2:
            asked["mix"] = self.pick(0, 0.5, 1)
        if chance() < 0.2:
            asked["mask"] = self.pick(0, 1) * self.random.random(len(vertices)).astype(np.float32)
        if chance() < 0.1:
            asked = {name: asked[name] for name in ("vertices", "pose", "positions", "stream")}
            asked["method"] = "thesis"
        return "stroke.apply", asked

    def set_weights(self) -> tuple[str, dict]:
        vertices, chance = self.some(), self.random.random
        joints = self.call("weights.get", vertices=vertices)["joints"]
        rows = self.random.random((len(vertices), self.influences)).astype(np.float32)
        rows = np.where(joints == NONE, 0, rows + 0.01)
        asked = {"vertices": vertices,
                 "weights": (rows / rows.sum(1, keepdims=True)).astype(np.float32)}
        if chance() < 0.4:
            order = self.random.permuted(np.tile(np.arange(self.influences), (len(vertices), 1)),
                                         axis=1)
            asked["joints"] = np.take_along_axis(joints, order, 1)
            asked["weights"] = np.take_along_axis(asked["weights"], order, 1)
        if chance() < 0.3:
            rest = self.call("mesh.get")["rest"][vertices]
            asked["rest"] = (rest + self.pick(0, 0.01)).astype(np.float32)
        if chance() < 0.3:
            asked["shape"] = self.pick(*SHAPED)
            asked["offsets"] = self.random.normal(size=(len(vertices), 3)).astype(np.float32)
        return "weights.set", asked

    def edit(self) -> tuple[str, dict]:
        scope = {"vertices": self.some()} if self.random.random() < 0.5 else {}
        kind = self.pick("mirror", "prune", "reduce", "weigh", "weigh", "clear")
        if kind == "mirror":
            return "weights.mirror", {"axis": self.pick("x", "y", "z"), "from": self.pick("+", "-"),
                                      "tolerance": self.pick(1e-3, 0.1),
                                      "origin": self.pick(0, 0.5 * self.length), **scope}
        if kind == "prune":
            return "weights.prune", {"below": self.pick(0, 0.01, 0.4, 1), **scope}
        if kind == "reduce":
            how = self.pick({}, {"by": "size"}, {"poses": ["bent", "far", "equal"]})
            return "weights.reduce", {"influences": int(self.random.integers(1, 9)), **how, **scope}
        if kind == "weigh":
            return "pins.weigh", {"pose": self.pick(*NAMES), "weight": self.pick(0, 0.5, 1, 1000),
                                  **scope}
        return "pins.clear", {**({"pose": self.pick(*NAMES)} if self.random.random() < .7 else {}),
                              **scope}

    def refit(self) -> tuple[str, dict]:
        poses = [self.pick(*NAMES) for _ in range(self.random.integers(1, 5))]
        asked = {"poses": poses, "positions": np.concatenate([self.targets(p) for p in poses]),
                 "rounds": self.pick(1, 2, 5), "slots": self.pick("keep", "evidence")}
        if self.random.random() < 0.3:
            asked["stiffness"] = self.pick(0, 0.01)
        return "session.refit", asked

    def guard(self) -> tuple[str, dict]:
        kind = self.pick("poses", "matrices", "none")
        if kind == "poses":
            return "guard.set", {"poses": [self.pick(*NAMES) for _ in range(4)],
                                 "count": self.pick(1, 3, 64)}
        if kind == "matrices":
            rest = np.linalg.inv(np.asarray(self.call("mesh.get")["inverse_binds"])
                                 .reshape(-1, 4, 4))
            rest = np.tile(rest, (3, 1, 1))
            rest[:, :3, 3] += self.length * self.random.normal(size=(len(rest), 3))
            return "guard.set", {"matrices": rest.reshape(-1, 16)}
        return "guard.set", {}

    def pose(self) -> tuple[str, dict]:
        self.table += 1
        return "pose.set", {"pose": "moving", "bend": float(self.random.uniform(-50, 50))}

    def solve(self) -> tuple[str, dict]:
        asked = self.options()
        asked["pose"] = self.pick(*(SHAPED if "residual" in asked else NAMES))
        return "pins.solve", {**asked, **({"vertices": self.some()} if self.random.random() < .3
                                          else {})}

    def turn(self) -> tuple[str, dict]:
        return self.pick("history.undo", "history.undo", "history.redo"), {}

    def step(self) -> None:
        shares = [(self.stroke, 10), (self.turn, 8), (self.edit, 4), (self.set_weights, 2),
                  (self.solve, 2), (self.refit, 1), (self.guard, 1), (self.pose, 1)]
        kinds, weights = zip(*shares)
        chosen = self.random.choice(len(kinds), p=np.array(weights) / sum(weights))
        method, params = kinds[chosen]()
        self.affine |= params.get("constraint") == "affine"
        asked = self.link.send(method, {"session": "s", **params})
        if self.random.random() < 0.08:
            self.link.cancel(asked)
        told = f"{method} {({k: v for k, v in params.items() if np.ndim(v) < 1})}"
        try:
            answer = self.link.wait(asked)
        except SkindError as error:
            assert error.name in REFUSED, f"{told}: {error}"
            answer = {}
        self.own.follow_own(answered=bool(answer))
        self.learn(method, answer, told)
        self.own.follow_own(answered=False)  # an update that came after the answer
        if method == "weights.set":
            self.own.fetch(self.picture)
        self.own.compare(self.picture)

    def learn(self, method: str, answer: dict, told: str) -> None:
        changed = answer.get("revision", self.revision) != self.revision
        self.revision += changed
        seen = self.picture = self.look()
        if method.startswith("history.") and answer:
            self.position += 1 if method == "history.redo" else -1
        elif changed:
            self.history = [*self.history[:self.position + 1], seen]
            self.position += 1
        self.compare(seen, told)
        for other in self.others:
            other.follow(self.revision)
            other.compare(seen)
        if "undo_steps" in answer:
            assert (answer["undo_steps"], answer["redo_steps"]) == (
                self.position, len(self.history) - 1 - self.position), told

    def compare(self, seen: dict, told: str) -> None:
        kept = self.history[self.position]
        for part in ("joints", "weights", "rest", "shapes", "listed"):
            assert seen[part] == kept[part], f"{part} after {told}"
        for name in set(kept["pins"]) | set(seen["pins"]):
            # A name whose pose was set again may stand for other pins.
            if name != "moving" or seen["table"] == kept["table"]:
                assert seen["pins"].get(name) == kept["pins"].get(name), f"{name} after {told}"

    def unwind(self) -> None:
        while self.position > 0:
            self.learn("history.undo", self.call("history.undo"), "the last undo")
        while self.position < len(self.history) - 1:
            self.learn("history.redo", self.call("history.redo"), "the last redo")


@pytest.mark.parametrize("opened, influences, fill", [
    (open_sheet, 4, "neighbours"), (open_sheet, 8, "none"), (open_body, 4, "hop"),
    (open_fox, 4, "neighbours")], ids=["sheet", "sheet of 8", "body", "seams"])
@pytest.mark.parametrize("seed", SEEDS)
def test_undo_gives_every_revision_back(daemon, folder, seed, opened, influences, fill) -> None:
    walk = Walk(daemon, folder, seed, opened, influences, fill)
    for _ in range(STEPS):
        walk.step()
    walk.unwind()


class SculptingStorm(Storm):
    """What strokes that remember bring, on many connections, without waiting."""

    def request(self, lines: bool) -> tuple[str, dict]:
        pick = self.random
        if pick.random() < 0.4:
            return super().request(lines)
        name = pick.choice(["small", "small" if lines else "large", "body"])
        count = {"small": 400, "large": 20_000, "body": 900}[name]
        most = pick.choice([10, 40, count if not lines else 40])
        some = np.array(sorted(pick.sample(range(count), most)), np.uint32)
        numbers = np.random.default_rng(pick.randrange(1 << 30))
        who = {"session": name}
        kind = pick.choices(["stroke", "solve", "pins", "guard", "refit", "set", "edit", "shapes"],
                            [8, 3, 4, 3, 1, 3, 3, 2])[0]
        in_pose = {**who, "pose": pick.choice(["rest", "bent"])}
        options = {"stream": pick.random() < 0.5, "slots": pick.choice(["keep", "evidence"]),
                   "residual": pick.choice(["report", "rest", "shape"]),
                   "smooth": pick.choice([0, 0.01]), "guard": pick.choice([0, 1])}
        if kind == "stroke":
            return "stroke.apply", {**in_pose, **options, "vertices": some,
                                    "pin": pick.choice(["set", "move", "none"]),
                                    "positions": numbers.random((most, 3), np.float32)}
        if kind == "solve":
            return "pins.solve", {**in_pose, **options}
        if kind == "pins":
            return pick.choice([("pins.list", who), ("pins.get", in_pose), ("pins.clear", who),
                                ("pins.weigh", {**in_pose, "weight": 0.5})])
        if kind == "guard":
            return pick.choice([("guard.set", {**who, "poses": ["bent"]}), ("guard.get", who),
                                ("guard.set", who)])
        if kind == "refit" and name == "small":
            return "session.refit", {**who, "poses": ["rest", "bent"],
                                     "positions": numbers.random((2 * count, 3), np.float32)}
        if kind == "set":  # the first slot of each vertex has a bone
            return "weights.set", {**who, "vertices": some, "shape": "bent",
                                   "weights": np.tile(np.eye(1, 4, dtype=np.float32), (most, 1)),
                                   "rest": numbers.random((most, 3), np.float32),
                                   "offsets": numbers.random((most, 3), np.float32)}
        if kind == "edit":
            return pick.choice([("weights.mirror", {**who, "tolerance": 0.1}),
                                ("weights.prune", {**who, "below": 0.2}),
                                ("weights.reduce", {**who, "influences": 2, "by": "size"})])
        return pick.choice([("shapes.list", who), ("shapes.get", in_pose)])


@pytest.mark.parametrize("seed", [1, 2])
def test_everything_at_once(start, folder, seed) -> None:
    daemon = start("--workers", str(1 + 2 * seed))
    storm = SculptingStorm(daemon, folder, seed)
    with daemon.link() as link:
        anchors = anchors_of(storm, link)
    take_steps(storm, 2 * STEPS, 20)
    assert storm.outcomes["ok"] > STEPS / 20
    with daemon.link() as link:
        for row in link.call("session.list")["sessions"]:
            check_session(link, row["session"], anchors)


def test_an_end_in_the_middle_of_it(start, folder) -> None:
    daemon = start()
    storm = SculptingStorm(daemon, folder, 7)
    for _ in range(STEPS):
        storm.step()
    with daemon.link() as link:
        link.call("shutdown")
    for link in storm.links:
        with pytest.raises(ConnectionError):
            while True:
                storm.take_in(link, 0.1)
        link.close()
    assert daemon.process.wait(30) == 0


# ---- one bug each ----


def test_pins_that_were_cleared_make_room_for_others(daemon) -> None:
    """Poses once counted against the limit for good, whether or not anything was left in them."""
    vertices = np.arange(5, dtype=np.uint32)
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "s", **rigs.sheet(64)})
        limit = link.hello["limits"]["target_poses"]

        def stroke(turn: int) -> None:
            link.call("pose.set", {"session": "s", "pose": "p",
                                   "matrices": rigs.bent(1e-3 * (1 + turn))})
            link.call("stroke.apply", {"session": "s", "pose": "p", "vertices": vertices,
                                       "positions": np.full((5, 3), 1e-3 * turn, np.float32)})

        for turn in range(limit):
            stroke(turn)
        with pytest.raises(SkindError, match="clear the pins") as caught:
            stroke(limit)
        assert caught.value.name == "too_large"
        listed = link.call("pins.list", {"session": "s"})["pins"]
        assert len(listed) == limit
        assert link.call("pins.clear", {"session": "s"})["vertices"] == len(vertices)
        for turn in range(limit, limit + 20):
            stroke(turn)
        for _ in range(21):
            link.call("history.undo", {"session": "s"})
        back = link.call("pins.list", {"session": "s"})["pins"]
        assert [{**item, "current": 0} for item in back] == [{**item, "current": 0}
                                                             for item in listed]


def test_the_last_bit_of_zero_is_told_in_lines(daemon) -> None:
    """Minus zero was written as "-0", which many readers take for the whole number 0."""
    minus = np.array([[-0.0, 0.0, 1.0]], np.float32)
    with daemon.link() as link, daemon.link(lines=True) as other:
        link.call("session.create", {"name": "s", **rigs.sheet(64)})
        row = link.call("weights.get", {"session": "s", "vertices": [5]})["weights"]
        link.call("weights.set", {"session": "s", "vertices": np.array([5], np.uint32),
                                  "weights": row, "shape": "rest", "offsets": minus})
        got = other.call("shapes.get", {"session": "s", "pose": "rest"})
        assert np.asarray(got["offsets"], np.float32).tobytes() == minus.tobytes()


def test_an_offset_beyond_float32_is_none(daemon) -> None:
    """The sum of a target near the end of the range and what lies opposite became infinite."""
    with daemon.link() as link:
        link.call("session.create", {"name": "s", **rigs.sheet(64)})
        turned = rigs.bent(0.4)
        link.call("pose.set", {"session": "s", "pose": "p", "matrices": turned})
        answer = link.call("stroke.apply", {"session": "s", "pose": "p", "residual": "shape",
                                            "vertices": np.arange(64, dtype=np.uint32),
                                            "positions": np.full((64, 3), 3.4e38, np.float32)})
        assert answer["vertices"] == 64
        offsets = link.call("shapes.get", {"session": "s", "pose": "p"})["offsets"]
        assert np.isfinite(np.asarray(offsets)).all()


@pytest.mark.parametrize("options", [{"mix": 0.5}, {"pin": "move"}], ids=["mix", "move"])
def test_a_surface_that_overflows_leaves_no_pin_without_a_place(daemon, options) -> None:
    """The target was drawn to what is shown, and that was infinite: a pin for good."""
    huge = rigs.bent(0.3).reshape(-1, 4, 4)
    huge[:, :3] *= 1e100
    everyone = np.arange(64, dtype=np.uint32)
    with daemon.link() as link:
        link.call("session.create", {"name": "s", **rigs.sheet(64)})
        link.call("pose.set", {"session": "s", "pose": "p", "matrices": huge.reshape(-1, 16)})
        for _ in range(2):
            link.call("stroke.apply", {"session": "s", "pose": "p", "vertices": everyone,
                                       "positions": np.ones((64, 3), np.float32), **options})
        pins = link.call("pins.get", {"session": "s", "pose": "p"})
        assert len(pins["vertices"]) == 64 and np.isfinite(pins["positions"]).all()


def test_only_strokes_that_ask_for_it_make_a_shape(daemon) -> None:
    """One that was undone, or was another vertex's, or would not have been, once made the next
    stroke of its pose correct all its vertices; and locked ones were corrected too."""
    everyone = np.arange(64, dtype=np.uint32)
    half, rest = everyone[::2], everyone[1::2]
    with daemon.link() as link:
        link.call("session.create", {"name": "s", **rigs.sheet(64)})
        link.call("pose.set", {"session": "s", "pose": "p", "matrices": rigs.bent(0.3)})
        shown = link.call("pose.evaluate", {"session": "s", "pose": "p"})["positions"]

        def stroke(vertices, **options) -> dict:
            return link.call("stroke.apply", {
                "session": "s", "pose": "p", "vertices": vertices,
                "positions": (shown[vertices] + np.float32([0, 0, 0.3])), **options})

        plain = stroke(everyone)["residual"]
        link.call("history.undo", {"session": "s"})
        stroke(everyone, residual="shape")
        link.call("history.undo", {"session": "s"})
        with pytest.raises(SkindError):
            stroke(everyone, residual="shape", locked_bones=["none"])
        again = stroke(everyone)
        assert again["residual"] == plain and again["shaped"] == 0
        assert stroke(half, residual="shape")["shaped"] == len(half)
        assert stroke(everyone)["shaped"] == len(half)
        kept = stroke(everyone, residual="shape", locked_vertices=rest)
        assert kept["shaped"] == len(half)
        shaped = link.call("shapes.get", {"session": "s", "pose": "p"})["vertices"]
        np.testing.assert_array_equal(shaped, half)
