"""Curves over a logarithmic axis, as SVG."""

from __future__ import annotations

from html import escape

import numpy as np

from .sweeps import Sweep

WIDTH, HEIGHT = 560, 330
LEFT, RIGHT, TOP, BOTTOM = 76, 12, 12, 44
COLOURS = ("#1b6ca8", "#c8553d", "#4f8a3c", "#8a5aa8", "#8c6d1f")


def ticks(low: float, high: float) -> list[float]:
    """Powers of ten in [low, high], with 2 and 5 times them where there are few."""
    tens = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for steps in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = [step * 10.0**ten for ten in tens for step in steps
                 if low * 0.999 <= step * 10.0**ten <= high * 1.001]
        if len(found) >= 4:
            break
    return found


class Axis:
    """Takes values to pixels by their logarithm."""

    def __init__(self, values: list[float], start: float, end: float) -> None:
        low, high = min(values), max(values)
        if high < 1.5 * low:
            low, high = low / 1.25, high * 1.25
        self.low, self.high, self.start, self.end = low, high, start, end

    def __call__(self, value: float) -> float:
        share = np.log(value / self.low) / np.log(self.high / self.low)
        return float(self.start + share * (self.end - self.start))


def svg(sweep: Sweep) -> str:
    """The sweep's curves; a ring is where the daemon puts itself."""
    points = [point for curve in sweep.curves for point in curve.points + [curve.mark] if point]
    x = Axis([point[0] for point in points], LEFT + 8, WIDTH - RIGHT - 8)
    y = Axis([point[1] for point in points], HEIGHT - BOTTOM - 8, TOP + 8)
    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(sweep.title)}">']
    for value in ticks(x.low, x.high):
        parts.append(f'<line class="grid" x1="{x(value):.1f}" x2="{x(value):.1f}" y1="{TOP}" '
                     f'y2="{HEIGHT - BOTTOM}"/><text x="{x(value):.1f}" y="{HEIGHT - BOTTOM + 16}" '
                     f'text-anchor="middle">{value:g}</text>')
    for value in ticks(y.low, y.high):
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(value):.1f}" '
                     f'y2="{y(value):.1f}"/><text x="{LEFT - 6}" y="{y(value) + 4:.1f}" '
                     f'text-anchor="end">{value:g}</text>')
    for curve, colour in zip(sweep.curves, COLOURS):
        line = " ".join(f"{x(px):.1f},{y(py):.1f}" for px, py in curve.points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" '
                     'stroke-width="2.2"/>')
        parts += [f'<circle cx="{x(px):.1f}" cy="{y(py):.1f}" r="2.6" fill="{colour}"><title>'
                  f'{px:g}: {py:.3g}</title></circle>' for px, py in curve.points]
        if curve.mark:
            parts.append(f'<circle cx="{x(curve.mark[0]):.1f}" cy="{y(curve.mark[1]):.1f}" r="7" '
                         f'fill="none" stroke="{colour}" stroke-width="2.2"/>')
    parts.append(f'<text x="{(LEFT + WIDTH) / 2}" y="{HEIGHT - 6}" text-anchor="middle">'
                 f'{escape(sweep.across)}</text><text transform="translate(13 {HEIGHT / 2}) '
                 f'rotate(-90)" text-anchor="middle">{escape(sweep.upright)}</text></svg>')
    keys = "".join(f'<span><i style="background:{colour}"></i>{escape(curve.name)}</span>'
                   for curve, colour in zip(sweep.curves, COLOURS))
    return f'{"".join(parts)}<div class="key">{keys}</div>'
