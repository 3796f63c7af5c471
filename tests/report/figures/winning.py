"""Weights won back from clean targets: slots by evidence against hop padding, and refit.

The truth is a rig's own weights; a damaged copy of it begins the session. Targets are the truth's
surface in poses with every joint bent by 25 degrees, and the error is measured in other such poses.
"""

from __future__ import annotations

import numpy as np

from ..characters import L, Rig
from ..damage import DAMAGES
from ..lab import Lab
from ..measure import apart, geomean, rms
from ..session import Session

SEEN, UNSEEN = range(4), range(100, 108)
REFIT_SEEN = range(8)
ROUNDING = 5e-7 * L  # what storing weights and positions as float32 alone comes to


def truth(lab: Lab, rig: Rig, seeds: list[int]) -> dict[int, np.ndarray]:
    """The rig's own surface, by the seed of a bend."""
    with Session(lab, rig) as session:
        return {seed: session.evaluate(session.bend(seed)) for seed in seeds}


def unseen_error(session: Session, wanted: dict[int, np.ndarray]) -> np.ndarray:
    """Distances [poses,V] to the truth in the poses that nobody sculpted."""
    return np.array([apart(session.evaluate(session.bend(seed)), wanted[seed]) for seed in UNSEEN])


def sculpt(session: Session, wanted: dict[int, np.ndarray], seeds: list[int],
           **options: object) -> dict:
    """A stroke over the whole surface in each of the poses; pins keep them all."""
    everything = np.arange(len(session.rig.positions))
    for seed in seeds:
        answer = session.stroke(session.bend(seed), everything, wanted[seed], **options)
    return answer


def win_back(lab: Lab, damaged: Rig, wanted: dict, slots: str) -> np.ndarray:
    """Four strokes in four poses, slots kept or by evidence; the unseen error."""
    with Session(lab, damaged, fill="hop") as session:
        sculpt(session, wanted, SEEN, slots=slots)
        return unseen_error(session, wanted)


def measure_evidence(lab: Lab, rigs: list[Rig]) -> dict:
    """4 poses, clean targets, bent joints: mean error in unseen poses against hop padding.

    A case is a character with one of the three damages. Both sides get the same hop padding at the
    session's start and the same four strokes; one keeps these slots, the other asks for slots by
    evidence. A case where hop padding alone wins everything back but for the rounding of float32 is
    told and not counted. The RMS is that of the damage that removes true bones, begun without any
    padding, so that they are in nobody's slots.
    """
    cases, without = [], []
    for rig in rigs:
        wanted = truth(lab, rig, [*SEEN, *UNSEEN])
        for name, damage in DAMAGES.items():
            lab.say(f"evidence: {rig.name}, {name}")
            damaged = damage(rig)
            hop = float(win_back(lab, damaged, wanted, "keep").mean())
            evidence = float(win_back(lab, damaged, wanted, "evidence").mean())
            cases.append({"character": rig.name, "damage": name, "hop": hop, "evidence": evidence,
                          "ratio": evidence / hop, "counts": hop > ROUNDING})
        with Session(lab, DAMAGES["bones removed"](rig), fill="none") as session:
            sculpt(session, wanted, SEEN, slots="evidence")
            without.append(rms(unseen_error(session, wanted)) / L)
    ratios = [case["ratio"] for case in cases if case["counts"]]
    return {"figures": {"evidence4_vs_hop_max": max(ratios),
                        "evidence4_vs_hop_geomean": geomean(ratios),
                        "evidence4_rms_over_L_max": max(without)},
            "detail": {"evidence_cases": cases,
                       "evidence_rms_over_L": dict(zip([rig.name for rig in rigs], without))}}


def measure_refit(lab: Lab, rigs: list[Rig]) -> dict:
    """Refit from 8 poses, started from nearest bones: RMS in unseen poses over L."""
    found = {}
    for rig in rigs:
        lab.say(f"refit: {rig.name}")
        wanted = truth(lab, rig, [*REFIT_SEEN, *UNSEEN])
        with Session(lab, DAMAGES["nearest bone"](rig)) as session:
            poses = [session.bend(seed) for seed in REFIT_SEEN]
            positions = np.concatenate([wanted[seed] for seed in REFIT_SEEN]).astype(np.float32)
            session.call("session.refit", poses=poses, positions=positions)
            found[rig.name] = rms(unseen_error(session, wanted)) / L
    return {"figures": {"refit_unseen_rms_over_L_max": max(found.values())},
            "detail": {"refit_unseen_rms_over_L": found}}
