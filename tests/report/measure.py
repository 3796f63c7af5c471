"""Numbers out of distances."""

from __future__ import annotations

import numpy as np

STATISTICS = ("mean", "95th", "99th", "largest")


def apart(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distances [...] of points [...,3]."""
    return np.linalg.norm(np.asarray(points, float) - others, axis=-1)


def statistics(distances: np.ndarray) -> dict[str, float]:
    flat = np.ravel(distances)
    return {"mean": float(flat.mean()), "95th": float(np.percentile(flat, 95)),
            "99th": float(np.percentile(flat, 99)), "largest": float(flat.max())}


def geomean(values: list[float]) -> float:
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-30)))))


def rms(distances: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(distances))))


def bisect(low: float, high: float, wanted: float, measure, rounds: int = 12) -> float:
    """x in [low, high], evenly by its logarithm, where the growing measure(x) is as wanted."""
    for _ in range(rounds):
        middle = float(np.sqrt(low * high))
        if measure(middle) < wanted:
            low = middle
        else:
            high = middle
    return float(np.sqrt(low * high))
