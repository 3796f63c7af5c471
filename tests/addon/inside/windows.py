"""A Blender window driven by simulated events: pen, keys, view, sculpt tools, screenshots.

Jobs are generator functions that get a Window; Blender handles events, runs timers and draws only
while a job has yielded. Helpers that need that are generators too: `yield from window.stroke(...)`.
Pixels are the window's, from its lower left corner, as Blender's events have them.
"""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from typing import Callable, Iterator, Sequence

import bpy
import numpy as np
from bpy_extras.view3d_utils import (location_3d_to_region_2d, region_2d_to_origin_3d,
                                     region_2d_to_vector_3d)
from mathutils import Quaternion, Vector

Pixel = tuple[float, float]
Steps = Iterator[float]  # of a generator: the seconds to wait

PACE = 0.01  # seconds from one event to the next

VIEWS = {  # the eye's rotation
    "front": Quaternion((1, 0, 0), np.pi / 2),
    "right": Quaternion((0.5, 0.5, 0.5, 0.5)),
    "top": Quaternion(),
    "corner": Quaternion((0, 0, 1), np.pi / 5) @ Quaternion((1, 0, 0), np.pi / 2.6),
}


class Window:
    """The one window of this Blender, and its 3-D view."""

    def __init__(self) -> None:
        preferences = bpy.context.preferences
        preferences.system.viewport_aa = "OFF"  # halves the time of a redraw
        preferences.view.smooth_view = 0
        self._mouse: Pixel = (0, 0)

    @property
    def window(self) -> bpy.types.Window:
        return bpy.context.window_manager.windows[0]

    @property
    def area(self) -> bpy.types.Area:
        areas = [area for area in self.window.screen.areas if area.type == "VIEW_3D"]
        return max(areas, key=lambda area: area.width * area.height)

    @property
    def region(self) -> bpy.types.Region:
        return next(region for region in self.area.regions if region.type == "WINDOW")

    @property
    def space(self) -> bpy.types.SpaceView3D:
        return self.area.spaces.active

    def context(self) -> AbstractContextManager:
        """For operators, as if they came from the 3-D view: `with window.context(): bpy.ops...`"""
        return bpy.context.temp_override(window=self.window, area=self.area, region=self.region)

    def wait_until(self, true: Callable[[], object], seconds: float = 10.0) -> Steps:
        """Lets Blender run until true() is; TimeoutError after `seconds`."""
        end = time.monotonic() + seconds
        while not true():
            if time.monotonic() > end:
                raise TimeoutError(f"still not so after {seconds:g} s: {true}")
            yield 0.01

    # --- events

    def _event(self, kind: str, value: str, **modifiers: bool) -> None:
        x, y = self._mouse
        self.window.event_simulate(type=kind, value=value, x=int(x), y=int(y), **modifiers)

    def move(self, to: Pixel, **modifiers: bool) -> Steps:
        """The pen to a place; modifiers: shift, ctrl, alt."""
        self._mouse = to
        self._event("MOUSEMOVE", "NOTHING", **modifiers)
        yield PACE

    def press(self, button: str = "LEFTMOUSE", **modifiers: bool) -> Steps:
        self._event(button, "PRESS", **modifiers)
        yield PACE

    def release(self, button: str = "LEFTMOUSE", **modifiers: bool) -> Steps:
        self._event(button, "RELEASE", **modifiers)
        yield PACE

    def key(self, key: str, **modifiers: bool) -> Steps:
        """A key over the 3-D view, with ctrl, shift, alt: key("Z", ctrl=True)."""
        if not self._over_view():
            yield from self.move(self.middle())
        yield from self.press(key, **modifiers)
        yield from self.release(key, **modifiers)

    def stroke(self, points: Sequence[Pixel], *, hold: float = 0.0, pause: float = 0.0,
               shift: bool = False, ctrl: bool = False) -> Steps:
        """One stroke of the pen through pixels; `hold` seconds pass before it is lifted, `pause`
        after each move."""
        held = {"shift": shift, "ctrl": ctrl}
        yield from self.move(points[0])  # the first event of a session is lost: this one may be
        yield from self.move(points[0], **held)
        yield from self.press(**held)
        for point in points:
            yield from self.move(point, **held)
            if pause:
                yield pause
        if hold:
            yield hold
        yield from self.release(**held)

    # --- where things are on the screen

    def _over_view(self) -> bool:
        x, y = self._mouse[0] - self.region.x, self._mouse[1] - self.region.y
        return 0 <= x < self.region.width and 0 <= y < self.region.height

    def middle(self) -> Pixel:
        """The 3-D view's centre."""
        return (self.region.x + self.region.width // 2, self.region.y + self.region.height // 2)

    def pixel(self, place: Sequence[float]) -> Pixel:
        """Where a point of the world is seen."""
        seen = location_3d_to_region_2d(self.region, self.space.region_3d, Vector(place))
        assert seen is not None, f"{tuple(place)} is behind the eye"
        return (round(seen.x) + self.region.x, round(seen.y) + self.region.y)

    def hit(self, pixel: Pixel) -> tuple[bpy.types.Object, Vector, int] | None:
        """(object, place in the world, face of the evaluated mesh) under a pixel."""
        at = (pixel[0] - self.region.x, pixel[1] - self.region.y)
        view = self.space.region_3d
        found, place, _, face, thing, _ = bpy.context.scene.ray_cast(
            bpy.context.evaluated_depsgraph_get(),
            region_2d_to_origin_3d(self.region, view, at),
            region_2d_to_vector_3d(self.region, view, at))
        return (thing.original, place, face) if found else None

    def surface(self, thing: bpy.types.Object, count: int, seed: int = 0,
                margin: int = 60) -> list[Pixel]:
        """`count` pixels where a stroke begins on the object's seen surface, spread at random.

        Pixels nearer than `margin` to the view's border lie under its tools and panels.
        """
        random = np.random.default_rng(seed)
        found: list[Pixel] = []
        for _ in range(count * 200):
            if len(found) == count:
                break
            at = (self.region.x + int(random.integers(margin, self.region.width - margin)),
                  self.region.y + int(random.integers(margin, self.region.height - margin)))
            seen = self.hit(at)
            if seen is not None and seen[0] == thing:
                found.append(at)
        assert len(found) == count, f"{thing.name} is hardly seen"
        return found

    def over(self, thing: bpy.types.Object, vertex: int, near: float = 0.05) -> Pixel:
        """The pixel of a posed vertex, where the brush will really meet it.

        AssertionError when something hides it: the surface seen there is farther from it than
        `near`, as a share of the object's size.
        """
        posed = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        place = posed.matrix_world @ posed.data.vertices[vertex].co
        pixel = self.pixel(place)
        seen = self.hit(pixel)
        assert seen is not None and seen[0] == thing, f"vertex {vertex} is not seen"
        distance = (seen[1] - place).length
        assert distance <= near * max(thing.dimensions), f"vertex {vertex} is hidden"
        return pixel

    # --- what the window shows

    def look(self, thing: bpy.types.Object, view: str = "front", zoom: float = 1.0) -> Steps:
        """Frames an object, from one of VIEWS; drawn when this ends.

        With perspective: without it, 3.4's brush looks for the surface from the front of the box
        that the mesh had when Sculpt Mode began, and goes through what was sculpted out of it.
        """
        corners = np.array([thing.matrix_world @ Vector(corner) for corner in thing.bound_box])
        centre = (corners.min(0) + corners.max(0)) / 2
        eye = self.space.region_3d
        eye.view_perspective = "PERSP"
        eye.view_rotation = VIEWS[view]
        eye.view_location = centre
        eye.view_distance = 2.0 * max(corners.max(0) - corners.min(0)) / zoom
        yield from self.drawn()

    def drawn(self) -> Steps:
        """Lets Blender draw the view anew: matrices, overlays and the screen are up to date."""
        draws = []
        handler = bpy.types.SpaceView3D.draw_handler_add(
            lambda: draws.append(True), (), "WINDOW", "POST_PIXEL")
        try:
            self.area.tag_redraw()
            yield from self.wait_until(lambda: draws)
            yield 0.0
        finally:
            bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")

    def sculpt(self, thing: bpy.types.Object, tool: str = "builtin_brush.Draw", *,
               radius: int = 40, strength: float = 0.5) -> Steps:
        """Sculpt Mode on the object with a tool; the brush's radius in pixels."""
        with self.context():
            if bpy.context.object and bpy.context.object.mode != "OBJECT":
                bpy.ops.object.mode_set(mode="OBJECT")
            bpy.context.view_layer.objects.active = thing
            bpy.ops.object.mode_set(mode="SCULPT")
        yield from self.drawn()
        yield from self.tool(tool, radius=radius, strength=strength)

    def tool(self, tool: str, *, radius: int = 40, strength: float = 0.5) -> Steps:
        """Another tool in Sculpt Mode."""
        with self.context():
            bpy.ops.wm.tool_set_by_id(name=tool, space_type="VIEW_3D")
        yield 0.0
        settings = bpy.context.scene.tool_settings
        unified, brush = settings.unified_paint_settings, settings.sculpt.brush
        unified.use_unified_size = unified.use_unified_strength = False
        brush.size, brush.strength = radius, strength
        yield from self.drawn()

    def last_tab(self) -> Steps:
        """Opens the N-panel at its last tab, which is that of the add-on enabled last.

        3.4 has no way to choose a tab from Python; Ctrl and the wheel go through them.
        """
        self.space.show_region_ui = True
        yield from self.drawn()
        bar = next(region for region in self.area.regions if region.type == "UI")
        yield from self.move((bar.x + bar.width - 10, bar.y + bar.height - 30))
        for _ in range(12):
            yield from self.press("WHEELDOWNMOUSE", ctrl=True)
        yield from self.move(self.middle())
        yield from self.drawn()

    def screenshot(self, path: str) -> Steps:
        """The whole window into a PNG."""
        yield from self.drawn()
        with self.context():
            bpy.ops.screen.screenshot(filepath=path, check_existing=False)
