# SPDX-License-Identifier: GPL-3.0-or-later
"""How answers come into the mesh so that nothing flashes and one Ctrl+Z undoes one stroke.

Blender's undo holds a stroke as a step of its own: the sculpted rest shape. Once the weights are
there that step must go, or an undo would show sculpted shape and new weights together:

    prepare the rows           in slices; nothing is changed yet
    undo the strokes' steps    the shape is at rest again (this puts back all of the mesh)
    write the change           in one piece with the undo: nothing is drawn in between
    mark the state, push       one step of undo a change

A change is written in this order: bones (groups that vertices lack), weights, rest positions, the
corrective shape. Where bones change, rows cannot be prepared before.

Where other steps have come on top of a stroke (a change of mode, say), undoing would take back the
wrong ones. Then the shape is written instead, and one press of Ctrl+Z more is needed there.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..core.presence import called
from ..core.replica import Arrival
from ..core.state import Change
from . import hands, jobs, mesh, shapes, undo, weights
from .messages import fault, tell

TITLES = {"undo": "Undo", "redo": "Redo", "set": "Weights", "pins": "Pins", "mirror": "Mirror",
          "prune": "Prune", "reduce": "Reduce", "refit": "Refit"}


class Landing:
    """Of one session. What has arrived waits until all strokes under way are answered."""

    def __init__(self, session) -> None:
        self._session = session
        self._job: jobs.Job | None = None

    def shape(self) -> np.ndarray:
        """f32 [V,3]: the rest shape as of the last stroke that waits, else the rest shape."""
        pending = self._session.sculpt.pending
        return pending[-1].host if pending else self._session.sculpt.rest

    def begin_when_due(self) -> None:
        """Called when nobody sculpts. A shape that no stroke left (a filter's) becomes a stroke
        first: putting the rest shape back would lose it."""
        session = self._session
        if jobs.current() is not None or not self.is_due or hands.are_busy():
            return
        if session.sculpt.pending and not _is_at(session.object(), self.shape()):
            session.solve()
            return
        self._job = jobs.run(self.land(), "Showing", self._ended)

    @staticmethod
    def _ended(error: Exception | None) -> None:
        """After a landing. One that was given up, for an undo, is no news."""
        if isinstance(error, (jobs.Refused, weights.MeshChanged)):
            if not isinstance(error, jobs.Cancelled):
                tell(str(error))
        elif error is not None:
            fault(error)

    @property
    def is_due(self) -> bool:
        sculpt = self._session.sculpt
        return (sculpt.is_settled and not self._session.shown_before
                and bool(sculpt.arrived or sculpt.pending))

    def land(self):
        """Job: shows what has arrived, in order, each as a step of undo."""
        try:
            yield from self._land()
        except weights.MeshChanged:  # nothing is lost: what arrived waits for the next landing
            yield from self._session.mend()

    def _land(self):
        session, sculpt = self._session, self._session.sculpt
        arrivals, strokes = list(sculpt.arrived), len(sculpt.pending)
        batches: list = []
        news = [sculpt.shown.trimmed(arrival.change) for arrival in arrivals]
        yield None
        if all(change.joints is None for change in news):
            for arrival in arrivals:
                batches.append((yield from weights.prepare_rows(
                    session.object_name, session.layout, arrival.vertices,
                    arrival.change.weights)))
                yield None
            yield jobs.WAIT  # what follows is a tick's work by itself
        # From here on in one piece: nothing is drawn in between.
        self._take_back_shape(strokes)
        for stroke in [each for each in sculpt.pending if each.error is not None]:
            sculpt.pending.remove(stroke)
            tell(f"The stroke was refused: {stroke.error}")
        for index, arrival in enumerate(arrivals):  # the first alone is what it was
            self._show(arrival, batches[index] if batches else None, None if index else news[0])

    def _show(self, arrival: Arrival, batches: list | None, news: Change | None) -> None:
        session, sculpt = self._session, self._session.sculpt
        sculpt.arrived.remove(arrival)
        step = sculpt.show(arrival, news)
        if batches is not None:
            weights.write_batch(session.object_name, session.layout, batches)
        else:
            session.write(step.vertices, reslotted=step.after.joints is not None)
        self._reshape(step)
        data = session.object().data
        mesh.mark_state(data, session.run_id, step.id)
        data.update()
        if arrival.stroke is not None:
            title = "Sculpt Weights"
            self._warn(arrival.stroke.result)
        elif arrival.client == sculpt.client:
            title = TITLES.get(arrival.cause, "Solve Pins")
        else:
            who = called(arrival.client, arrival.user) if arrival.client else "others"
            title = f"{TITLES.get(arrival.cause, 'Stroke')} by {who}"
            tell(title)
        undo.push(f"Skind: {title}")

    @staticmethod
    def _warn(result: dict) -> None:
        warnings = [warning["text"] for warning in result["warnings"]]
        if warnings:
            tell(" ".join(f"{text[:1].upper()}{text[1:]}." for text in warnings))

    def _reshape(self, step) -> None:
        """Rest positions and the corrective shape, as far as a step changed them."""
        session, sculpt = self._session, self._session.sculpt
        if step.after.rest is not None:
            shapes.write_positions(session.object().data, sculpt.rest)
        if step.after.offsets is not None:
            name = step.after.shape
            shapes.write(session.object(), name, sculpt.rest, sculpt.shown.shapes[name])
            session.switch_shapes(again=True)

    def _take_back_shape(self, strokes: int) -> None:
        obj, rest = self._session.object(), self._session.sculpt.rest
        if strokes == 0:
            return
        if obj.mode == 'SCULPT' and undo.take_back(
                strokes, lambda: _is_at(self._session.object(), rest)):
            return
        shapes.write_positions(self._session.object().data, rest)

    def is_doing(self, job: jobs.Job) -> bool:
        return job is self._job

    def finish(self) -> None:
        """Ends what is under way, at once: the next stroke begins."""
        while self._job is not None and not self._job.is_over:
            self._job.step()

    def abort(self) -> None:
        """Gives up a landing that is under way; what has arrived stays where it is."""
        if self._job is not None:
            self._job.cancel()

    def put_back(self) -> None:
        """The mesh as it is without the strokes that wait: whole, with the weights answered."""
        session = self._session
        self.abort()
        if session.layout is None or session.is_outside or not session.is_whole:
            return
        session.show(False)
        if not _is_at(session.object(), session.sculpt.rest):
            shapes.write_positions(session.object().data, session.sculpt.rest)


def _is_at(obj: bpy.types.Object, positions: np.ndarray) -> bool:
    return np.array_equal(mesh.read_positions(obj.data), positions)
