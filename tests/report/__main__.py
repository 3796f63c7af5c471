"""The command: measures, draws, writes out/report/report.html and results.json.

Progress goes to stderr, the closing table to stdout. Exit status: 0 where every figure is reached,
1 where one is missed or could not be measured.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from . import page, pictures, sweeps, tables
from .characters import Rig, everyone
from .figures import FIGURES
from .lab import ASSETS, ROOT, Lab

TABLES_NEED = {"pins", "guards", "slots.evidence", "smoothing", "residual.rest", "stiffness.auto"}

METHODS_TEXT = """<h2>Method by method</h2><p>Distances to what the artist wants, in millimetres on
a body of 2 m. <b>Weights won back:</b> the rig lost true bones from its weights, the artist sculpts
what the rig's own weights do. <b>Bumps:</b> the rig's own weights; the artist wants bumps of 1 % of
L at the joints in every pose, which weights alone cannot make.</p><p>Thesis, exact and guard get
one stroke in one pose; from “exact + pins” on it is four poses, the edited one is the first.
“+ slots” and “+ smooth” add to the row above, “+ rest” is “+ slots” with rest positions that move.
Green is the best of a column, red is worse than before the stroke.</p>"""


def measure_figures(lab: Lab, rigs: list[Rig]) -> tuple[dict, dict, dict]:
    """(values by key, why others are missing, everything else that was measured)."""
    values: dict[str, float] = {}
    missing: dict[str, str] = {}
    detail: dict = {}
    done: set = set()
    for figure in FIGURES:
        lacking = [name for name in figure.needs if name not in lab.capabilities]
        if lacking:
            missing[figure.key] = f"needs capability {', '.join(lacking)}"
            continue
        if figure.measure not in done:
            done.add(figure.measure)
            found = figure.measure(lab, rigs)
            values.update(found["figures"])
            detail.update(found["detail"])
        if figure.key not in values:
            missing[figure.key] = "needs characters that are not there"
    return values, missing, detail


def closing_table(values: dict, missing: dict) -> str:
    lines = [f"{'figure':29} {'reached':>11} {'wanted':>10}"]
    for figure in FIGURES:
        wanted = ("≥ " if figure.at_least else "≤ ") + page.number(figure.wanted)
        if figure.key in values:
            state = "ok" if figure.is_reached(values[figure.key]) else "missed"
            value = page.number(values[figure.key])
        else:
            state, value = f"not measured: {missing[figure.key]}", "-"
        lines.append(f"{figure.key:29} {value:>11} {wanted:>10}  {state}")
    return "\n".join(lines)


def describe(rigs: list[Rig]) -> str:
    listed = ", ".join(f"{rig.name} ({len(rig.positions)} vertices, {len(rig.parents)} bones)"
                       for rig in rigs)
    kind = "Real characters" if rigs[0].real else "The generated character (no real ones are there)"
    return (f"{kind}: {listed}. Each is measured as if its rest mesh had a diagonal L of 2 m. "
            "Poses are clips' frames and turns of every joint by 25°.")


def draw(lab: Lab, rigs: list[Rig]) -> str:
    lab.say("pictures")
    slots = pictures.slot_pictures(lab, rigs)
    reach = pictures.reach_pictures(lab, rigs)
    return page.chapter(slots, reach, pictures.limb_pictures(lab, rigs),
                        pictures.subject(lab, rigs).name)


def report(arguments: argparse.Namespace) -> int:
    folder = Path(arguments.out)
    folder.mkdir(parents=True, exist_ok=True)
    with Lab(quick=arguments.quick) as lab:
        only = arguments.characters or (["fox"] if arguments.quick else None)
        rigs = everyone(lab, only)
        values, missing, detail = measure_figures(lab, rigs)
        body = []
        if TABLES_NEED <= lab.capabilities:
            body.append(draw(lab, rigs))
            detail["tables"] = tables.measure(lab, rigs)
            body.append(METHODS_TEXT + page.tables(detail["tables"]))
            if not arguments.quick:
                found = sweeps.measure(lab, rigs)
                detail["sweeps"] = {
                    sweep.title: {curve.name: curve.points for curve in sweep.curves}
                    for sweep in found}
                body.append(page.sweeps_part(found))
        lab.say("writing")
        (folder / "report.html").write_text(
            page.compose(describe(rigs), values, missing, detail, body))
        results = {**values, "characters": [rig.name for rig in rigs], "missing": missing,
                   "quick": arguments.quick, "detail": detail}
        text = json.dumps(results, indent=1, ensure_ascii=False)
        (folder / "results.json").write_text(text + "\n")
    print(closing_table(values, missing))
    print(f"the page: {folder / 'report.html'}")
    reached = [figure.key in values and figure.is_reached(values[figure.key]) for figure in FIGURES]
    return 0 if all(reached) else 1


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run report", description=__doc__)
    parser.add_argument("--quick", action="store_true",
                        help="one character and no sweeps: whether it all works")
    parser.add_argument("--characters", nargs="+", metavar="NAME",
                        help="only these of the characters in " + str(ASSETS.name))
    parser.add_argument("--out", default=str(ROOT / "out" / "report"), help="the folder written to")
    return report(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
