# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing in the 3D viewport: coloured triangles, text and boxes, on each Blender from 3.4 on.

Called from draw handlers only: there is a GPU then. Changes no data of the user's.
"""

from __future__ import annotations

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

FONT = 0
_NAME_PREFIX = "" if bpy.app.version >= (4, 0, 0) else "3D_"
_NEEDS_DPI = bpy.app.version < (4, 0, 0)


def _shader(name: str):
    return gpu.shader.from_builtin(_NAME_PREFIX + name)


def coloured_triangles(positions: np.ndarray, rgba: np.ndarray, triangles: np.ndarray):
    """A batch of f32 [n,3], f32 [n,4] and u32 [t,3], C-contiguous; for draw_triangles()."""
    return batch_for_shader(_shader("SMOOTH_COLOR"), 'TRIS', {"pos": positions, "color": rgba},
                            indices=triangles)


def draw_triangles(batch) -> None:
    batch.draw(_shader("SMOOTH_COLOR"))


def box(x: float, y: float, width: float, height: float, colour) -> None:
    """A filled rectangle in the region's pixels."""
    corners = ((x, y, 0), (x + width, y, 0), (x + width, y + height, 0), (x, y + height, 0))
    shader = _shader("UNIFORM_COLOR")
    batch = batch_for_shader(shader, 'TRIS', {"pos": corners}, indices=((0, 1, 2), (0, 2, 3)))
    shader.bind()
    shader.uniform_float("color", colour)
    batch.draw(shader)


def gradient(x: float, y: float, width: float, height: float, ramp: np.ndarray) -> None:
    """A bar whose colours are those of ramp [n,3], from left to right."""
    count = len(ramp)
    positions = np.zeros((2 * count, 3), np.float32)
    positions[:, 0] = np.repeat(np.linspace(x, x + width, count), 2)
    positions[:, 1] = y
    positions[1::2, 1] += height
    rgba = np.ones((2 * count, 4), np.float32)
    rgba[:, :3] = np.repeat(ramp, 2, axis=0)
    first = np.arange(0, 2 * count - 2, 2, dtype=np.uint32)[:, None]
    triangles = np.concatenate([first + (0, 1, 2), first + (1, 3, 2)]).astype(np.uint32)
    draw_triangles(coloured_triangles(positions, rgba, triangles))


def _set_size(size: float) -> None:
    if _NEEDS_DPI:
        blf.size(FONT, round(size), 72)
    else:
        blf.size(FONT, size)


def text(x: float, y: float, words: str, size: float, colour) -> None:
    """A line of text whose base line begins at x, y."""
    _set_size(size)
    blf.color(FONT, *colour)
    blf.position(FONT, x, y, 0)
    blf.draw(FONT, words)


def text_width(words: str, size: float) -> float:
    _set_size(size)
    return blf.dimensions(FONT, words)[0]


def scale() -> float:
    """Pixels for one unit of the interface, as the user's preferences have it."""
    return bpy.context.preferences.system.ui_scale


def free_area(area: bpy.types.Area, region: bpy.types.Region) -> tuple[int, int, int, int]:
    """Left, bottom, right, top in the region's pixels: what headers and sidebars leave free."""
    left, bottom, right, top = 0, 0, region.width, region.height
    for other in area.regions:
        if other.type in {'WINDOW', 'HUD', 'XR'} or min(other.width, other.height) <= 1:
            continue
        x, y = other.x - region.x, other.y - region.y
        if other.alignment == 'RIGHT':
            right = min(right, x)
        elif other.alignment == 'LEFT':
            left = max(left, x + other.width)
        elif other.alignment == 'TOP':
            top = min(top, y)
        elif other.alignment == 'BOTTOM':
            bottom = max(bottom, y + other.height)
    return left, bottom, right, top
