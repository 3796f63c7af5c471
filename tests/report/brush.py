"""What an artist does to a posed surface: bumps where bones bend, and what weights cannot reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .characters import L, Rig

RADIUS = 0.05 * L
LEAST_VERTICES = 24  # a bump on a coarse mesh is wider
SIZES = (0.005, 0.01, 0.02)  # of L


@dataclass(frozen=True)
class Bump:
    vertices: np.ndarray  # [n]
    targets: np.ndarray  # [n,3]
    size: float  # of L


def normals(rig: Rig, positions: np.ndarray) -> np.ndarray:
    """Unit normals [V,3] of a surface, one for each place (no split at seams)."""
    corners = positions[rig.triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    places = rig.welds
    sums = np.zeros((places.max() + 1, 3))
    for corner in range(3):
        np.add.at(sums, places[rig.triangles[:, corner]], faces)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return (sums / np.maximum(lengths, 1e-20))[places]


def centres(rig: Rig, count: int) -> np.ndarray:
    """Vertices where bones bend (a quarter of the weight at least on other bones), far apart."""
    bent = np.flatnonzero(rig.joints_bent >= 0.25)
    if not len(bent):
        bent = np.argsort(-rig.joints_bent)[:count]
    picked = [int(bent[np.argmax(rig.joints_bent[bent])])]
    nearest = np.full(len(bent), np.inf)
    while len(picked) < min(count, len(bent)):
        apart = np.linalg.norm(rig.positions[bent] - rig.positions[picked[-1]], axis=1)
        nearest = np.minimum(nearest, apart)
        picked.append(int(bent[nearest.argmax()]))
    return np.array(picked)


def reach_of(positions: np.ndarray, centre: int, radius: float = RADIUS) -> tuple:
    """(vertices, falloff 1 to 0) around a vertex of a surface."""
    distance = np.linalg.norm(positions - positions[centre], axis=1)
    radius = max(radius, float(np.partition(distance, LEAST_VERTICES)[LEAST_VERTICES]))
    vertices = np.flatnonzero(distance < radius)
    return vertices, (1 - (distance[vertices] / radius) ** 2) ** 2


def bump(rig: Rig, positions: np.ndarray, centre: int, size: float) -> Bump:
    """A brush pressed once: along the normals, with a smooth falloff. size: of L, minus inwards."""
    vertices, falloff = reach_of(positions, centre)
    outward = normals(rig, positions)[vertices]
    targets = positions[vertices] + size * L * falloff[:, None] * outward
    return Bump(vertices, targets, size)


def bumps(rig: Rig, positions: np.ndarray, count: int) -> list[Bump]:
    """Bumps of all sizes at `count` places where bones bend, in and out by turns."""
    return [bump(rig, positions, centre, size * (-1) ** (number + order))
            for number, centre in enumerate(centres(rig, count))
            for order, size in enumerate(SIZES)]


def swollen(rig: Rig, share: float = 0.01) -> np.ndarray:
    """The rest positions [V,3] of another body: swollen and shrunk by turns, up to share of L.

    Smooth over the surface, and nothing that weights could do to the first body.
    """
    waves = np.sin(rig.positions @ np.array([[9.0, 4, 5], [-3, 8, 7], [5, -6, 9]]).T * np.pi / L)
    return rig.positions + share * L * waves.mean(axis=1)[:, None] * normals(rig, rig.positions)
