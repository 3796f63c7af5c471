# SPDX-License-Identifier: GPL-3.0-or-later
"""A sculpting session: a mesh, a rig session, and what lies between.

Whatever deviates from the rest shape is a sculpted pose that waits for its weights; when they are
there the rest shape is put back (see landing.py). Nothing but an answer moves the rest shape.
"""

from __future__ import annotations

import os
import time
import uuid
from typing import Callable

import bpy
import numpy as np

from ..core import opening, options, skin
from ..core.sculpt import Sculpt
from ..core.state import State
from . import checks, connection, export, guards, jobs, mesh, rig, shapes, undo, weights
from .landing import Landing
from .messages import fault, tell
from .properties import redraw_views
from .snapshot import Snapshot

PATIENCE_TICKS = 4000  # a job waits for the connection so long before it gives up, some 20 s


class Session:
    """One mesh in one rig session. References into bpy are never kept: undo invalidates them."""

    def __init__(self, object_name: str, on_ended: Callable[[], None]) -> None:
        """`on_ended` is called when it is over, or never came about."""
        self.object_name = object_name
        self.run_id = uuid.uuid4().hex[:8]  # in the mesh's marks
        self._on_ended = on_ended
        self.sculpt: Sculpt | None = None  # None until the mesh is read
        self.snapshot: Snapshot | None = None
        self.topology: mesh.Topology | None = None  # there when the layout is
        self._problem = ""  # with the mesh, as it was told last
        self.layout: weights.Layout | None = None  # None until the slots are made
        self.landing = Landing(self)
        self.is_stroking = False
        self.is_outside = False  # undone to before Start; redo comes back
        self.shown_before = False
        self._shape_shown: str | None = None  # whose corrective shape is switched on
        self.kept: list[tuple[str, np.ndarray]] = []  # poses kept by hand: label, matrices
        self._guard_wanted = False  # the poses to keep are to be gathered anew
        self._presence_seen = 0  # its version, as the views were drawn last

    # ---- looking ----

    @property
    def job(self) -> jobs.Job | None:
        return jobs.current()

    @property
    def is_ready(self) -> bool:
        """Strokes are taken."""
        return self.layout is not None and not self.is_outside and self.sculpt.phase != "ended"

    @property
    def triangles(self) -> np.ndarray:
        return self.sculpt.rig.triangles

    @property
    def is_whole(self) -> bool:
        """The mesh is still the one that it began with, vertex for vertex."""
        return self.topology.problem(self.object()) == ""

    @property
    def is_marked(self) -> bool:
        """The mesh says that it is in this session."""
        obj = self.object() if self.layout is not None else None
        return obj is not None and obj.data.get(mesh.SESSION) == self.sculpt.name

    def object(self) -> bpy.types.Object | None:
        """Found by its name, or after it was renamed by the mark on its mesh."""
        obj = bpy.data.objects.get((self.object_name, None))
        if self.layout is None or self._has_mark(obj):
            return obj
        marked = next((each for each in bpy.data.objects if self._has_mark(each)), None)
        if marked is None:
            return obj  # undone to before Start, if it is there
        self.object_name = marked.name
        return marked

    def _has_mark(self, obj: bpy.types.Object | None) -> bool:
        return (obj is not None and obj.type == 'MESH'
                and mesh.marked_state(obj.data, self.run_id) is not None)

    def pose(self) -> np.ndarray:
        """f64 [B,4,4], bone to mesh space, now."""
        return rig.pose(self.object(), self.sculpt.rig.names, self.sculpt.rig.binds)

    def face(self) -> tuple:
        sculpt = self.sculpt
        if sculpt is None:
            return ()
        return (sculpt.phase, sculpt.version, sculpt.strokes, sculpt.problem, len(sculpt.pending),
                sum(stroke.solved for stroke in sculpt.pending), sculpt.unkept, sculpt.damage,
                self.shown_before,
                self.is_outside, len(sculpt.guard.kept), sculpt.presence.version,
                sculpt.presence.others and int(time.time() // 60),  # since when they are here
                tuple((pin["pose"], pin["weight"], pin["vertices"]) for pin in sculpt.pins))

    def run(self, work, label: str) -> jobs.Job:
        return jobs.run(work, label, lambda error: self._ended(label, error))

    def _ended(self, label: str, error: Exception | None) -> None:
        """After a job: when the session was never made, it is taken away again."""
        if error is None:
            return
        if isinstance(error, (jobs.Refused, weights.MeshChanged)):
            tell(f"{label}: {error}.")
        else:
            fault(error)
        if self.layout is None:
            if self.sculpt is not None:
                opening.leave(self.sculpt)
            self._on_ended()

    # ---- beginning ----

    def start(self, influences: int, reduce: bool, durability: str):
        """Job: the mesh as it is becomes a new session."""
        yield from self._read()
        opening.create(self.sculpt, self.object_name, influences, reduce, durability)
        yield from self._until_ready("creating")
        yield from self._make_slots()
        self.want_guard()
        undo.push("Skind: Start")

    def join(self, name: str):
        """Job: the mesh takes on the weights of a session that is there."""
        yield from self._read()
        opening.join(self.sculpt, name)
        yield from self._until_ready("joining")
        yield from self._make_slots()
        self.want_guard()
        undo.push("Skind: Join")

    def rejoin(self, name: str, influences: int, durability: str):
        """Job: joins it again if it is still there, or takes it back if it was closed; else it begins
        anew from the mesh as it is."""
        original = self._remembered_snapshot()
        instance = str(self.object().data.get(mesh.INSTANCE, ""))
        yield from self._read()
        try:
            opening.join(self.sculpt, name, kept=instance)
            yield from self._until_ready("joining")
        except jobs.Refused:
            if self.sculpt.reason != "no_session":
                raise
            if shapes.ours(self.object().data):
                raise jobs.Refused(f"skind no longer has \"{name}\", and cannot take its shape "
                                   "keys along: Forget keeps the mesh as it is") from None
            opening.create(self.sculpt, name, influences, True, durability)
            yield from self._until_ready("creating")
            tell(f"skind no longer has \"{name}\": it begins anew from this mesh.")
        yield from self._make_slots()
        if original is not None:
            yield from weights.count_added_since(self.layout, self.sculpt.rig.names,
                                                 original.names, original.entries)
            self.snapshot = original
        self.want_guard()
        undo.push("Skind: Rejoin")

    def remember(self) -> None:
        """Leaves in the mesh what rejoin(), and Cancel after it, will need."""
        data = self.object().data
        data[mesh.SNAPSHOT] = self.snapshot.to_bytes()
        data[mesh.INSTANCE] = self.sculpt.instance

    def _remembered_snapshot(self) -> Snapshot | None:
        """The mesh as it was at the first Start, if the file tells and it is still that mesh."""
        data = self.object().data
        saved = data.get(mesh.SNAPSHOT)
        try:
            snapshot = Snapshot.from_bytes(saved) if isinstance(saved, bytes) else None
        except ValueError:
            return None
        if snapshot is not None and len(snapshot.positions) != len(data.vertices):
            return None
        return snapshot

    def _read(self):
        self.snapshot = yield from Snapshot.take(self.object_name)
        read = yield from rig.read(self.object_name)
        for _ in range(PATIENCE_TICKS):
            if connection.channel().state == "ready":
                break
            yield jobs.WAIT
        else:
            raise jobs.Refused(connection.channel().problem or "skind did not answer")
        self.sculpt = Sculpt(connection.channel(), read, connection.client_name())

    def _until_ready(self, phase: str):
        while self.sculpt.phase == phase:
            yield jobs.WAIT
        if self.sculpt.phase != "ready":
            raise jobs.Refused(self.sculpt.problem or "the connection was lost")

    def _make_slots(self):
        """The mesh shows the session's weights from here on, and is marked."""
        sculpt = self.sculpt
        try:
            layout = yield from weights.make_slots(self.object_name, sculpt.rig.names,
                                                   sculpt.joints, sculpt.rig.unweighted)
            everything = np.arange(sculpt.vertices, dtype=np.uint32)
            yield from weights.write_rows(self.object_name, layout, everything, sculpt.weights)
            self._show_shape()
        except BaseException:  # cancelled, too
            shapes.remove(self.object())
            for _ in Snapshot.restore(self.object_name, self.snapshot):
                pass
            raise
        data = self.object().data
        mesh.unmark(data)
        data[mesh.SESSION] = sculpt.name
        mesh.mark_state(data, self.run_id, sculpt.steps.live)
        data.update()
        self.topology = mesh.Topology(data)
        self.layout = layout

    def _show_shape(self) -> None:
        """Rest positions and corrective shapes of a session that was joined."""
        sculpt, obj = self.sculpt, self.object()
        if not np.array_equal(mesh.read_positions(obj.data), sculpt.rest):
            shapes.write_positions(obj.data, sculpt.rest)
        for name, offsets in sculpt.shown.shapes.items():
            shapes.write(obj, name, sculpt.rest, offsets)
        self.switch_shapes()

    def switch_shapes(self, again: bool = False) -> None:
        """The corrective shape of the pose that is seen now is switched on, and no other; when the
        pose has changed, so that what an artist sets by hand stays until then."""
        if not self.sculpt.shown.shapes:
            return
        name = "" if self.shown_before else self.sculpt.shape_in(self.pose())
        if again or name != self._shape_shown:
            self._shape_shown = name
            shapes.switch(self.object(), name)

    # ---- strokes ----

    def tick(self) -> None:
        """Shows what has arrived, when nobody is in the middle of a stroke."""
        if self.layout is None or self.is_outside or self.is_stroking:
            return
        problem = self.topology.problem(self.object())
        if problem != self._problem:
            self._problem = problem
            tell(problem)
        if problem:
            return
        if self.sculpt.problem:
            tell(self.sculpt.problem)
            self.sculpt.problem = ""
        if self.sculpt.presence.version != self._presence_seen:
            self._presence_seen = self.sculpt.presence.version
            redraw_views()
        self.switch_shapes()
        self.sculpt.ask_pins()
        self._gather_guard()
        self.landing.begin_when_due()

    def solve(self) -> int:
        """What was sculpted since the last stroke goes out as a stroke; returns its vertices.

        Called at a stroke's end, and for whatever else changed the shape.
        """
        sculpt = self.sculpt
        obj = self.object()
        problem = self.topology.problem(obj) or checks.problem_since_start(obj, sculpt.rig.names)
        if problem:
            tell(problem)
            return 0
        shape = mesh.read_positions(self.object().data)
        changed = skin.differing(shape, self.landing.shape())
        vertices = changed[~sculpt.rig.unweighted[changed]]
        if len(vertices) == 0:
            if len(changed):
                self.landing.put_back()
                tell(f"{len(changed)} vertices have no weights: a stroke cannot move them.")
            return 0
        pose = self.pose()
        targets = sculpt.posed(vertices, pose, positions=shape)
        chosen = options.usable(*self.settings())
        if "pin" in chosen:
            chosen |= self._mask(vertices)
        sculpt.stroke(vertices, targets, pose, chosen, host=shape, label=rig.label(obj))
        return len(vertices)

    def settings(self) -> tuple:
        """The artist's settings, what this daemon can do, and Blender's padlocks."""
        names = set(self.sculpt.rig.names)
        locked = [group.name for group in self.object().vertex_groups
                  if group.lock_weight and group.name in names]
        return bpy.context.scene.skind, connection.channel().capabilities, locked

    def _mask(self, vertices: np.ndarray) -> dict:
        """Sculpt Mode's mask as stroke.apply takes it, where the artist wants that."""
        chosen, capabilities, _ = self.settings()
        if not (chosen.use_mask and options.can("use_mask", capabilities)):
            return {}
        mask = mesh.read_mask(self.object().data)
        return {} if mask is None else {"mask": 1 - mask[vertices]}

    def want_guard(self) -> None:
        """Which poses to keep has changed."""
        self._guard_wanted = True

    def _gather_guard(self) -> None:
        is_needed = bpy.context.scene.skind.keep or self.sculpt.guard.is_set
        able = options.can("keep", connection.channel().capabilities)
        may_begin = able and self.sculpt.phase == "ready" and jobs.current() is None
        if self._guard_wanted and is_needed and may_begin:
            self._guard_wanted = False
            self.run(guards.gather(self), "Looking at other poses")

    def edit(self, method: str, params: dict, on_done: Callable[[dict], None]) -> None:
        """Asks for a step that is no stroke; what comes of it is shown as one."""
        self.show(False)
        self.sculpt.edit(method, params, on_done)

    def cancel_pending(self) -> None:
        """Gives up what is under way: a job, or the strokes without an answer."""
        job = jobs.current()
        if job is not None and not self.landing.is_doing(job):
            job.cancel()
            return
        self.landing.finish()
        for stroke in reversed(list(self.sculpt.pending)):
            self.sculpt.drop(stroke)
        self.landing.put_back()

    # ---- seeing ----

    def show(self, before: bool) -> None:
        """Shows the weights as they were at the start, or as they are."""
        if before == self.shown_before or not self.is_ready or not self.is_whole:
            return
        self.landing.finish()
        sculpt = self.sculpt
        goal, other = (sculpt.start, sculpt.shown) if before else (sculpt.shown, sculpt.start)
        try:
            self._write_state(goal, other)
        except jobs.Refused as error:
            tell(str(error))
            return
        if np.array_equal(mesh.read_positions(self.object().data), other.rest):  # not sculpted
            shapes.write_positions(self.object().data, goal.rest)
        self.shown_before = before
        self.switch_shapes(again=True)

    def _write_state(self, goal: State, other: State) -> None:
        """Has the mesh show the weights of one state, in place of another's."""
        differing = goal.differing(other)
        reslotted = len(skin.differing(goal.joints, other.joints)) > 0
        self.write(differing, goal, reslotted)

    def fit(self, vertices: np.ndarray) -> None:
        """After Blender's undo: these vertices have other entries, for other bones."""
        try:
            self.layout = weights.fit_slots(self.object_name, self.layout, self.sculpt.rig.names,
                                            self.sculpt.joints, vertices, read=True)
        except weights.MeshChanged:
            for _ in self.mend():
                pass

    def write(self, vertices: np.ndarray, state: State | None = None,
              reslotted: bool = False) -> None:
        """Has the mesh show the weights of vertices, all at once: what is shown, or a state's.

        `reslotted`: their bones are not those that the mesh has entries for.
        """
        state = self.sculpt.shown if state is None else state

        def write() -> None:
            if reslotted:
                self.layout = weights.fit_slots(self.object_name, self.layout,
                                                self.sculpt.rig.names, state.joints, vertices)
            for _ in weights.write_rows(self.object_name, self.layout, vertices,
                                        state.weights[vertices]):
                pass

        try:
            write()
        except weights.MeshChanged:
            for _ in self.mend():
                pass
            write()
        self.object().data.update()

    def mend(self):
        """Job: after vertex groups were changed outside of Skind: the session's weights again.

        Not when bones were renamed, and their groups with them: they would be others' groups.
        """
        sculpt = self.sculpt
        problem = checks.missing_bones(self.object(), sculpt.rig.names)
        if problem:
            raise jobs.Refused(problem)
        layout = yield from weights.make_slots_again(self.object_name, self.layout,
                                                     sculpt.rig.names, sculpt.joints)
        everything = np.arange(sculpt.vertices, dtype=np.uint32)
        yield from weights.write_rows(self.object_name, layout, everything, sculpt.weights)
        self.layout = layout
        self.object().data.update()
        tell("Vertex groups were changed outside of Skind: they hold the session's weights again.")

    # ---- ending ----

    def finish(self) -> None:
        self.run(self._finish(), "Finishing")

    def settle(self):
        """Job: waits for the strokes under way and shows what arrived. The rest shape is there."""
        self.show(False)
        while not self.is_outside and (self.sculpt.pending or self.sculpt.arrived):
            is_over = self.sculpt.phase == "ended"
            if self.landing.is_due or (is_over and self.sculpt.arrived):
                yield from self.landing.land()
            elif is_over:
                break
            else:
                yield jobs.WAIT
        self.landing.put_back()

    def _finish(self):
        obj = self.object()
        problem = "" if self.is_outside else self.topology.problem(obj)
        if problem and obj is not None and self.topology.may_pass(obj):
            raise jobs.Refused(problem)
        if problem:  # nothing is left that weights could be written to
            self._leave("Skind: Finish")
            tell("The session is over; the mesh stays as it is: it is no longer the one that was "
                 "sculpted.")
            return
        if not self.is_outside and self.sculpt.phase == "ready":
            self.solve()  # what was changed without a brush
        yield from self.settle()
        if not self.is_outside:
            if weights.group_names(self.object()) != self.layout.groups:
                yield from self.mend()
            yield from weights.remove_padding(self.object_name, self.layout)
        self._leave("Skind: Finish")

    def cancel(self) -> None:
        self.run(self._cancel(), "Taking back")

    def _cancel(self):
        if not self.is_outside and self.object() is not None:
            problem = self.topology.problem(self.object())
            if problem:
                raise jobs.Refused(f"{problem} Or Finish, which leaves the mesh as it is")
            self.landing.put_back()
            shapes.remove(self.object())
            restoring = Snapshot.restore(self.object_name, self.snapshot)
            try:
                for done in restoring:
                    yield done
            except GeneratorExit:  # half of it would be neither what was nor what is
                for _ in restoring:
                    pass
                self._leave("Skind: Cancel")
                raise
        self._leave("Skind: Cancel")

    def _leave(self, step: str) -> None:
        if self.object() is not None:
            mesh.unmark(self.object().data)
            self.object().data.update()
        opening.leave(self.sculpt)
        self._on_ended()
        undo.push(step)

    def export(self, path: str) -> None:
        self.run(export.export(self, os.path.abspath(path)), "Exporting")
