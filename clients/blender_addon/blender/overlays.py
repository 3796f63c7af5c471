# SPDX-License-Identifier: GPL-3.0-or-later
"""The overlays: the posed mesh painted by what a session knows of each vertex, and a legend.

What other tools claim is greyed in each, and over the mesh itself where no overlay is chosen.

Owns the draw handlers and the painting that is shown. Drawn with the GPU module over the mesh: no
material, attribute or mode of the user's is touched. A painting is made in slices, first within
the draw itself (small meshes are there at once), the rest as a job; meanwhile the one before stays,
unless the mesh has moved. A fault turns the overlay off and says why; it never reaches Blender.
"""

from __future__ import annotations

import time
import traceback
from typing import Any, Generator

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ..core import colours, skin
from . import drawing, jobs, mesh, session
from .properties import redraw_views

SLICE = 2000  # vertices: well below 1 ms of work
DRAW_BUDGET_S = 0.006  # of a redraw; what is left of a painting is done by the timer
PLAYING_BUDGET_S = 0.1  # while a clip plays each frame needs its own, and later is too late
LIFT = 4e-4  # towards the viewer, as a part of the distance: covers the mesh, no gap to be seen
LEAST_RESIDUAL = 1e-3  # of the character's length: less is reached, and not shown as hot
LEAST_CHANGE = 0.1
MODES = {'OBJECT', 'SCULPT', 'POSE', 'WEIGHT_PAINT', 'VERTEX_PAINT', 'TEXTURE_PAINT'}


class Painting:
    """One overlay of one state of a session; `key` is all that it depends on.

    work() makes it; then `positions`, `rgba` and `legend` are there, and `batch` once it was drawn.
    `claimed` bool [V]: what others claim.
    """

    def __init__(self, key: tuple, live: Any, rest: np.ndarray, pose: np.ndarray,
                 to_world: float) -> None:
        self.key = key
        _, self.kind, self.bone, _, self.before, _, _, _ = key
        self.live = live
        self.rest = rest
        self.pose = pose
        self.to_world = to_world  # world's length for one of the mesh's
        self.positions = np.empty((len(rest), 3), np.float32)
        self.rgba = np.empty((len(rest), 4), np.float32)
        self.claimed = np.zeros(len(rest), bool)
        self.legend: colours.Legend | None = None
        self.batch: Any = None
        self._work = self._slices()

    @property
    def is_done(self) -> bool:
        return self.legend is not None

    def advance(self) -> bool:
        """A slice of the work. False when it is done."""
        if not self.is_done:
            next(self._work, None)
        return not self.is_done

    def _slices(self) -> Generator[None, None, None]:
        sculpt = self.live.sculpt
        parts = [slice(first, first + SLICE) for first in range(0, len(self.rest), SLICE)]
        values = np.empty(len(self.rest), np.float32)
        for part in parts:
            values[part] = self._measure(sculpt, part)
            yield
        paint, legend = self._scale(sculpt, values)
        yield
        matrices = skin.deformations(self.pose, sculpt.rig.binds)
        state = sculpt.start if self.before else sculpt.shown
        normals = _rest_normals(self.live)
        step = sculpt.length * 1e-3
        yield
        for part in parts:
            # The normals' way into the pose: where a short step along them ends.
            joints = state.joints[part]
            rest = self.rest[part]
            posed = skin.blend(rest, joints, state.weights[part], matrices)
            ahead = skin.blend(rest + step * normals[part], joints, state.weights[part],
                               matrices)
            self.positions[part] = posed
            self.rgba[part] = paint(values[part])
            self.claimed[part] = sculpt.presence.claimed(state, sculpt.bones, part)
            colours.grey(self.rgba[part], self.claimed[part])
            colours.shade(self.rgba[part], ahead - posed)
            yield
        self.legend = colours.with_claims(
            legend, [other.name for other in sculpt.presence.claiming])

    @property
    def triangles(self) -> np.ndarray:
        """Those to be drawn."""
        every = self.live.triangles
        return every if self.kind != 'NONE' else np.ascontiguousarray(
            every[self.claimed[every].any(axis=1)])

    def _measure(self, sculpt: Any, part: slice) -> np.ndarray | float:
        if self.kind == 'NONE':
            return np.nan
        if self.kind == 'RESIDUAL':
            return sculpt.residual[part]
        state = sculpt.start if self.before else sculpt.shown
        joints, weights = state.joints[part], state.weights[part]
        if self.kind == 'CHANGE':
            moved = colours.weight_change(sculpt.start.joints[part], sculpt.start.weights[part],
                                          sculpt.joints[part], sculpt.weights[part])
            return np.where(moved > 0.0, moved, np.float32(np.nan))
        if self.kind == 'INFLUENCES':
            return colours.influence_counts(joints, weights)
        if self.bone not in sculpt.bones:
            return np.full(len(weights), np.nan, np.float32)
        return colours.reach(joints, weights, sculpt.bones.index(self.bone))

    def _scale(self, sculpt: Any, values: np.ndarray) -> tuple:
        """The function from values to colours, and the legend that explains it."""
        if self.kind == 'NONE':
            return (lambda part: np.zeros((len(part), 4), np.float32)), colours.Legend("")
        known = values[~np.isnan(values)]
        largest = float(known.max()) if len(known) else float("nan")
        if self.kind == 'RESIDUAL':
            # Round in what the user reads, which is the world's length.
            least = LEAST_RESIDUAL * sculpt.length * self.to_world
            top = colours.round_up(largest * self.to_world if len(known) else 0.0, least)
            legend = colours.residual_legend(top, largest * self.to_world, _length_text)
            return lambda part: colours.ramp_colours(part, top / self.to_world,
                                                     colours.HEAT), legend
        if self.kind == 'CHANGE':
            top = colours.round_up(largest if len(known) else 0.0, LEAST_CHANGE)
            return (lambda part: colours.ramp_colours(part, top, colours.SHARE),
                    colours.change_legend(top, largest if len(known) else 0.0))
        if self.kind == 'INFLUENCES':
            counts = values.astype(np.uint8)
            return (lambda part: colours.count_colours(part.astype(np.uint8)),
                    colours.counts_legend(counts))
        bone = self.bone or "choose a vertex group"
        if self.bone and self.bone not in sculpt.bones:
            bone = f"{self.bone} is no bone of this session"
        return (lambda part: colours.ramp_colours(part, 1.0, colours.SHARE),
                colours.reach_legend(bone))


