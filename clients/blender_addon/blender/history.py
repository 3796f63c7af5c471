# SPDX-License-Identifier: GPL-3.0-or-later
"""After Blender's own undo and redo: which state are we in, and which strokes are no more?

Blender has put back the mesh, weights and marks by itself. What is left is to follow: our copy of
the weights, the strokes that wait for an answer, and through them the daemon.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..core import skin
from . import mesh, session, undo, weights


@bpy.app.handlers.persistent
def _undone(*_: object) -> None:
    _moved(is_redo=False)


@bpy.app.handlers.persistent
def _redone(*_: object) -> None:
    _moved(is_redo=True)


def _moved(is_redo: bool) -> None:
    live = session.current()
    if undo.is_ours() or live is None or live.layout is None:
        return
    try:
        follow(live, is_redo)
    except Exception as error:  # a handler that raises is lost for good
        session.tell(f"could not follow the undo: {error!r}; please report it")


def follow(live: session.Session, is_redo: bool = False) -> None:
    """Brings a session to the state that its mesh is in."""
    live.landing.abort()
    if live.is_outside:
        session.tell("")  # what was told then
    obj = live.object()
    state = mesh.marked_state(obj.data, live.run_id) if obj is not None else None
    live.is_outside = state is None
    live.shown_before = False
    if live.is_outside:
        _drop_after(live, 0)
        session.tell("Undone to before the session began: redo to go on, or Cancel.")
        return
    live.topology.doubt()
    if not live.is_whole:
        return
    _follow_weights(live, state)
    _follow_shape(live, mesh.read_positions(obj.data), is_redo)


def _follow_weights(live: session.Session, state: int) -> None:
    sculpt = live.sculpt
    if state == sculpt.steps.live:
        return
    undone, redone = sculpt.steps.path(state) or ([], [])
    reslotted = [step.vertices for step in undone + redone if step.after.joints is not None]
    if sculpt.moved(state) is not None:
        if reslotted:
            live.fit(np.concatenate(reslotted))
    else:
        # Too long ago for our log: the mesh itself tells.
        everything = np.arange(sculpt.vertices, dtype=np.uint32)
        try:
            rows = weights.read_rows(live.object_name, live.layout, everything)
        except weights.MeshChanged:  # of other bones, which nobody remembers
            for _ in live.mend():
                pass
            rows = sculpt.weights.copy()
        rows[sculpt.rig.unweighted] = sculpt.weights[sculpt.rig.unweighted]
        differing = skin.differing(rows, sculpt.weights)
        step = sculpt.painted(differing, rows[differing])
        mesh.mark_state(live.object().data, live.run_id, step.id)


def _follow_shape(live: session.Session, shape: np.ndarray, is_redo: bool) -> None:
    """The strokes up to the one that left this shape still wait; those after it were undone."""
    pending = live.sculpt.pending
    shapes = [live.sculpt.rest] + [stroke.host for stroke in pending]
    for left in reversed(range(len(shapes))):
        if len(skin.differing(shape, shapes[left])) == 0:
            _drop_after(live, left)
            return
    if is_redo:
        live.solve()  # it brought back a stroke whose answer was dropped
        return
    # A stroke that was shown by now, before its answer. To solve it again would bring the artist
    # back to where the undo began, at every press.
    _drop_after(live, 0)
    session.tell("What is sculpted here has no weights yet: undo on, sculpt on, or Solve the Shape.")


def _drop_after(live: session.Session, left: int) -> None:
    if live.sculpt is None:
        return
    for stroke in reversed(live.sculpt.pending[left:]):
        live.sculpt.drop(stroke)


def register() -> None:
    bpy.app.handlers.undo_post.append(_undone)
    bpy.app.handlers.redo_post.append(_redone)


def unregister() -> None:
    bpy.app.handlers.undo_post.remove(_undone)
    bpy.app.handlers.redo_post.remove(_redone)
