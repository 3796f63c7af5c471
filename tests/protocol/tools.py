"""A modelling program in small, for tests of core.sculpt, and what it is set against: a second
client, and a daemon that dies.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Callable

import numpy as np
from core import Channel, Launcher, Link, SkindError, opening
from core.rig import Rig
from core.sculpt import Sculpt, Stroke
from core.state import State
from scipy.spatial.transform import Rotation

sys.path.append(str(Path(__file__).resolve().parents[1] / "integration"))
import rigs  # noqa: E402

V = 100  # vertices of the sheet
SECONDS = 20.0  # patience with a daemon under a sanitizer on a busy machine


def rig_of(params: dict) -> Rig:
    """What session.create takes, as a tool's own rig."""
    bones = params["bones"]
    return Rig(params["positions"], params["triangles"], bones["names"], bones["parents"],
               np.asarray(bones["binds"]).reshape(-1, 4, 4), params["influence_offsets"],
               params["influence_joints"], params["influence_weights"],
               np.zeros(len(params["positions"]), bool))


def turned_rig(link) -> Rig:
    """The session's mesh as a program with z up has it, whose bones point along y at rest."""
    info, mesh = (link.call(method, {"session": "s"}) for method in ("session.info", "mesh.get"))
    back = np.eye(4)
    back[:3, :3] = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    along = np.eye(4)
    along[:3, :3] = Rotation.from_euler("z", 35, degrees=True).as_matrix()
    binds = back @ np.linalg.inv(mesh["inverse_binds"].reshape(-1, 4, 4)) @ along
    none = np.empty(0)
    return Rig((mesh["positions"] @ back[:3, :3].T).astype(np.float32), mesh["triangles"],
               [bone["name"] for bone in info["bones"]], none, binds, none, none, none,
               np.zeros(info["vertices"], bool))