class _State:
    """What is shown, and what is being made."""

    shown: Painting | None = None
    work: Painting | None = None
    job: jobs.Job | None = None
    rest: np.ndarray = np.empty((0, 3), np.float32)
    rest_id: int = 0  # + 1 with each change of `rest`
    normals: tuple[int, np.ndarray] = (0, rest)  # of the session with this id()
    off: str = ""  # the overlay that failed: not tried again before another is chosen
    handlers: list = []


_state = _State()


def _length_text(length: float) -> str:
    units = bpy.context.scene.unit_settings
    if units.system == 'NONE':
        return f"{length:.3g}"
    return bpy.utils.units.to_string(units.system, 'LENGTH', length * units.scale_length,
                                     precision=3)


def _rest_normals(live: Any) -> np.ndarray:
    """f32 [V,3] of the rest shape, read once for a session: they are for shading only."""
    if _state.normals[0] != id(live):
        vertices = live.object().data.vertices
        normals = np.empty(3 * len(vertices), np.float32)
        vertices.foreach_get("normal", normals)
        _state.normals = (id(live), normals.reshape(-1, 3))
    return _state.normals[1]


def _visible_object(context: bpy.types.Context, live: Any) -> bpy.types.Object | None:
    """The session's object, when this viewport shows it and its overlays."""
    obj = live.object()
    space = context.space_data
    if (obj is None or not space.overlay.show_overlays or obj.mode not in MODES
            or not obj.visible_get(view_layer=context.view_layer, viewport=space)):
        return None
    return obj


def _is_playing(context: bpy.types.Context) -> bool:
    return context.screen is not None and context.screen.is_animation_playing


