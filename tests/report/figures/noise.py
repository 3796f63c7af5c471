"""Noisy brushes: what smoothing the change of the weights saves in other poses."""

from __future__ import annotations

import numpy as np

from ..characters import FINE, FILES, L, Rig, load
from ..damage import DAMAGES, smoothed
from ..lab import ASSETS, Lab
from ..session import Session
from .winning import UNSEEN, truth, unseen_error

NOISE = 5e-4 * L
SMOOTH = 0.01  # on these meshes; see the sweep
ALL_SMOOTH = (0.0, 0.003, 0.01, 0.03)


def noise(rig: Rig) -> np.ndarray:
    """[V,3] random offsets whose root mean square length is 0.5 permille of L; seams agree."""
    places = np.random.default_rng(3).normal(size=(rig.welds.max() + 1, 3))
    return (places * NOISE / np.sqrt(3))[rig.welds]


def unseen_by_smoothing(lab: Lab, rig: Rig, start: Rig, values: tuple) -> dict[float, float]:
    """Mean error in other poses after one noisy stroke over the whole surface, by mu."""
    wanted = truth(lab, rig, [0, *UNSEEN])
    targets, everything = wanted[0] + noise(rig), np.arange(len(rig.positions))
    found = {}
    with Session(lab, start) as session:
        for smooth in values:
            session.stroke(session.bend(0), everything, targets, smooth=smooth)
            found[smooth] = float(unseen_error(session, wanted).mean())
            session.undo()
    return found


def fine_meshes(lab: Lab) -> list[Rig]:
    """MakeHuman's body, and the same after a step of subdivision; none without the assets."""
    names = {"makehuman": FILES["makehuman"], "makehuman, subdivided": FINE}
    return [load(lab, name, ASSETS / file) for name, file in names.items()
            if (ASSETS / file).exists()]


def measure(lab: Lab, rigs: list[Rig]) -> dict:
    """Brush noise of 0.5 permille of L, one pose, smoothing on: mean error in other poses against
    none, MakeHuman (the larger ratio of two resolutions).

    The weights to be won back were smoothed away. After the other two damages the change that is
    wanted is itself rough, and smoothing it costs: told (detail), not counted.
    """
    errors, others = {}, {}
    for rig in fine_meshes(lab):
        lab.say(f"brush noise: {rig.name}")
        errors[rig.name] = unseen_by_smoothing(lab, rig, smoothed(rig), ALL_SMOOTH)
        for name, damage in DAMAGES.items():
            if damage is not smoothed:
                found = unseen_by_smoothing(lab, rig, damage(rig), (0.0, SMOOTH))
                others[f"{rig.name}, {name}"] = found[SMOOTH] / found[0.0]
    if not errors:
        return {"figures": {}, "detail": {}}
    ratios = [found[SMOOTH] / found[0.0] for found in errors.values()]
    return {"figures": {"noise_fine_meshes": max(ratios)},
            "detail": {"noise_by_smoothing": {name: {str(mu): value for mu, value in found.items()}
                                              for name, found in errors.items()},
                       "noise_other_damages": others}}
