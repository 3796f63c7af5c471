# SPDX-License-Identifier: GPL-3.0-or-later
"""One rig session as one tool sees it: strokes out, weights in, and who is ahead of whom.

Two states are kept (see state.py). `held` is the daemon's, as of the last revision heard of.
`shown` is what the tool shows. They part in two ways, and each has one way back:

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
from dataclasses import dataclass
from typing import Any, Callable, Generator

import numpy as np

from . import skin
from .asks import Ask, Done, Stroke
from .channel import Channel
from .fetching import Fetching, fetch
from .poses import Poses
from .presence import Presence
from .rig import Rig, Space
from .state import NONE, Change, Held, State, changes_to, joined
from .steps import Step, Steps
from .wire import Message, SkindError

Talk = Generator[tuple[str, dict], dict, None]  # yields requests, is sent their results

GONE = ("lost", "shutting_down")  # errors of a daemon that goes; what was asked is asked again
SUM_SLACK = 1e-7  # weights.set keeps rows to the bit that sum to one so nearly


@dataclass(eq=False)
class Entry:
    """A step of the daemon's history; `step` is ours that shows it, once it is shown."""

    step: Step | None = None
    dropped: bool = False  # its stroke was undone before its answer came


@dataclass(frozen=True, eq=False)
class Arrival:
    """A change that the daemon has made and the tool has not shown. Its vertices are told whole."""

    cause: str  # "stroke", "undo", "redo", "set", "mirror" and other edits, "resync"
    client: str
    change: Change
    entry: Entry | None = None
    stroke: Stroke | None = None
    user: str = ""  # the person at that client, where it was told

    @property
    def vertices(self) -> np.ndarray:
        return self.change.vertices


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
        self.instance = ""  # what `revision` is a revision of
        self.unkept = ""  # why what is done is not kept on the disk for now; "" as it should be
        self.damage = ""  # what the session's file had lost
        self.notes: list[dict] = []
        self.slots: dict = {}
        self.strokes = 0
        self.unreached = 0
        self.last: dict = {}  # the last answer to a stroke, with `seconds`: its whole way
        self.version = 0  # of what is shown and residual together
        self.pending: list[Stroke] = []
        self.arrived: deque[Arrival] = deque()
        self.held = State(np.empty((0, 4), np.uint16), np.empty((0, 4), np.float32),
                          np.empty((0, 3), np.float32))
        self.start = self.held  # as it was opened
        self.steps = Steps(self.held)
        self.residual = np.empty(0, np.float32)  # to the last target, mesh units; NaN: none
        self.poses = Poses()  # that strokes were made in
        self.pins: list[dict] = []  # as pins.list tells them
        self.guard: np.ndarray | None = None  # f64 [Q,B,4,4] poses to keep, mesh space
        self._guard_count = 0
        self.guard_is_told = True
        self.guarded: list[dict] = []  # which of them the daemon has picked
        self.space = Space(rig)
        self.presence = Presence(self._request, self._say)
        self.creation: dict = {}  # how it was made, to make it again
        self.source = ""  # the file it was made from, if it was
        self.is_ours = False
        self.must_tell = False  # the session was made again, and lacks what was answered before
        self.first_joints: np.ndarray | None = None  # of revision 0, as the daemon counts bones
        self._asks: list[Ask] = []  # what has no answer, in order
        self._fetches: set[object] = set()  # that are under way
        self._late: list[tuple[Stroke, Change]] = []  # answered; an update that covers it comes
        self._early: list[Message] = []  # told while the session is being opened
        self._behind = 0  # up to this revision updates tell what was missed
        self._due = 0  # and up to this one they come
        # Numbers our changes; above those of an earlier session of this connection (1/4096 ms).
        self._sequence = int(time.time() * 1000) << 12
        self._done: list[Entry] = []  # the daemon's history as far as we saw it grow
        self._undone: list[Entry] = []
        self._hops: list[tuple[str, Step]] = []  # ours that the daemon has not followed
        self._led: list[np.ndarray] = []  # vertices on which the tool may be ahead
        self._poses_sent: set[str] = set()
        self._pins_at = -1  # the revision of `pins`

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
        return (not self._asks and not self._fetches and not self._late
                and self.revision >= self._due
                and all(stroke.is_answered for stroke in self.pending))

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

    def _change(self, method: str, params: dict, done: Done, *, vertices: np.ndarray = NONE,
                stroke: Stroke | None = None, replays: bool = True) -> Ask:
        """Asks for a change; while there is no connection it waits for the next one. See Ask."""
        ask = Ask(method, params, done, vertices, stroke, replays)
        self._asks.append(ask)
        if self.phase == "ready":
            self._send(ask)
        elif self.phase == "ended":
            self._give_up(ask)
        return ask

    def _send(self, ask: Ask) -> None:
        if self.channel.state != "ready":
            return  # the loss was not told yet; it is sent when resumed
        for name in ask.poses:
            self._need_pose(name)
        if not ask.sequence and "sequence" in self.channel.capabilities:
            self._sequence += 1
            ask.sequence = self._sequence
        numbered = {"sequence": ask.sequence} if ask.sequence else {}
        if ask.stroke is not None:
            ask.stroke.chunks.clear()
        ask.request = self._request(ask.method, {**ask.params, **numbered},
                                    lambda result, error: self._answered(ask, result, error))
        if ask.is_cancelled:
            self.channel.cancel(ask.request)

    def _answered(self, ask: Ask, result: dict | None, error: SkindError | None) -> None:
        if error is not None and error.name in GONE and self.phase != "ended":
            ask.request, ask.in_doubt = None, True  # it is sent again when resumed
            return
        self._asks.remove(ask)
        ask.request = None
        if result is not None:
            self._due = max(self._due, result["revision"])
        ask.done(result, error)
        self._reveal(ask)
        self._settle()

    def cancel(self, ask: Ask) -> None:
        """Asks for a change to be given up; it is answered all the same."""
        if ask not in self._asks:
            return
        if ask.request is not None:  # it may be done before the daemon reads this
            self.channel.cancel(ask.request)
        elif ask.in_doubt and ask.sequence:
            ask.is_cancelled = True  # it is sent again, to hear what became of it
        else:
            self._give_up(ask)

    def _give_up(self, ask: Ask) -> None:
        """Nobody will know what became of it; what is shown counts."""
        self._asks.remove(ask)
        if ask.in_doubt:
            self._led.append(ask.vertices)
        ask.done(None, SkindError(0, "lost", "the connection to skind was lost", retryable=True))
        self._reveal(ask)

    def _say(self, problem: str) -> None:
        self.problem = problem

    def end(self, problem: str, reason: str = "") -> None:
        """The session is over for this tool; the weights stay as they are shown."""
        self.phase = "ended"
        self.problem, self.reason = problem, reason
        self.presence.end()
        for ask in [each for each in self._asks if each.request is None and each.stroke is None]:
            self._give_up(ask)

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
        stroke.ask = self._change(
            "stroke.apply",
            {"pose": stroke.pose_name, "vertices": stroke.vertices,
             "positions": self.space.points(stroke.targets), **stroke.options},
            lambda result, error: self._answer(stroke, result, error),
            vertices=stroke.vertices, stroke=stroke)

    def _need_pose(self, name: str) -> None:
        """The daemon must know this pose; one of another tool's it does know."""
        pose = self.poses.get(name)
        if pose is not None and name not in self._poses_sent:
            self._poses_sent.add(name)
            self._request("pose.set", self.pose_params(name), lambda *_: None)

    def pose_params(self, name: str) -> dict:
        """As pose.set takes a pose that a stroke was made in."""
        return {"pose": name, "matrices": self.space.pose(self.poses.get(name).matrices)}

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
        if result is None:
            return
        change = joined(stroke.chunks, self.influences)
        stroke.chunks.clear()
        if "residuals" not in result:  # it was done before, and its arrays went with the connection
            result["residuals"] = np.full(len(stroke.vertices), np.nan, np.float32)
            self._take_late(stroke, self.held.of(stroke.vertices))
        elif self._is_next(result):
            self.revision = result["revision"]
            self.held.put(change)
            self._take_answer(stroke, change)
        elif result["vertices"]:
            self._take_late(stroke, change)
        else:
            self._take_answer(stroke, change)

    def _is_next(self, result: dict) -> bool:
        """Whether what we know of our own change is all that we lack; else an update that covers
        it comes, or came (protocol/PROTOCOL.md, Revisions)."""
        return (result["vertices"] > 0 and result["revision"] == self.revision + 1
                and not result.get("repeated"))

    def _take_answer(self, stroke: Stroke, change: Change) -> None:
        """The stroke's change is in `held`."""
        entry = None
        if stroke.result["vertices"]:
            entry = self._remember(Entry(dropped=stroke.dropped))
            if stroke.result["revision"] < self.revision:
                self._forget_history()  # the steps after it were not told one by one
        if stroke.dropped:
            self._led.append(change.vertices)
        else:
            self._arrive("stroke", self.client, change, entry, stroke)
            stroke.ask.hidden = [(np.setdiff1d(those, change.vertices), shape)
                                 if shape in ("", change.shape) else (those, shape)
                                 for those, shape in stroke.ask.hidden]

    def _take_late(self, stroke: Stroke, change: Change) -> None:
        self._late.append((stroke, change))
        self._take_covered()

    def _take_covered(self) -> None:
        """Strokes that were answered, and whose revision `held` has reached since."""
        for late in [each for each in self._late if each[0].result["revision"] <= self.revision]:
            stroke, change = late
            self._late.remove(late)
            # A vertex that has a corrective shape keeps it with any stroke in its pose.
            shape = stroke.pose_name if stroke.pose_name in self.held.shapes else ""
            self._take_answer(stroke, self.held.of(change.vertices, shape=shape))
            self._reveal(stroke.ask)

    def drop(self, stroke: Stroke) -> None:
        """The stroke was undone before it was shown."""
        stroke.dropped = True
        self.pending.remove(stroke)
        self.cancel(stroke.ask)
        for arrival in [each for each in self.arrived if each.stroke is stroke]:
            self.arrived.remove(arrival)
            if arrival.entry is not None:
                arrival.entry.dropped = True
            self._led.append(arrival.vertices)
        self._settle()

    # ---- edits, pins and guards ----

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
            # Of pins alone, which nobody tells who asked.
            if method in ("pins.weigh", "pins.clear") and self._is_next(result):
                self.revision = result["revision"]
                nothing = Change(NONE, np.empty((0, self.influences), np.float32))
                self._arrive("pins", self.client, nothing, self._remember(Entry()))
            on_done(result)

        self._change(method, params, done)

    def ask_pins(self) -> None:
        """Has `pins` told anew if something was done since."""
        if (self._pins_at == self.revision or self.phase != "ready" or not self.is_settled
                or "pins" not in self.channel.capabilities):
            return
        self._pins_at = self.revision

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None:
                self.pins = result["pins"]

        self._request("pins.list", {}, done)

    def keep(self, poses: np.ndarray | None, count: int,
             on_done: Callable[[], None] = lambda: None) -> None:
        """Poses f64 [Q,B,4,4] that should stay as they are; the daemon picks `count` of them that
        are far from each other. None: no poses."""
        self.guard, self._guard_count = poses, count
        self.guard_is_told = False  # it is told again when resumed

        def done(result: dict | None, error: SkindError | None) -> None:
            self.guard_is_told = error is None or error.name not in GONE
            if result is not None:
                self.guarded = result["poses"]
            elif self.guard_is_told:
                self.guard, self.guarded, self.problem = None, [], str(error)
            on_done()

        self._request("guard.set", self.guard_params(), done)

    def refit(self, poses: np.ndarray, positions: np.ndarray, labels: list[str], other_bones: bool,
              on_done: Done) -> Ask | None:
        """Asks for weights that bring all vertices to positions f32 [P,V,3], mesh space, in poses
        f64 [P,B,4,4]. It arrives; on_done hears of the answer. Returns what to cancel.

        Of poses that are the same the first counts. None and no word to on_done: they all are.
        """
        chosen: dict[str, int] = {}
        for index, (pose, label) in enumerate(zip(poses, labels)):
            chosen.setdefault(self.poses.need(pose, self.length, label).name, index)
        if len(chosen) < 2:
            return None
        wanted = positions[list(chosen.values())].reshape(-1, 3)
        return self._change("session.refit", {
            "poses": list(chosen), "positions": self.space.points(wanted),
            "slots": "evidence" if other_bones else "keep"}, on_done)

    def guard_params(self) -> dict:
        if self.guard is None:
            return {}
        matrices = np.concatenate([self.space.pose(pose) for pose in self.guard])
        return {"matrices": matrices, "count": self._guard_count}

    # ---- what the daemon did ----

    def _arrive(self, cause: str, client: str, change: Change, entry: Entry | None = None,
                stroke: Stroke | None = None, user: str = "") -> None:
        """A change that is in `held` already waits to be shown."""
        self.arrived.append(Arrival(cause, client, self.held.whole(change), entry, stroke, user))

    def _remember(self, entry: Entry) -> Entry:
        self._done.append(entry)
        self._undone.clear()
        return entry

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
        stroke = next((ask.stroke for ask in self._asks if ask.request == params["request"]), None)
        if stroke is not None:
            stroke.chunks.append(self.space.change(params))
            stroke.solved = params["first"] + params["count"]

    def _notice_update(self, params: dict) -> None:
        if params["revision"] <= self.revision:
            return  # what we fetched holds it already
        is_missed = params.get("since", self.revision) > self.revision
        self.revision = params["revision"]
        self.instance = params.get("instance", self.instance)
        if params.get("resync") or is_missed:
            self._forget_history()
            self._resync()
            return
        change = self.space.change(params)
        self.held.put(change)
        if self._tells_late(params):
            self._forget_history()
            self._take_missed(change.vertices, change.shape)
        else:
            self._take_notice(params, change)
        self._take_covered()
        self._settle()

    def _tells_late(self, params: dict) -> bool:
        """Whether it tells several changes at once, or what was done while we were away."""
        return ("changes" in params or self.revision <= self._behind
                or (params["client"] == self.client and any(ask.in_doubt for ask in self._asks)))

    def _is_shown_late(self, change: Change) -> bool:
        """Whether it is one of our strokes, whose answer says what to do with it."""
        if any(stroke.result["revision"] == self.revision for stroke, _ in self._late):
            return True
        streamed = [joined(ask.stroke.chunks, self.influences)
                    for ask in self._asks if ask.stroke is not None]
        return any(each.shape == change.shape and np.array_equal(each.vertices, change.vertices)
                   and np.array_equal(each.weights, change.weights) for each in streamed)

    def _take_notice(self, params: dict, change: Change) -> None:
        """What was done, by whom; the change is in `held`."""
        cause = params["cause"]
        if params["client"] == self.client and cause == "stroke" and self._is_shown_late(change):
            return
        if params["client"] == self.client and cause in ("undo", "redo", "set"):
            self._led.append(change.vertices)  # ours; _settle() looks whether it did what it should
            return
        entry = None
        if cause == "undo":  # of a step from before we listened, too
            self._undone.append(self._done.pop() if self._done else Entry())
        elif cause == "redo":
            self._done.append(self._undone.pop() if self._undone else Entry())
        else:
            entry = self._remember(Entry())
        self._arrive(cause, params["client"], change, entry, user=params.get("user", ""))

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
            self.catch_up(held, scaled)
            self._settle()

        self.follow(talk())

    def catch_up(self, held: Held, scaled: np.ndarray = NONE) -> None:
        """All that the daemon has was fetched: what is new in it arrives, `scaled` anyway."""
        before, self.held, self.revision = self.held, held.state, held.revision
        self._take_covered()
        self._take_missed(np.union1d(self.held.differing(before), scaled).astype(np.uint32))
        for name, reshaped in self.held.reshaped(before):
            self._take_missed(reshaped, name)

    def _take_missed(self, vertices: np.ndarray, shape: str = "") -> None:
        """Something was done to these, which `held` has already. It arrives, but not where the tool
        is ahead, nor before the answer where what was asked for may have done it."""
        for those in self._led:
            vertices = np.setdiff1d(vertices, those)
        for ask in self._asks + [stroke.ask for stroke, _ in self._late]:
            own = np.intersect1d(vertices, ask.vertices)
            if len(own):
                ask.hidden.append((own, shape))
                vertices = np.setdiff1d(vertices, own)
        if len(vertices):
            self._arrive("resync", "", self.held.of(vertices, shape=shape))

    def _reveal(self, ask: Ask) -> None:
        """It has its answer: what was done before or after it arrives, too."""
        hidden, ask.hidden = ask.hidden, []
        for vertices, shape in hidden:
            self._take_missed(vertices, shape)

    def _forget_history(self) -> None:
        self._done.clear()
        self._undone.clear()

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
        self.unreached = stroke.result["unreached"]
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
        step = self.steps.add(Change(vertices, rows))
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
        ahead = changes_to(self.shown, self.held, led)
        if ahead:
            self._set(ahead[0])
            self._led += [change.vertices for change in ahead[1:]]

    def _go(self, method: str, origin: list[Entry], goal: list[Entry]) -> None:
        entry = origin[-1]

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None and origin and origin[-1] is entry:
                goal.append(origin.pop())
                entry.dropped = False  # what redoes it is another's wish
            else:
                self._forget_history()  # the daemon's is another: set the rows instead

        vertices = NONE if entry.step is None else entry.step.vertices
        self._change(method, {}, done, vertices=vertices, replays=False)

    def _set(self, change: Change) -> None:
        vertices = change.vertices

        def done(result: dict | None, error: SkindError | None) -> None:
            if result is not None:
                if self._is_next(result):
                    self.revision = result["revision"]
                    self.held.put(change)
                    self._remember(Entry())
                sums = change.weights.sum(axis=1, dtype=np.float64)
                if result["vertices"] != len(vertices) or (abs(sums - 1) > SUM_SLACK).any():
                    self._resync(vertices)  # twins went with them, or rows were scaled
                else:
                    self._led.append(vertices)  # another's change may arrive on top of these
            elif error.name in GONE:
                self._led.append(vertices)
            else:
                self.problem = str(error)
                self._arrive("resync", "", self.held.of(vertices, shape=change.shape))

        self._change("weights.set", self.space.params(change), done, vertices=vertices,
                     replays=False)

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
        self._fetches.clear()
        # What was answered and not told comes with the same answer again.
        for stroke, _ in self._late:
            stroke.result, stroke.ask.in_doubt = None, True
        self._asks[:0] = [stroke.ask for stroke, _ in self._late]
        self._late.clear()
        self._early.clear()
        self._behind = self._due = 0
        self._poses_sent.clear()
        self._pins_at = -1
        for ask in self._asks:
            ask.in_doubt |= ask.request is not None
            ask.request = None

    def adopt(self, held: Held) -> None:
        """A session was opened: takes what it has as the start, and is ready."""
        assert self.phase in ("creating", "joining")
        self.revision, self.influences = held.revision, held.influences
        self.first_joints = held.joints if held.revision == 0 else None
        self.held = held.state
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
        self._behind = self._due = revision
        if missed:
            self._forget_history()
            self._hops.clear()
        self.phase = "ready"
        for ask in list(self._asks):
            knows = remembers and ask.in_doubt and ask.sequence  # it tells what became of it
            if (ask.is_cancelled or not ask.replays) and not knows or missed and not ask.replays:
                self._give_up(ask)
                continue
            ask.in_doubt &= remembers
            self._send(ask)
        self._take_early()
        self._settle()
