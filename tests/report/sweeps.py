"""Stiffness, guard and smoothing, each over a range: curves, and the defaults that follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .brush import bump, centres
from .characters import Rig
from .damage import bones_removed, smoothed
from .figures.guarding import SOFTEST, STIFFEST, changes
from .figures.noise import fine_meshes, noise, unseen_by_smoothing
from .figures.winning import SEEN, UNSEEN, sculpt, truth, unseen_error
from .lab import Lab
from .measure import bisect, geomean
from .session import Session

STIFFNESS = (1e-5, 3e-5, 1e-4, 3e-4, 5e-4, 1e-3, 3e-3, 8e-3, 0.03, 0.1)
GUARD = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
SMOOTH = (0.001, 0.003, 0.01, 0.03, 0.1)


@dataclass(frozen=True)
class Curve:
    name: str
    points: list[tuple[float, float]]
    mark: tuple[float, float] | None = None  # what the daemon chooses itself


@dataclass(frozen=True)
class Sweep:
    title: str
    across: str
    upright: str
    curves: list[Curve]
    default: str
    reason: str


def stiffness_errors(lab: Lab, rig: Rig) -> dict[str, dict]:
    """Mean error in unseen poses by situation and stiffness; None is the daemon's own choice, and
    under "chosen" what that was."""
    found: dict[str, dict] = {}
    wanted = truth(lab, rig, [*SEEN, *UNSEEN])
    noisy = {seed: surface + noise(rig) for seed, surface in wanted.items()}
    situations = {
        "clean, four poses": (bones_removed(rig), wanted, SEEN, {"slots": "evidence"}),
        "noisy, four poses": (bones_removed(rig), noisy, SEEN, {"slots": "evidence"}),
        "clean, one pose": (smoothed(rig), wanted, SEEN[:1], {}),
        "noisy, one pose": (smoothed(rig), noisy, SEEN[:1], {}),
    }
    for name, (start, targets, seeds, options) in situations.items():
        found[name] = {}
        for stiffness in (None, *STIFFNESS):
            told = {} if stiffness is None else {"stiffness": stiffness}
            with Session(lab, start) as session:
                answer = sculpt(session, targets, seeds, **options, **told)
                found[name][stiffness] = float(unseen_error(session, wanted).mean())
                if stiffness is None:
                    found[name]["chosen"] = answer["stiffness"]
    return found


def bump_errors(lab: Lab, rig: Rig) -> dict:
    """Bumps out of reach in one pose: change of other poses, and edit error, by stiffness."""
    found: dict = {stiffness: [0.0, 0.0] for stiffness in (None, *STIFFNESS)}
    chosen = []
    with Session(lab, rig) as session:
        pose = session.bend(0)
        surface = session.evaluate(pose)
        others = [session.bend(seed) for seed in UNSEEN]
        begin = {other: session.evaluate(other) for other in others}
        for number, centre in enumerate(centres(rig, 4)):
            press = bump(rig, surface, centre, 0.01 * (-1) ** number)
            for stiffness in found:
                told = {} if stiffness is None else {"stiffness": stiffness}
                answer = session.stroke(pose, press.vertices, press.targets, **told)
                found[stiffness][0] += float(changes(session, others, begin, press.vertices).mean())
                found[stiffness][1] += float(answer["residual"]["after"]["mean"])
                if stiffness is None:
                    chosen.append(answer["stiffness"])
                session.undo()
    return {"chosen": geomean(chosen), **found}


def over_rigs(tables: list[dict], keys: tuple) -> list[tuple[float, float]]:
    """Geometric mean over characters, in millimetres."""
    return [(key, 1e3 * geomean([table[key] for table in tables])) for key in keys]


def sweep_stiffness(lab: Lab, rigs: list[Rig]) -> tuple[Sweep, Sweep]:
    tables, presses = [], []
    for rig in rigs:
        lab.say(f"sweep of the stiffness: {rig.name}")
        tables.append(stiffness_errors(lab, rig))
        presses.append(bump_errors(lab, rig))
    curves, losses = [], []
    for name in tables[0]:
        rows = [table[name] for table in tables]
        points = over_rigs(rows, STIFFNESS)
        own = 1e3 * geomean([row[None] for row in rows])
        best = min(value for _, value in points)
        losses.append(f"{name} {own / best:.2f} ({own:.2g} mm)")
        curves.append(Curve(name, points, (geomean([row["chosen"] for row in rows]), own)))
    reason = ("No single value serves all: the lowest points of these curves lie decades apart. "
              "What the daemon chooses from the leftover of each stroke (the ring on each curve) "
              "comes to, against the best point of its curve: " + ", ".join(losses) +
              " times the error.")
    won = Sweep("κ: error in unseen poses when weights are won back", "stiffness κ",
                "mean error in unseen poses, mm", curves, "chosen from the data, stroke by stroke",
                reason)
    kinds = ("change of other poses", "edit error")
    both = []
    for index, kind in enumerate(kinds):
        rows = [{key: value[index] if key != "chosen" else value for key, value in press.items()}
                for press in presses]
        both.append(Curve(kind, over_rigs(rows, STIFFNESS),
                          (geomean([row["chosen"] for row in rows]),
                           1e3 * geomean([row[None] for row in rows]))))
    change, edit = dict(both[0].points), dict(both[1].points)
    text = (f"From κ = 0.0005 to 0.03 the edit error grows {edit[0.03] / edit[5e-4]:.2f} times "
            f"while the change of other poses falls to {change[0.03] / change[5e-4]:.2f}: what "
            "weights cannot reach asks for stiffness, up to the bound of 0.03.")
    return won, Sweep("κ: bumps that weights cannot reach", "stiffness κ",
                      "mm, sum over four bumps", both, "chosen from the data, at most 0.03", text)


def guard_at(lab: Lab, rig: Rig, strengths: tuple) -> dict[float, tuple[float, float]]:
    """(99th percentile of the change of other poses against no guard at equal edit error, edit
    error against no guard at equal stiffness) by strength."""
    pairs: dict[float, list] = {strength: [] for strength in strengths}
    edits = {strength: [0.0, 0.0] for strength in strengths}
    with Session(lab, rig) as session:
        frames = [session.set_frame(index) for index in range(len(rig.frames))]
        session.call("guard.set", poses=frames[0::2], count=32)
        others = frames[1::2]
        begin = {pose: session.evaluate(pose) for pose in others}
        pose = session.bend(0)
        surface = session.evaluate(pose)

        for number, centre in enumerate(centres(rig, 4)):
            press = bump(rig, surface, centre, 0.01 * (-1) ** number)

            def stroke(**options: float) -> tuple[float, np.ndarray]:
                answer = session.stroke(pose, press.vertices, press.targets, slots="evidence",
                                        **options)
                moved = changes(session, others, begin, press.vertices)
                session.undo()
                return float(answer["residual"]["after"]["mean"]), moved

            plain = stroke(stiffness=0.008, guard=0.0)[0]
            for strength in strengths:
                error, moved = stroke(stiffness=0.008, guard=strength)
                equal = bisect(SOFTEST, STIFFEST, error,
                               lambda kappa: stroke(stiffness=kappa, guard=0.0)[0], 8)
                pairs[strength].append((moved, stroke(stiffness=equal, guard=0.0)[1]))
                edits[strength][0] += error
                edits[strength][1] += plain
    found = {}
    for strength, parts in pairs.items():
        guarded, free = (np.concatenate(side) for side in zip(*parts))
        found[strength] = (float(np.percentile(guarded, 99) / np.percentile(free, 99)),
                           edits[strength][0] / edits[strength][1])
    return found


def sweep_guard(lab: Lab, rigs: list[Rig]) -> Sweep | None:
    tables = []
    for rig in rigs:
        if rig.frames:
            lab.say(f"sweep of the guard: {rig.name}")
            tables.append(guard_at(lab, rig, GUARD))
    if not tables:
        return None
    saved, cost = ([(strength, geomean([table[strength][kind] for table in tables]))
                    for strength in GUARD] for kind in (0, 1))
    at, price = dict(saved), dict(cost)
    share = 100 * (1 - at[0.3]) / (1 - at[10.0])
    paid = 100 * (price[0.3] - 1) / (price[10.0] - 1)
    reason = (f"At equal edit error the 99th percentile in other poses falls to {at[0.3]:.2f} at "
              f"λ = 0.3, {at[1.0]:.2f} at 1 and {at[3.0]:.2f} at 3, while the edit error at one "
              f"stiffness grows {price[0.3]:.2f}, {price[1.0]:.2f} and {price[3.0]:.2f} times. "
              f"There is no knee: 0.3 has {share:.0f} % of what 10 saves for {paid:.0f} % of its "
              "price; more is for who cares more for the other poses than for the edit.")
    return Sweep("λ: what a guard saves, and what it costs", "guard λ", "times no guard",
                 [Curve("99th percentile in other poses, at equal edit error", saved),
                  Curve("edit error, at equal stiffness", cost)], "0.3", reason)


def sweep_smooth(lab: Lab, rigs: list[Rig]) -> Sweep:
    curves, best = [], {}
    for name, group in (("fine meshes (MakeHuman)", fine_meshes(lab)),
                        ("coarse meshes (the others)",
                         [rig for rig in rigs if rig.name != "makehuman"])):
        tables = []
        for rig in group:
            lab.say(f"sweep of the smoothing: {rig.name}")
            found = unseen_by_smoothing(lab, rig, smoothed(rig), (0.0, *SMOOTH))
            tables.append({mu: value / found[0.0] for mu, value in found.items()})
        if tables:
            points = [(mu, geomean([table[mu] for table in tables])) for mu in SMOOTH]
            curves.append(Curve(name, points))
            best[name] = min(points, key=lambda point: point[1])
    told = "; ".join(f"{name}: best at μ = {mu:g} with {value:.2f}"
                     for name, (mu, value) in best.items())
    return Sweep("μ: noisy brush, error in other poses", "smoothing μ", "times no smoothing",
                 curves, "off; 0.01 on a fine mesh when the brush was noisy",
                 f"{told}; at μ = 0.1 they come to " +
                 " and ".join(f"{curve.points[-1][1]:.2f}" for curve in curves) +
                 ". Smoothing that the brush did not ask for costs more than it saves on coarse "
                 "meshes, so it is asked for.")


def measure(lab: Lab, rigs: list[Rig]) -> list[Sweep]:
    guard = sweep_guard(lab, rigs)
    return [*sweep_stiffness(lab, rigs), *([guard] if guard else []), sweep_smooth(lab, rigs)]
