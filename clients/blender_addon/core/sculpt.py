# SPDX-License-Identifier: GPL-3.0-or-later
"""One rig session as one tool sees it: strokes out, weights in, and who is ahead of whom.

Two sets of weights are kept. `truth` is the daemon's, as of the last revision heard of. `weights`
is what the tool shows. They part in two ways, and each has one way back:

    the daemon is ahead   answers and other tools' changes wait in `arrived` until the tool has
                          time to show them: show() for each, in order
    the tool is ahead     its own undo took it to another state: moved(). The daemon follows with
                          history.undo, history.redo, or where its history does not lead there,
                          with weights.set

Nothing in here blocks or knows a modelling program. Everything happens in calls of the host and in
the channel's callbacks, on one thread. How a session is opened, joined and resumed is opening.py's.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Generator

import numpy as np

from . import skin
from .channel import Channel
from .rig import Rig, Space
from .steps import Step, Steps
from .wire import Message, SkindError

Talk = Generator[tuple[str, dict], dict, None]  # yields requests, is sent their results

GONE = ("lost", "shutting_down")  # errors of a daemon that goes; what was asked is asked again
SUM_SLACK = 1e-7  # weights.set keeps rows to the bit that sum to one so nearly
NONE = np.empty(0, np.uint32)  # vertices


@dataclass(eq=False)
class Entry:
    """A step of the daemon's history; `step` is ours that shows it, once it is shown."""

    step: Step | None = None
    dropped: bool = False  # its stroke was undone before its answer came


@dataclass(eq=False)
class Stroke:
    """A stroke on its way. vertices u32 [n], targets f32 [n,3] in mesh space; pose f64 [B,4,4].

    `result` is there when it is answered, `error` when it was refused. `host` is the tool's own.
    """

    vertices: np.ndarray
    targets: np.ndarray
    pose: np.ndarray
    options: dict
    host: Any = None
    request: int | None = None  # None: not sent, or its connection was lost
    chunks: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    solved: int = 0
    in_doubt: bool = False  # the connection was lost before the answer: it was solved or not
    result: dict | None = None
    residual: np.ndarray | None = None  # f32 [n], once measured
    error: SkindError | None = None
    dropped: bool = False
    begun: float = field(default_factory=time.monotonic)
    seconds: float = 0.0

    @property
    def is_answered(self) -> bool:
        return self.result is not None or self.error is not None


@dataclass(frozen=True, eq=False)
class Arrival:
    """A change that the daemon has made and the tool has not shown: rows f32 [n,N]."""

    cause: str  # "stroke", "undo", "redo", "set", "resync"
    client: str
    vertices: np.ndarray
    rows: np.ndarray
    entry: Entry | None = None
    stroke: Stroke | None = None