def _painting(context: bpy.types.Context, live: Any, obj: bpy.types.Object,
              kind: str) -> Painting | None:
    """The painting to show now; begins and goes on with a new one where it is needed."""
    rest = mesh.read_positions(obj.data)
    if not np.array_equal(rest, _state.rest):
        _state.rest = rest
        _state.rest_id += 1
    pose = live.pose()
    shape = "" if live.shown_before else live.sculpt.shape_in(pose)
    group = obj.vertex_groups.active
    bone = ""
    if kind == 'REACH':
        bone = context.scene.skind.overlay_bone or (group.name if group else "")
    key = (id(live), kind, bone, live.sculpt.version, live.shown_before, pose.tobytes(),
           _state.rest_id, live.sculpt.presence.version)
    shown = _state.shown
    if shown is not None and shown.key == key:
        return shown
    if _state.work is None or _state.work.key != key:
        to_world = abs(obj.matrix_world.determinant()) ** (1 / 3) or 1.0
        rest = _state.rest + live.sculpt.shown.shapes[shape] if shape else _state.rest
        _state.work = Painting(key, live, rest, pose, to_world)
    _advance_in_draw(PLAYING_BUDGET_S if _is_playing(context) else DRAW_BUDGET_S)
    shown = _state.shown
    if shown is not None and shown.key[:3] + shown.key[4:6] == key[:3] + key[4:6]:
        return shown  # the one before, in place still: the mesh has hardly moved
    return None


def _advance_in_draw(budget_s: float) -> None:
    deadline = time.perf_counter() + budget_s
    work = _state.work
    while work.advance():
        if time.perf_counter() > deadline:
            if _state.job is None or _state.job.is_over:
                _state.job = jobs.run(_finish_later(), "Painting the overlay", _job_ended)
            return
    _state.shown, _state.work = work, None


def _finish_later() -> Generator[None, None, None]:
    """A job: goes on with whatever painting is wanted, then has it drawn."""
    while _state.work is not None:
        if not _state.work.advance():
            _state.shown, _state.work = _state.work, None
            break
        yield
    redraw_views()


def _job_ended(error: Exception | None) -> None:
    if error is not None and not isinstance(error, jobs.Refused):
        _turn_off(error)


def _draw_view() -> None:
    """POST_VIEW: the painting over the mesh."""
    context = bpy.context
    try:
        live = session.current()
        kind = context.scene.skind.overlay
        if kind != _state.off:
            _state.off = ""
        if live is None or not live.is_ready or not (
                kind != 'NONE' or live.sculpt.presence.claiming):
            clear()
            return
        if _state.off or live.is_stroking:
            return
        if kind == 'NONE' and _is_playing(context):
            return  # nobody asked for a painting that would cost every frame
        obj = _visible_object(context, live)
        if obj is None:
            return
        painting = _painting(context, live, obj, kind)
        if painting is not None:
            _draw_painting(context, live, obj, painting)
    except Exception as error:
        _turn_off(error)


def _draw_painting(context: bpy.types.Context, live: Any, obj: bpy.types.Object,
                   painting: Painting) -> None:
    if painting.batch is None:
        if len(painting.triangles) == 0:
            return
        painting.batch = drawing.coloured_triangles(painting.positions, painting.rgba,
                                                    painting.triangles)
    gpu.state.depth_test_set('LESS_EQUAL')
    gpu.state.depth_mask_set(True)  # the painting covers its own back where Blender draws no depth
    gpu.state.blend_set('ALPHA')  # without an overlay, what nobody claims is seen through
    gpu.matrix.push()
    gpu.matrix.push_projection()
    try:
        gpu.matrix.load_projection_matrix(_lifted_projection(context.region_data))
        gpu.matrix.multiply_matrix(obj.matrix_world)
        drawing.draw_triangles(painting.batch)
    finally:
        gpu.matrix.pop_projection()
        gpu.matrix.pop()
        gpu.state.blend_set('NONE')
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set('NONE')


def _lifted_projection(view: bpy.types.RegionView3D) -> Matrix:
    """The projection that shows everything where it is, but a little nearer to the viewer.

    In perspective, shrinking the view about the eye moves nothing on the screen.
    """
    projection = gpu.matrix.get_projection_matrix()
    if view.is_perspective:
        return projection @ Matrix.Diagonal((1 - LIFT, 1 - LIFT, 1 - LIFT, 1))
    return projection @ Matrix.Translation((0, 0, LIFT * view.view_distance))


