"""A small z-buffer renderer: shaded triangles seen along one direction, as PNG bytes."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

FINER = 2  # drawn so many times as large, then averaged
PAPER = np.array([250, 250, 248.0])
LIGHT = np.array([-0.35, 0.55, 0.76])


@dataclass(frozen=True)
class Camera:
    """Looks along -`towards`; `centre` is in the middle of the picture, `height` fills it."""

    centre: np.ndarray
    height: float  # metres
    towards: np.ndarray = (0.0, 0.0, 1.0)
    up: np.ndarray = (0.0, 1.0, 0.0)
    pixels: tuple[int, int] = (300, 340)

    def fitted(self, positions: np.ndarray) -> "Camera":
        """The same view, moved and scaled so that the points just fill the picture, which gets no
        taller than it has to be."""
        seen = positions @ self.axes().T
        low, high = seen.min(axis=0), seen.max(axis=0)
        wide, tall = 1.06 * (high - low)[:2]
        width, height = self.pixels
        height = min(height, int(np.ceil(width * tall / wide)))
        return replace(self, centre=(low + high) / 2 @ self.axes(), pixels=(width, height),
                       height=max(tall, wide * height / width))

    def axes(self) -> np.ndarray:
        """Rows: right, up, towards the eye."""
        eye = np.array(self.towards, float) / np.linalg.norm(self.towards)
        right = np.cross(self.up, eye)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(eye, right), eye])


def draw(camera: Camera, positions: np.ndarray, triangles: np.ndarray, normals: np.ndarray,
         colours: np.ndarray, blend: bool = True) -> bytes:
    """A picture of a surface whose vertices have colours [V,3] (0 to 255).

    blend: colours run into each other between vertices; else each vertex colours its own cell.
    """
    width, height = (FINER * side for side in camera.pixels)
    axes = camera.axes()
    seen = (positions - camera.centre) @ axes.T
    facing = normals @ axes.T
    scale = height / camera.height
    screen = np.stack([width / 2 + seen[:, 0] * scale, height / 2 - seen[:, 1] * scale], 1)
    depth = seen[:, 2]
    image = np.tile(PAPER, (height, width, 1))
    front = np.full((height, width), -np.inf)
    corners = screen[triangles]
    low = np.floor(corners.min(axis=1)).astype(int)
    high = np.ceil(corners.max(axis=1)).astype(int) + 1
    inside = (high[:, 0] > 0) & (high[:, 1] > 0) & (low[:, 0] < width) & (low[:, 1] < height)
    low, high = np.maximum(low, 0), np.minimum(high, [width, height])
    for index in np.flatnonzero(inside):
        _fill(image, front, corners[index], low[index], high[index], triangles[index], depth,
              facing, colours, blend)
    image = image.reshape(height // FINER, FINER, width // FINER, FINER, 3).mean(axis=(1, 3))
    return encode(image)


def _fill(image: np.ndarray, front: np.ndarray, corners: np.ndarray, low: np.ndarray,
          high: np.ndarray, triangle: np.ndarray, depth: np.ndarray, facing: np.ndarray,
          colours: np.ndarray, blend: bool) -> None:
    """One triangle into the picture, where it is in front of what is there."""
    a, b, c = corners
    area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    if abs(area) < 1e-9:
        return
    x = np.arange(low[0], high[0]) + 0.5
    y = (np.arange(low[1], high[1]) + 0.5)[:, None]
    second = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
    third = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
    shares = np.stack([1 - second - third, second, third], -1)
    z = shares @ depth[triangle]
    window = front[low[1]:high[1], low[0]:high[0]]
    shown = (shares.min(axis=-1) >= -1e-6) & (z > window)
    if not shown.any():
        return
    window[shown] = z[shown]
    part = shares[shown]
    normal = part @ facing[triangle]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    lit = 0.42 + 0.58 * np.clip(normal @ LIGHT, 0, 1)
    lit *= 0.55 + 0.45 * np.clip(normal[:, 2], 0, 1) ** 0.5
    paint = part @ colours[triangle] if blend else colours[triangle[part.argmax(axis=1)]]
    image[low[1]:high[1], low[0]:high[0]][shown] = np.minimum(paint * lit[:, None] * 1.12, 255)


def encode(image: np.ndarray) -> bytes:
    """[h,w,3] as a PNG of 256 colours, a third of the bytes of one with all."""
    picture = Image.fromarray(np.clip(image, 0, 255).astype(np.uint8), "RGB")
    out = io.BytesIO()
    picture.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(out, "PNG", optimize=True)
    return out.getvalue()


HEAT = np.array([[214, 218, 214], [253, 231, 110], [240, 120, 50], [170, 20, 40],
                 [70, 0, 50]], float)


def heat(values: np.ndarray, full: float) -> np.ndarray:
    """[V,3] colours of values from 0 (grey) to `full` (dark red)."""
    at = np.clip(values / full, 0, 1) * (len(HEAT) - 1)
    lower = np.minimum(at.astype(int), len(HEAT) - 2)
    share = (at - lower)[:, None]
    return HEAT[lower] * (1 - share) + HEAT[lower + 1] * share