class Sculpt:
    """See the file's head. `phase`: idle, creating, joining, ready, resuming, lost, ended.

    `client` is our name in hello, unique among tools: it tells our own updates from others'.
    """

    def __init__(self, channel: Channel, rig: Rig, client: str) -> None:
        self.channel = channel
        self.rig = rig
        self.client = client
        self.phase = "idle"
        self.problem = ""  # why it ended, or what went wrong last: one sentence
        self.reason = ""  # why it ended, as the name of an error; "" when it was left
        self.name = ""
        self.influences = 4
        self.length = 0.0
        self.revision = 0
        self.notes: list[dict] = []
        self.slots: dict = {}
        self.strokes = 0
        self.unreached = 0
        self.last: dict = {}  # the last answer to a stroke, with `seconds`: its whole way
        self.version = 0  # of weights and residual together
        self.pending: list[Stroke] = []
        self.arrived: deque[Arrival] = deque()
        self.joints = np.empty((0, 4), np.uint16)
        self.truth = np.empty((0, 4), np.float32)
        self.start_weights = self.truth
        self.residual = np.empty(0, np.float32)  # to the last target, mesh units; NaN: none
        self.steps = Steps(self.truth)
        self.space = Space(rig)
        self.creation: dict = {}  # how it was made, to make it again
        self.source = ""  # the file it was made from, if it was
        self.is_ours = False
        self.must_tell = False  # the session was made again, and lacks what was answered before
        self.held_joints = self.joints  # as the daemon counts bones
        self._asked: set[int] = set()  # requests that change weights and are not answered
        self._by_request: dict[int, Stroke] = {}
        self._done: list[Entry] = []  # the daemon's history as far as we saw it grow
        self._undone: list[Entry] = []
        self._hops: list[tuple[str, Step]] = []  # ours that the daemon has not followed
        self._led: list[np.ndarray] = []  # vertices on which the tool may be ahead
        self._pose_sent = b""

    @property
    def weights(self) -> np.ndarray:
        """f32 [V,N], what is shown; changed in place."""
        return self.steps.weights

    @property
    def vertices(self) -> int:
        return len(self.joints)

    @property
    def bones(self) -> list[str]:
        """The names of what joints count: the tool's deforming bones."""
        return self.rig.names

    @property
    def is_settled(self) -> bool:
        """Nothing is under way that would change weights: a good moment to show what arrived."""
        return not self._asked and all(stroke.is_answered for stroke in self.pending)

    # ---- talking ----

    def follow(self, talk: Talk) -> None:
        """Holds a conversation: each request that it yields is sent, its result sent back in."""

        def go_on(result: dict | None, error: SkindError | None) -> None:
            try:
                method, params = talk.throw(error) if error is not None else talk.send(result)
            except StopIteration:
                return
            except SkindError as refused:
                if refused.name in GONE:
                    self.lost()
                elif self.phase != "ended":
                    self.end(str(refused), refused.name)
                return
            self._request(method, params, go_on)

        go_on(None, None)

    def _request(self, method: str, params: dict, done) -> int | None:
        if self.channel.state != "ready":
            done(None, SkindError(0, "lost", "skind is not connected", retryable=True))
            return None
        return self.channel.request(method, {"session": self.name, **params}, done)

    def _change(self, method: str, params: dict, done) -> int | None:
        """A request that changes weights: `truth` is not settled before its answer."""
        sent: list[int] = []

        def answered(result: dict | None, error: SkindError | None) -> None:
            self._asked.difference_update(sent)
            done(result, error)
            self._settle()

        id = self._request(method, params, answered)
        if id is not None:
            sent.append(id)
            self._asked.add(id)
        return id

    def end(self, problem: str, reason: str = "") -> None:
        """The session is over for this tool; the weights stay as they are shown."""
        self.phase = "ended"
        self.problem, self.reason = problem, reason

    # ---- strokes ----

    def stroke(self, vertices: np.ndarray, targets: np.ndarray, pose: np.ndarray, options: dict,
               host: Any = None) -> Stroke:
        """Asks for these vertices to be at their targets in this pose. Its answer is an Arrival.

        While there is no connection the stroke waits; it is sent when the session is resumed.
        """
        stroke = Stroke(vertices, targets.astype(np.float32), pose, options, host)
        self.pending.append(stroke)
        if self.phase == "ready":
            self._send(stroke)
        return stroke

    def _send(self, stroke: Stroke) -> None:
        matrices = self.space.pose(stroke.pose)
        pose = self.client
        if matrices.tobytes() != self._pose_sent:
            self._pose_sent = matrices.tobytes()
            self._request("pose.set", {"pose": pose, "matrices": matrices}, lambda *_: None)
        stroke.chunks.clear()
        stroke.request = self._change(
            "stroke.apply",
            {"pose": pose, "vertices": stroke.vertices,
             "positions": self.space.points(stroke.targets), **stroke.options},
            lambda result, error: self._answer(stroke, result, error))
        if stroke.request is not None:
            self._by_request[stroke.request] = stroke

    def _answer(self, stroke: Stroke, result: dict | None, error: SkindError | None) -> None:
        self._by_request.pop(stroke.request, None)
        if error is not None and error.name in GONE:  # it is sent again when resumed
            stroke.in_doubt |= stroke.request is not None
            stroke.request = None
            if stroke.dropped:
                self._led.append(stroke.vertices)
            return
        stroke.request = None
        stroke.seconds = time.monotonic() - stroke.begun
        stroke.result, stroke.error = result, error
        if result is None:
            if stroke.in_doubt:  # what the daemon has for it is not what is shown
                self._led.append(stroke.vertices)
            return
        self.revision = result["revision"]
        vertices = np.concatenate([chunk[0] for chunk in stroke.chunks] or [stroke.vertices[:0]])
        rows = np.concatenate([chunk[1] for chunk in stroke.chunks] or [self.truth[:0]])
        stroke.chunks.clear()
        self.truth[vertices] = rows
        entry = self._remember(Entry(dropped=stroke.dropped))
        if stroke.dropped:
            self._led.append(vertices)
        else:
            self.arrived.append(Arrival("stroke", self.client, vertices, rows, entry, stroke))

    def drop(self, stroke: Stroke) -> None:
        """The stroke was undone before it was shown."""
        stroke.dropped = True
        self.pending.remove(stroke)
        if stroke.request is not None:  # it may be done before the daemon reads this
            self.channel.cancel(stroke.request)
            return
        if stroke.in_doubt:
            self._led.append(stroke.vertices)
        for arrival in [each for each in self.arrived if each.stroke is stroke]:
            self.arrived.remove(arrival)
            arrival.entry.dropped = True
            self._led.append(arrival.vertices)
        self._settle()

    # ---- what the daemon did ----

    def _remember(self, entry: Entry) -> Entry:
        self._done.append(entry)
        self._undone.clear()
        return entry

    def notice(self, message: Message) -> None:
        """A notification of the channel's; those of other sessions are not for us."""
        params = message.params
        if params.get("session") != self.name or self.phase != "ready":
            return  # what happens while it is being opened is in the weights that are fetched last
        if message.method == "stroke.weights":
            self._notice_chunk(params)
        elif message.method == "session.update":
            self._notice_update(params)
        elif message.method == "session.closed":
            # A daemon that is told to stop closes its sessions; the lost connection says the rest.
            if params["reason"] != "skind is stopping":
                self.end(f"the session was closed: {params['reason']}")

    def _notice_chunk(self, params: dict) -> None:
        stroke = self._by_request.get(params["request"])
        if stroke is not None:
            stroke.chunks.append((params["vertices"], params["weights"]))
            stroke.solved = params["first"] + params["count"]

    def _notice_update(self, params: dict) -> None:
        if params["revision"] <= self.revision:
            return  # what we fetched holds it already
        self.revision = params["revision"]
        if params.get("resync"):
            self._forget_history()
            self._resync()
            return
        vertices, rows = params["vertices"], params["weights"]
        self.truth[vertices] = rows
        if params["client"] == self.client:
            self._led.append(vertices)  # ours; _settle() looks whether it did what it should
            return
        cause = params["cause"]
        entry = None
        if cause in ("stroke", "set"):
            entry = self._remember(Entry())
        elif cause == "undo":  # of a step from before we listened, too
            self._undone.append(self._done.pop() if self._done else Entry())
        elif cause == "redo":
            self._done.append(self._undone.pop() if self._undone else Entry())
        self.arrived.append(Arrival(cause, params["client"], vertices, rows, entry))

    def _resync(self, scaled: np.ndarray = NONE) -> None:
        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None:
                self.catch_up(result, scaled)
        self._change("weights.get", {}, done)

    def catch_up(self, held: dict, scaled: np.ndarray = NONE) -> None:
        """All of the daemon's weights were fetched: what is new in them arrives, `scaled` anyway.

        But not where the tool is ahead, nor what may be from a stroke that is asked for again.
        """
        self.revision = held["revision"]
        new = skin.differing(held["weights"], self.truth)
        for known in self._led + [each.vertices for each in self.pending if each.in_doubt]:
            new = np.setdiff1d(new, known)
        new = np.union1d(new, scaled)
        self.truth[:] = held["weights"]
        if len(new):
            self.arrived.append(Arrival("resync", "", new, self.truth[new]))

    def _forget_history(self) -> None:
        self._done.clear()
        self._undone.clear()

    # ---- what the tool did ----

    def show(self, arrival: Arrival) -> Step:
        """The tool is about to show this change: takes it into `weights`, as a new state."""
        step = self.steps.add(arrival.vertices, arrival.rows)
        self.version += 1
        if arrival.entry is not None:
            arrival.entry.step = step
        self.residual[arrival.vertices] = np.nan
        if arrival.stroke is not None:
            self._show_answer(arrival)
        self._settle()  # what the tool did meanwhile had to wait for this
        return step

    def _show_answer(self, arrival: Arrival) -> None:
        stroke = arrival.stroke
        self.pending.remove(stroke)
        self.strokes += 1
        self.unreached = stroke.result["unreached"]
        self.last = {**stroke.result, "seconds": stroke.seconds}
        self.measure(arrival)
        self.residual[stroke.vertices] = stroke.residual

    def measure(self, arrival: Arrival) -> None:
        """How far its stroke's vertices end from their targets; may be done before show()."""
        stroke = arrival.stroke
        if stroke is not None and stroke.residual is None:
            order = np.argsort(arrival.vertices)
            rows = arrival.rows[order[np.searchsorted(arrival.vertices, stroke.vertices,
                                                      sorter=order)]]
            posed = self.posed(stroke.vertices, stroke.pose, rows)
            stroke.residual = skin.distances(posed, stroke.targets)

    def posed(self, vertices: np.ndarray | slice, pose: np.ndarray,
              rows: np.ndarray | None = None, positions: np.ndarray | None = None) -> np.ndarray:
        """f64 [n,3], mesh space: where a pose takes vertices.

        By the weights shown, or by `rows` f32 [n,N]; from rest, or from `positions` f32 [V,3].
        """
        rows = self.weights[vertices] if rows is None else rows
        still = self.rig.unweighted[vertices]
        rest = (self.rig.positions if positions is None else positions)[vertices]
        posed = skin.blend(rest, self.joints[vertices], rows,
                           skin.deformations(pose, self.rig.binds))
        posed[still] = rest[still]
        return posed

    def moved(self, state: int) -> np.ndarray | None:
        """The tool's own undo or redo went to a state. Returns the vertices whose rows changed.

        None: the state is not known (any more); then the tool reads its weights and says painted().
        """
        path = self.steps.go(state)
        if path is None:
            return None
        hops = [("undo", step) for step in path[0]] + [("redo", step) for step in path[1]]
        for hop in hops:
            opposite = ("redo" if hop[0] == "undo" else "undo", hop[1])
            if self._hops and self._hops[-1] == opposite:
                self._hops.pop()
            else:
                self._hops.append(hop)
        touched = [hop[1].vertices for hop in hops]
        self._led += touched
        self.version += 1
        vertices = np.unique(np.concatenate(touched)) if touched else np.empty(0, np.uint32)
        self.residual[vertices] = np.nan
        self._settle()
        return vertices

    def painted(self, vertices: np.ndarray, rows: np.ndarray) -> Step:
        """The tool changed weights by itself: a new state, which the daemon is told."""
        step = self.steps.add(vertices, rows)
        self._hops.clear()
        self._led.append(vertices)
        self.version += 1
        self.residual[vertices] = np.nan
        self._settle()
        return step

    def _settle(self) -> None:
        """Where the tool is ahead and nothing else is under way, makes the daemon follow."""
        if self.phase != "ready" or self.channel.state != "ready":
            return  # the loss may not have been told yet
        if not self.is_settled or self.arrived or not self._led:
            return
        if self._done and self._done[-1].dropped:
            self._go("history.undo", self._done, self._undone)
            return
        if self._hops:
            verb, step = self._hops.pop(0)
            origin, goal = (self._done, self._undone) if verb == "undo" else (self._undone,
                                                                              self._done)
            if origin and origin[-1].step is step:
                self._go(f"history.{verb}", origin, goal)
                return
            self._hops.clear()
        for entry in self._done:
            entry.dropped = False  # whatever was left of them is put right below
        led = np.unique(np.concatenate(self._led))
        self._led.clear()
        ahead = led[skin.differing(self.truth[led], self.weights[led])]
        if len(ahead):
            self._set(ahead, self.weights[ahead])

    def _go(self, method: str, origin: list[Entry], goal: list[Entry]) -> None:
        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None and origin:
                goal.append(origin.pop())
                goal[-1].dropped = False  # what redoes it is another's wish
            elif error is not None and error.name not in GONE:
                self._forget_history()  # the daemon's is shorter: set the rows instead
        self._change(method, {}, done)

    def _set(self, vertices: np.ndarray, rows: np.ndarray) -> None:
        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None:
                self.revision = max(self.revision, result["revision"])
                self.truth[vertices] = rows
                self._remember(Entry())
                sums = rows.sum(axis=1, dtype=np.float64)
                if result["vertices"] != len(vertices) or (abs(sums - 1) > SUM_SLACK).any():
                    self._resync(vertices)  # twins went with them, or rows were scaled
                else:
                    self._led.append(vertices)  # another's change may arrive on top of these
            elif error.name in GONE:
                self._led.append(vertices)
            else:
                self.problem = str(error)
                self.arrived.append(Arrival("resync", "", vertices, self.truth[vertices]))
        self._change("weights.set", {"vertices": vertices, "weights": rows}, done)

    # ---- the connection ----

    def lost(self) -> None:
        """The connection is gone; opening.resume() goes on when there is one again."""
        if self.phase in ("idle", "ended"):
            return
        if self.phase in ("creating", "joining"):
            self.end("the connection to skind was lost", "lost")
            return
        self.phase = "lost"
        self._asked.clear()
        self._by_request.clear()
        self._pose_sent = b""
        for stroke in self.pending:
            stroke.request = None

    def adopt(self, held: dict) -> None:
        """A session was opened: takes its slots and weights as the start, and is ready."""
        assert self.phase in ("creating", "joining")
        self.revision, self.influences = held["revision"], held["influences"]
        self.held_joints = held["joints"].copy()
        self.joints = self.space.joints(self.held_joints)
        self.truth = held["weights"].copy()
        self.start_weights = self.truth.copy()
        self.steps = Steps(self.truth.copy())
        self.residual = np.full(len(self.truth), np.nan, np.float32)
        self.version += 1
        self.phase = "ready"

    def resumed(self) -> None:
        """The session is there again: what waits is sent."""
        self.phase = "ready"
        self._forget_history()
        self._hops.clear()
        for stroke in self.pending:
            if not stroke.is_answered:
                self._send(stroke)
        self._settle()