def _draw_legend() -> None:
    """POST_PIXEL: what the colours mean, in the lower right corner."""
    context = bpy.context
    try:
        live = session.current()
        painting = _state.shown
        if live is None or painting is None or _visible_object(context, live) is None:
            return
        if painting.key[:2] != (id(live), context.scene.skind.overlay):
            return  # another overlay was chosen, and is not painted yet
        gpu.state.blend_set('ALPHA')
        try:
            draw_legend(context, painting.legend)
        finally:
            gpu.state.blend_set('NONE')
    except Exception as error:
        _turn_off(error)


BACKGROUND = (0.08, 0.08, 0.08, 0.82)
BRIGHT = (1.0, 1.0, 1.0, 1.0)
MUTED = (0.78, 0.78, 0.78, 1.0)
WIDTH, MARGIN, PADDING, LINE = 250, 16, 12, 22
TITLE_SIZE, TEXT_SIZE, BAR_HEIGHT, SWATCH = 15, 13, 16, 14


def draw_legend(context: bpy.types.Context, legend: colours.Legend) -> None:
    """Draws from the top of the box downwards; all measures are in units of the interface."""
    unit = drawing.scale()
    lines = (bool(legend.title) + bool(legend.subtitle) + len(legend.swatches)
             + (2 if legend.ticks else 0))
    width, height = WIDTH * unit, (lines * LINE + 2 * PADDING) * unit
    _, bottom, right, _ = drawing.free_area(context.area, context.region)
    left, bottom = right - width - MARGIN * unit, bottom + MARGIN * unit
    drawing.box(left, bottom, width, height, BACKGROUND)
    left += PADDING * unit
    width -= 2 * PADDING * unit
    base = bottom + height - (PADDING + 16) * unit
    if legend.title:
        drawing.text(left, base, legend.title, TITLE_SIZE * unit, BRIGHT)
        base -= LINE * unit
    if legend.subtitle:
        drawing.text(left, base, legend.subtitle, TEXT_SIZE * unit, MUTED)
        base -= LINE * unit
    if legend.ticks:
        drawing.gradient(left, base - 2 * unit, width, BAR_HEIGHT * unit, legend.ramp)
        base -= LINE * unit
        for place, words in zip((0.0, 0.5, 1.0), legend.ticks):
            shift = place * (width - drawing.text_width(words, TEXT_SIZE * unit))
            drawing.text(left + shift, base, words, TEXT_SIZE * unit, BRIGHT)
        base -= LINE * unit
    for colour, words in legend.swatches:
        drawing.box(left, base - 2 * unit, SWATCH * unit, SWATCH * unit, (*colour, 1.0))
        drawing.text(left + (SWATCH + 8) * unit, base, words, TEXT_SIZE * unit, BRIGHT)
        base -= LINE * unit


def clear() -> None:
    """Forgets what was painted; the job, if any, ends by itself."""
    _state.shown = _state.work = None


def _turn_off(error: Exception) -> None:
    traceback.print_exception(error)
    clear()
    _state.off = bpy.context.scene.skind.overlay
    session.tell(f"the overlay was turned off: {error!r}")
    # A draw handler may not change a scene: a moment later.
    bpy.app.timers.register(_choose_none, first_interval=0.0)


def _choose_none() -> None:
    bpy.context.scene.skind.overlay = 'NONE'


def register() -> None:
    if bpy.app.background:
        return  # no GPU, nothing to draw on
    view = bpy.types.SpaceView3D
    _state.handlers = [view.draw_handler_add(_draw_view, (), 'WINDOW', 'POST_VIEW'),
                       view.draw_handler_add(_draw_legend, (), 'WINDOW', 'POST_PIXEL')]


def unregister() -> None:
    for handler in _state.handlers:
        bpy.types.SpaceView3D.draw_handler_remove(handler, 'WINDOW')
    _state.handlers = []
    clear()
    _state.normals = (0, _State.rest)
