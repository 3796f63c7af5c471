# SPDX-License-Identifier: GPL-3.0-or-later
"""One rig session as one tool sees it: strokes out, weights in, and who is ahead of whom.

Two states are kept (see state.py). `held` is the daemon's, as of the last revision heard of.
`shown` is what the tool shows. They part in two ways, and each has one way back:

    the daemon is ahead   answers and other tools' changes wait in `arrived` until the tool has
                          time to show them: show() for each, in order
    the tool is ahead     its own undo took it to another state: moved(). The daemon follows with
                          history.undo, history.redo, or where its history does not lead there,
                          with weights.set

The daemon's side is replica.py's, and what follows from the tool being ahead writeback.py's; what
was asked for and has no answer is in asks.py. How a session is opened, joined and resumed is
opening.py's. Here is what a tool calls and the channel tells, and when it is time for which.

Nothing in here blocks or knows a modelling program. Everything happens in calls of the host and in
the channel's callbacks, on one thread.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Any, Callable

import numpy as np

from . import skin
from .ahead import Ahead
from .asks import Ask, Asks, Stroke
from .channel import Channel, Done
from .fetching import Fetching, fetch
from .guard import Guard
from .pins import Pins
from .poses import Poses
from .presence import Presence
from .replica import Arrival, Replica
from .rig import Rig, Space
from .state import NONE, Change, Held, State
from .steps import Step, Steps
from .talk import Talk, hold
from .wire import GONE, Message, SkindError
from .writeback import WriteBack


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
        self.length = 0.0
        self.instance = ""  # what `revision` is a revision of
        self.unkept = ""  # why what is done is not kept on the disk for now; "" as it should be
        self.damage = ""  # what the session's file had lost
        self.notes: list[dict] = []
        self.slots: dict = {}
        self.strokes = 0
        self.last: dict = {}  # the last answer to a stroke, with `seconds`: its whole way
        self.version = 0  # of what is shown and residual together
        self.pending: list[Stroke] = []
        self.asks = Asks(self, self._over)
        self._ahead = Ahead()
        self.replica = Replica(client, self.asks, self._ahead)
        self.start = self.held  # as it was opened
        self.steps = Steps(self.held)
        self.residual = np.empty(0, np.float32)  # to the last target, mesh units; NaN: none
        self.poses = Poses()  # that strokes were made in
        self.space = Space(rig)
        self.presence = Presence(self.request, self._say)
        self.pins = Pins(self.request)
        self.guard = Guard(self.request, self._say)
        self.creation: dict = {}  # how it was made, to make it again
        self.source = ""  # the file it was made from, if it was
        self.is_ours = False
        self.must_tell = False  # the session was made again, and lacks what was answered before
        self.first_joints: np.ndarray | None = None  # of revision 0, as the daemon counts bones
        self._write_back = WriteBack(self.asks, self.replica, self._ahead, self._resync, self._say)
        self._fetches: set[object] = set()  # that are under way
        self._early: list[Message] = []  # told while the session is being opened
        self._poses_sent: set[str] = set()

    @property
    def held(self) -> State:
        """What the daemon holds."""
        return self.replica.held

    @property
    def revision(self) -> int:
        """Of the daemon's, the last that was heard of."""
        return self.replica.revision

    @property
    def arrived(self) -> deque[Arrival]:
        """What waits to be shown, in order; the tool takes it out, and then says show()."""
        return self.replica.arrived

    @property
    def influences(self) -> int:
        return self.replica.influences

    @property
    def shown(self) -> State:
        """What the tool shows; changed in place."""
        return self.steps.state

    @property
    def joints(self) -> np.ndarray:
        """u16 [V,N], shown: indexes of `bones`."""
        return self.shown.joints

    @property
    def weights(self) -> np.ndarray:
        """f32 [V,N], shown."""
        return self.shown.weights

    @property
    def rest(self) -> np.ndarray:
        """f32 [V,3], shown: where vertices are when nothing is sculpted."""
        return self.shown.rest

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
        return (not self.asks and not self._fetches and self.replica.is_current
                and all(stroke.is_answered for stroke in self.pending))

    # ---- talking ----

    def follow(self, talk: Talk) -> None:
        """Holds a conversation with the daemon. One that fails is the end of the session."""
        hold(talk, self.request, self._refused)

    def _refused(self, error: SkindError) -> None:
        if error.name in GONE:
            self.lost()
        elif self.phase != "ended":
            self.end(str(error), error.name)

    def request(self, method: str, params: dict, done: Done) -> int | None:
        """Sends a request about the session."""
        if self.channel.state != "ready":
            done(None, SkindError(0, "lost", "skind is not connected", retryable=True))
            return None
        return self.channel.request(method, {"session": self.name, **params}, done)

    def need_pose(self, name: str) -> None:
        """The daemon must know this pose; one of another tool's it does know."""
        pose = self.poses.get(name)
        if pose is not None and name not in self._poses_sent:
            self._poses_sent.add(name)
            self.request("pose.set", self.pose_params(name), lambda *_: None)

    def pose_params(self, name: str) -> dict:
        """As pose.set takes a pose that a stroke was made in."""
        return {"pose": name, "matrices": self.space.pose(self.poses.get(name).matrices)}

    def _over(self, ask: Ask, result: dict | None, error: SkindError | None) -> None:
        """It was answered, or given up."""
        if result is not None:
            self.replica.expect(result["revision"])
        if ask.is_given_up and ask.in_doubt:
            self._ahead.mark(ask.vertices)  # it was done or not: what is shown counts
        ask.done(result, error)
        self.replica.reveal(ask)
        if not ask.is_given_up:
            self._settle()

    def _say(self, problem: str) -> None:
        self.problem = problem

    def end(self, problem: str, reason: str = "") -> None:
        """The session is over for this tool; the weights stay as they are shown."""
        self.phase = "ended"
        self.problem, self.reason = problem, reason
        self.presence.end()
        self.asks.end()

    # ---- strokes ----

    def stroke(self, vertices: np.ndarray, targets: np.ndarray, pose: np.ndarray, options: dict,
               host: Any = None, label: str = "pose") -> Stroke:
        """Asks for these vertices to be at their targets in this pose. Its answer is an Arrival.

        `label` begins the pose's name when it is new. While there is no connection the stroke
        waits; it is sent when the session is resumed.
        """
        named = self.poses.need(pose, self.length, label)
        stroke = Stroke(vertices, targets.astype(np.float32), named.matrices, named.name, options,
                        host)
        self.pending.append(stroke)
        self._ask_stroke(stroke)
        return stroke

    def _ask_stroke(self, stroke: Stroke) -> None:
        stroke.ask = Ask(
            "stroke.apply",
            {"pose": stroke.pose_name, "vertices": stroke.vertices,
             "positions": self.space.points(stroke.targets), **stroke.options},
            lambda result, error: self._answer(stroke, result, error), stroke.vertices, stroke)
        self.asks.add(stroke.ask)

    def _answer(self, stroke: Stroke, result: dict | None, error: SkindError | None) -> None:
        if (error is not None and error.name == "unsupported" and not stroke.dropped
                and stroke.options.get("residual") == "rest"):
            # It takes a second pose to tell rest and pose apart. The stroke is not lost for that.
            stroke.options = {name: value for name, value in stroke.options.items()
                              if name != "residual"}
            self.problem = str(error)
            self._ask_stroke(stroke)
            return
        stroke.seconds = time.monotonic() - stroke.begun
        stroke.result, stroke.error = result, error
        if result is not None:
            self.replica.stroke_answered(stroke)

    def drop(self, stroke: Stroke) -> None:
        """The stroke was undone before it was shown."""
        stroke.dropped = True
        self.pending.remove(stroke)
        self.asks.cancel(stroke.ask)
        self.replica.drop(stroke)
        self._settle()

    # ---- edits, pins and the guard ----

    def edit(self, method: str, params: dict,
             on_done: Callable[[dict], None] = lambda result: None) -> None:
        """Asks for a step that is no stroke: weights.mirror, weights.prune, weights.reduce,
        pins.weigh, pins.clear, pins.solve. It arrives; on_done hears of the answer."""
        if method == "pins.solve":
            params = {**params, "stream": False}  # then it is told as edits are

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is None:
                self.problem = str(error)
                return
            if method in ("pins.weigh", "pins.clear"):
                self.replica.pins_answered(result)
            on_done(result)

        self.asks.add(Ask(method, params, done))

    def ask_pins(self) -> None:
        """Has `pins` told anew if something was done since."""
        if self.phase == "ready" and self.is_settled and "pins" in self.channel.capabilities:
            self.pins.ask(self.revision)

    def keep(self, poses: np.ndarray | None, count: int,
             on_done: Callable[[], None] = lambda: None) -> None:
        """Poses f64 [Q,B,4,4] that should stay as they are; the daemon picks `count` of them that
        are far from each other. None: no poses."""
        told = None if poses is None else np.concatenate([self.space.pose(pose) for pose in poses])
        self.guard.set(told, count, on_done)

    # ---- what the daemon did ----

    def notice(self, message: Message) -> None:
        """A notification of the channel's; those of other sessions are not for us."""
        params = message.params
        if params.get("session") != self.name or self.phase == "ended":
            return
        if message.method in ("journal.suspended", "journal.resumed"):
            self.unkept = params.get("reason", "")
        elif self.presence.notice(message):
            pass
        elif self.phase != "ready":
            self._early.append(message)
        elif message.method == "stroke.weights":
            self._notice_chunk(params)
        elif message.method == "session.update":
            self._notice_update(params)
        elif message.method == "session.closed":
            # A daemon that is told to stop closes its sessions; the lost connection says the rest.
            if params["reason"] != "skind is stopping":
                self.end(f"the session was closed: {params['reason']}")

    def _take_early(self) -> None:
        """`held` is known now: what was told meanwhile counts from there."""
        early, self._early = self._early, []
        for message in early:
            self.notice(message)

    def _notice_chunk(self, params: dict) -> None:
        stroke = self.asks.stroke_of(params["request"])
        if stroke is not None:
            stroke.chunks.append(self.space.change(params))
            stroke.solved = params["first"] + params["count"]

    def _notice_update(self, params: dict) -> None:
        if params["revision"] <= self.revision:
            return  # what we fetched holds it already
        self.instance = params.get("instance", self.instance)
        if self.replica.update(params, self.space):
            self._settle()
        else:
            self._resync()

    def take_info(self, info: dict) -> None:
        """What session.info tells of how the session is kept."""
        is_suspended = info.get("journal") == "suspended"
        self.unkept = (self.unkept or "its file cannot be written") if is_suspended else ""
        self.damage = info.get("damage", "")

    def fetch(self) -> Fetching:
        """All that the session has."""
        return fetch(self.rig, self.space, self.channel.capabilities)

    def _resync(self, scaled: np.ndarray = NONE) -> None:
        mark = object()
        self._fetches.add(mark)

        def talk() -> Talk:
            try:
                held = yield from self.fetch()
                while held.revision < self.revision:  # an update was faster than the answer
                    held = yield from self.fetch()
            finally:
                self._fetches.discard(mark)
            self.replica.catch_up(held, scaled)
            self._settle()

        self.follow(talk())

    # ---- what the tool did ----

    def show(self, arrival: Arrival, news: Change | None = None) -> Step:
        """The tool is about to show this change: takes it into `shown`, as a new state.

        `news`: what shown.trimmed() made of the change, if that was done before.
        """
        step = self.steps.add(self.shown.trimmed(arrival.change) if news is None else news)
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
        self.last = {**stroke.result, "seconds": stroke.seconds}
        self.residual[stroke.vertices] = stroke.result["residuals"]

    def shape_in(self, pose: np.ndarray) -> str:
        """The corrective shape that is seen in this pose, by its name, or ""."""
        known = self.poses.find(pose, self.length) if self.shown.shapes else None
        return known.name if known is not None and known.name in self.shown.shapes else ""

    def posed(self, vertices: np.ndarray | slice, pose: np.ndarray,
              positions: np.ndarray | None = None) -> np.ndarray:
        """f64 [n,3], mesh space: where a pose takes vertices as they are shown.

        From rest, or from `positions` f32 [V,3]; with the pose's corrective shape on top.
        """
        still = self.rig.unweighted[vertices]
        rest = (self.rest if positions is None else positions)[vertices]
        shape = self.shape_in(pose)
        if shape:
            rest = rest + self.shown.shapes[shape][vertices]
        posed = skin.blend(rest, self.joints[vertices], self.weights[vertices],
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
        vertices = self._ahead.hop(*path)
        self.version += 1
        self.residual[vertices] = np.nan
        self._settle()
        return vertices

    def painted(self, vertices: np.ndarray, rows: np.ndarray) -> Step:
        """The tool changed weights by itself: a new state, which the daemon is told."""
        step = self.steps.add(Change(vertices, rows))
        self._ahead.forget_hops()
        self._ahead.mark(vertices)
        self.version += 1
        self.residual[vertices] = np.nan
        self._settle()
        return step

    def _settle(self) -> None:
        """Where the tool is ahead and nothing else is under way, makes the daemon follow."""
        if self.phase != "ready" or self.channel.state != "ready":
            return  # the loss may not have been told yet
        if self.is_settled and not self.arrived:
            self._write_back.go_on(self.shown, self.space)

    # ---- the connection ----

    def lost(self) -> None:
        """The connection is gone; opening.resume() goes on when there is one again."""
        if self.phase in ("idle", "ended"):
            return
        if self.phase in ("creating", "joining"):
            self.end("the connection to skind was lost", "lost")
            return
        self.phase = "lost"
        self.presence.lost()
        self.asks.lost()
        self.replica.lost()
        self.pins.lost()
        self._fetches.clear()
        self._early.clear()
        self._poses_sent.clear()

    def adopt(self, held: Held) -> None:
        """A session was opened: takes what it has as the start, and is ready."""
        assert self.phase in ("creating", "joining")
        self.replica.adopt(held)
        self.first_joints = held.joints if held.revision == 0 else None
        self.start = self.held.copy()
        self.steps = Steps(self.held.copy())
        self.residual = np.full(len(self.joints), np.nan, np.float32)
        self.version += 1
        self.phase = "ready"
        self._take_early()

    def resumed(self, revision: int, missed: bool, remembers: bool) -> None:
        """The session is there again: what waits is sent.

        `revision`: what happened up to it comes as updates. `missed`: others may have been at work.
        `remembers`: it is the session that it was, with the answers that it gave.
        """
        self.replica.resumed(revision, missed)
        self.phase = "ready"
        self.asks.resume(missed, remembers)
        self._take_early()
        self._settle()