def random_rows(joints: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Rows that weights.set keeps bit for bit: eighths, that sum to one; 0 where no bone is."""
    rows = np.zeros(joints.shape, np.float32)
    for row, held in zip(rows, joints):
        row[:] = np.bincount(random.integers((held != 65535).sum(), size=8),
                             minlength=len(row)) / 8
    return rows


class Tool:
    """A channel, its Sculpt, and the host: shows arrivals when settled, keeps a stack of states.

    `live` is where in `stack` it is; `seen` has the weights of each state when it was live.
    """

    def __init__(self, path: object, rig: Rig, name: str = "tool",
                 launcher: Launcher | None = None) -> None:
        self.channel = Channel(str(path), name=name, launcher=launcher)
        self.channel.on_ready = self._ready
        self.channel.on_lost = lambda reason: self.sculpt.lost()
        self.channel.on_notification = lambda message: self.sculpt.notice(message)
        self.sculpt = Sculpt(self.channel, rig, name)
        self.stack: list[int] = []
        self.live = 0
        self.seen: dict[int, State] = {}
        self.refused: list[Stroke] = []
        self.methods: list[str] = []  # what was asked for
        self.on_request: Callable[[str], None] | None = None  # called after each was queued
        self._request = self.channel.request
        self.channel.request = self._watch

    def _watch(self, method: str, *more: object) -> int:
        id = self._request(method, *more)
        self.methods.append(method)
        if self.on_request is not None:
            self.on_request(method)
        return id

    def _ready(self) -> None:
        if self.sculpt.phase == "lost":
            opening.resume(self.sculpt)

    # ---- time ----

    def until(self, condition: Callable[[], object], showing: bool = True,
              budget_s: float = 0.004) -> "Tool":
        deadline = time.monotonic() + SECONDS
        while not condition():
            assert time.monotonic() < deadline, (self.channel.state, self.sculpt.phase,
                                                 self.sculpt.problem, self.methods[-5:])
            if self.channel.state == "waiting":
                self.channel.open()  # as somebody who is in a hurry does
            self.channel.pump(budget_s)
            if showing:
                self.show()
            self._doze()
        return self

    def _doze(self) -> None:
        """Leaves the processor to the daemon until it says something, for a moment at most."""
        stream = self.channel._stream
        if not self.channel.unsent_bytes:
            select.select([stream.socket] if stream is not None else [], [], [], 0.001)

    def step(self) -> None:
        """As little as can be done."""
        self.channel.pump(0.0)
        self.show()

    def connect(self) -> "Tool":
        self.channel.open()
        return self.until(lambda: self.channel.state == "ready")

    def create(self, name: str = "s", influences: int = 4, durability: str = "full") -> "Tool":
        self.connect()
        opening.create(self.sculpt, name, influences, False, durability)
        return self.begin("creating")

    def join(self, name: str = "s") -> "Tool":
        self.connect()
        opening.join(self.sculpt, name)
        return self.begin("joining")

    def begin(self, phase: str) -> "Tool":
        self.until(lambda: self.sculpt.phase != phase)
        self.stack, self.live = [], -1
        if self.sculpt.phase == "ready":
            self.push()
        return self

    @property
    def is_quiet(self) -> bool:
        sculpt = self.sculpt
        return (sculpt.phase == "ready" and self.channel.state == "ready" and sculpt.is_settled
                and not (self.channel.unanswered or sculpt.pending or sculpt.arrived))

    def settle(self) -> "Tool":
        """Until what was asked is answered, what was told is heard, and all is shown."""
        self.until(lambda: self.sculpt.phase == "ready" and self.channel.state == "ready")
        echoes: list[object] = []
        self._request("ping", {}, lambda *answer: echoes.append(answer))
        return self.until(lambda: echoes and self.is_quiet)

    # ---- the host ----

    def push(self) -> None:
        del self.stack[self.live + 1:]
        self.stack.append(self.sculpt.steps.live)
        self.live += 1
        self.seen[self.sculpt.steps.live] = self.sculpt.shown.copy()

    def show(self) -> None:
        sculpt = self.sculpt
        if not sculpt.is_settled:
            return
        for stroke in [each for each in sculpt.pending if each.error is not None]:
            sculpt.pending.remove(stroke)
            self.refused.append(stroke)
        while sculpt.arrived and sculpt.is_settled:
            sculpt.show(sculpt.arrived.popleft())
            self.push()

    def pose(self, angle: float) -> np.ndarray:
        """The later a bone, the more it is turned about a slanting axis."""
        binds = self.sculpt.rig.binds
        shares = np.linspace(0, angle, len(binds))
        turns = np.tile(np.eye(4), (len(binds), 1, 1))
        turns[:, :3, :3] = Rotation.from_rotvec(np.outer(shares, [0.8, 0.0, 0.6])).as_matrix()
        return turns @ binds

    def bump(self, centre: int, height: float = 0.02, angle: float = 0.3,
             radius: float = 0.25) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A stroke's vertices, targets and pose."""
        pose = self.pose(angle)
        posed = self.sculpt.posed(slice(None), pose)
        size = np.ptp(self.sculpt.rig.positions, axis=0).max()
        return (*rigs.bump(posed, centre, radius * size, height * size), pose)

    def stroke(self, centre: int, height: float = 0.02, angle: float = 0.3,
               options: dict | None = None) -> Stroke:
        return self.sculpt.stroke(*self.bump(centre, height, angle), options or {})

    def any_stroke(self, random: np.random.Generator) -> Stroke:
        """In one of a few poses, with options that change bones, rest positions and shapes."""
        angle = float(random.choice([0.3, 0.5, -0.4]))
        options = [{}, {"slots": "evidence"}, {"pin": "move"}, {"residual": "rest"},
                   {"residual": "shape"}, {"slots": "evidence", "residual": "rest"},
                   {"smooth": 0.03, "mix": 0.5}]
        return self.stroke(int(random.integers(self.sculpt.vertices)), 0.05, angle,
                           options[random.integers(len(options))])

    def any_edit(self, random: np.random.Generator) -> None:
        pins = self.sculpt.pins
        edits: list[tuple[str, dict]] = [
            ("weights.mirror", {"axis": "x"}), ("weights.prune", {"below": 0.05}),
            ("weights.reduce", {"influences": 3, "by": "size"}), ("pins.clear", {})]
        if pins:
            pose = pins[random.integers(len(pins))]["pose"]
            edits += [("pins.weigh", {"pose": pose, "weight": 2.0}), ("pins.solve", {"pose": pose})]
        self.sculpt.edit(*edits[random.integers(len(edits))])

    def paint(self, vertices: np.ndarray, random: np.random.Generator) -> None:
        self.sculpt.painted(vertices, random_rows(self.sculpt.joints[vertices], random))
        self.push()

    def undo(self) -> None:
        """One press: takes back the last stroke that waits, else goes back a state."""
        if self.sculpt.pending:
            self.sculpt.drop(self.sculpt.pending[-1])
        elif self.live > 0:
            self.go(self.live - 1)

    def redo(self) -> None:
        if not self.sculpt.pending and self.live + 1 < len(self.stack):
            self.go(self.live + 1)

    def go(self, to: int) -> None:
        before = self.sculpt.shown.copy()
        self.live = to
        changed = self.sculpt.moved(self.stack[to])
        now = self.sculpt.shown
        assert same(now, self.seen[self.stack[to]]), "a state is not what it was"
        assert set(now.differing(before)) <= set(changed)

    # ---- trouble ----

    def cut(self) -> None:
        """The connection breaks; the daemon lives on."""
        self.channel._stream.socket.shutdown(socket.SHUT_RDWR)

    def flush(self) -> None:
        """Writes what there is to write, and reads nothing."""
        self.channel._stream.send()

    def cut_if_ready(self) -> None:
        if self.channel.state == "ready":
            self.cut()

    def cut_unread(self) -> None:
        """As cut(), and what the daemon has said since is lost."""
        self.channel._stream.socket.shutdown(socket.SHUT_RDWR)
        with suppress(BlockingIOError, ConnectionResetError):  # it stands still, or is dead
            while self.channel._stream.socket.recv(1 << 16):
                pass

    def check(self, other: Link) -> None:
        """All settled: what is shown, what is believed and what the daemon has are the same."""
        sculpt = self.sculpt
        for _ in range(20):  # what others did may be told after the answer to a later ping
            held = other.call("weights.get", {"session": sculpt.name})
            self.until(lambda: sculpt.revision >= held["revision"] and self.is_quiet)
            if sculpt.revision == held["revision"]:
                break
        assert np.array_equal(sculpt.space.session_joints(sculpt.joints), held["joints"])
        assert sculpt.weights.tobytes() == held["weights"].tobytes(), "shown is not the daemon's"
        told = [len(sculpt.held.differing(sculpt.shown)),
                *((name, len(those)) for name, those in sculpt.held.reshaped(sculpt.shown))]
        assert told == [0], "what is believed is not what is shown"
        if "residual.shape" in other.hello["capabilities"]:
            self.check_shape(other)
        assert sculpt.revision == held["revision"]
        assert not sculpt.pending and not sculpt.arrived and self.channel.unanswered == 0


    def check_shape(self, other: Link) -> None:
        """The same of rest positions and corrective shapes."""
        sculpt, about = self.sculpt, {"session": self.sculpt.name}
        every = np.arange(sculpt.vertices, dtype=np.uint32)
        rest = other.call("mesh.get", about)["rest"]
        assert np.array_equal(sculpt.space.session_rest(every, sculpt.rest), rest)
        listed = [each["pose"] for each in other.call("shapes.list", about)["shapes"]]
        assert {name for name, offsets in sculpt.shown.shapes.items() if offsets.any()} \
            == set(listed)
        for name in listed:
            told = other.call("shapes.get", {**about, "pose": name})
            offsets = np.zeros_like(sculpt.rest)
            offsets[told["vertices"]] = sculpt.space.offsets(told["offsets"])
            assert np.array_equal(sculpt.shown.shapes[name], offsets)


def same(one: State, other: State) -> bool:
    """Bit for bit but for the sign of zero."""
    return len(one.differing(other)) == 0 and not one.reshaped(other)


NOTHING = {"nothing_to_undo", "nothing_to_redo"}


class Other:
    """A second client of the session, which works without waiting."""

    def __init__(self, daemon, session: str = "s") -> None:
        self.link = daemon.link("other", checked=False)
        self.session = session
        self.asked: list[int] = []
        self.call("session.attach")
        self.call("pose.set", {"pose": "others", "bend": 15})
        self.joints = self.call("weights.get")["joints"]

    def call(self, method: str, params: dict | None = None) -> dict:
        return self.link.call(method, {"session": self.session, **(params or {})})

    def send(self, method: str, params: dict | None = None) -> None:
        self.asked.append(self.link.send(method, {"session": self.session, **(params or {})}))

    def stroke(self, centre: int) -> None:
        posed = self.call("pose.evaluate", {"pose": "others"})["positions"]
        size = np.ptp(posed, axis=0).max()
        vertices, targets = rigs.bump(posed, centre, 0.25 * size, 0.02 * size)
        self.send("stroke.apply", {"pose": "others", "vertices": vertices, "positions": targets})

    def set(self, vertices: np.ndarray, random: np.random.Generator) -> None:
        self.send("weights.set", {"vertices": vertices,
                                  "weights": random_rows(self.joints[vertices], random)})

    def wait(self) -> None:
        for id in self.asked:
            try:
                self.link.wait(id)
            except SkindError as error:
                assert error.name in NOTHING, error
        self.asked.clear()
        self.link.notifications.clear()

    def act(self, random: np.random.Generator) -> None:
        choice = random.integers(4)
        if choice == 0:
            self.stroke(int(random.integers(len(self.joints))))
        elif choice == 1:
            self.set(some(random, len(self.joints)), random)
        else:
            self.send(("history.undo", "history.redo")[choice - 2])


def some(random: np.random.Generator, vertices: int) -> np.ndarray:
    """A few of so many vertices, in no order."""
    return random.choice(vertices, random.integers(1, 30), replace=False).astype(np.uint32)


class Mortal:
    """A daemon that is killed and comes back at the same socket, with its sessions or, if it is
    to forget them, with an empty folder for them."""

    def __init__(self, start, forgets: bool = False) -> None:
        self.start = start
        self.forgets = forgets
        self.daemon = self.live()

    def live(self):
        if not self.forgets:
            return self.start()
        return self.start("--state", tempfile.mkdtemp(dir=os.environ["XDG_STATE_HOME"]))

    def pause(self) -> None:
        """From now on it takes bytes in, and answers nothing."""
        self.daemon.process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        self.daemon.process.send_signal(signal.SIGCONT)

    def die(self) -> None:
        assert self.daemon.stop(signal.SIGKILL) == -signal.SIGKILL
        self.daemon = self.live()


def agree(*tools: Tool) -> None:
    """Until no tool does anything more: what one shows it may have to tell, and others hear it."""
    quiet = 0
    while quiet < 2:
        revision = tools[0].sculpt.revision
        for tool in (*tools, *tools):
            tool.settle()
        quiet = quiet + 1 if tools[0].sculpt.revision == revision else 0


def no_session(link, name: str = "s") -> bool:
    listed = link.call("session.list")["sessions"]
    return name not in [each["session"] for each in listed]


def sent_and_solved(tool: Tool, other: Other) -> None:
    """The daemon has done what the tool asked for last, and nothing of that was read."""
    revision = other.call("session.info")["revision"]
    deadline = time.monotonic() + SECONDS
    while other.call("session.info")["revision"] == revision:
        tool.flush()
        assert time.monotonic() < deadline
