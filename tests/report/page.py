"""The page: one file of HTML with all pictures in it."""

from __future__ import annotations

import base64
from html import escape
from statistics import mean

from .chart import svg
from .figures import FIGURES
from .measure import STATISTICS
from .pictures import COUNT_COLOURS, FULL_HEAT, REACH_COLOURS, Picture
from .raster import HEAT
from .sweeps import Sweep

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fafaf8; margin: 0 auto;
       max-width: 1290px; padding: 24px; }
h1 { font-size: 26px; margin: 0 0 4px } h2 { font-size: 20px; margin: 40px 0 6px }
h3 { font-size: 16px; margin: 22px 0 4px } p { max-width: 860px; margin: 6px 0 12px }
table { border-collapse: collapse; margin: 8px 0 16px; font-variant-numeric: tabular-nums }
th, td { padding: 3px 10px; text-align: right; border-bottom: 1px solid #e3e3de }
th { font-weight: 600 } th:first-child, td:first-child, td.text, th.text { text-align: left }
td.ok { color: #2d7a35; font-weight: 600 } td.missed { color: #b3261e; font-weight: 600 }
td.best { background: #e4f1e2 } td.worse { color: #b3261e } th[colspan] { text-align: center }
.row { display: flex; gap: 6px } figure { margin: 0 0 8px } img { display: block }
figcaption { font-size: 13px; text-align: center } figcaption b { display: block }
.side { writing-mode: vertical-rl; transform: rotate(180deg); text-align: center; font-size: 13px;
        color: #666; min-width: 22px }
.key { font-size: 13px; margin: 2px 0 10px } .key span { margin-right: 16px; white-space: nowrap }
.key i { display: inline-block; width: 12px; height: 12px; border-radius: 2px; margin-right: 5px;
         vertical-align: -1px }
.charts { display: grid; grid-template-columns: repeat(auto-fit, minmax(480px, 1fr));
          gap: 8px 28px }
svg text { font: 12px system-ui, sans-serif; fill: #555 } .grid { stroke: #e6e6e0 }
.heat { display: inline-block; width: 220px; height: 12px; border-radius: 2px; margin: 0 8px;
        vertical-align: -2px }
details { margin: 4px 0 } summary { cursor: pointer; color: #1b6ca8 }
"""


def number(value: float) -> str:
    """Short, whatever its size."""
    if value != 0 and abs(value) < 0.01:
        digits, power = f"{value:.1e}".split("e")
        return f"{digits.removesuffix('.0')}e{int(power)}"
    return f"{value:.4g}"


def images(pictures: list[Picture], side: str = "", titled: bool = True) -> str:
    parts = [f'<div class="side">{escape(side)}</div>'] if side else []
    for picture in pictures:
        data = base64.b64encode(picture.png).decode()
        title = f"<b>{escape(picture.title)}</b>" if titled and picture.title else ""
        parts.append(f'<figure><img alt="{escape(picture.title)}" '
                     f'src="data:image/png;base64,{data}">'
                     f"<figcaption>{title}{escape(picture.note)}</figcaption></figure>")
    return f'<div class="row">{"".join(parts)}</div>'


def colour(rgb: tuple) -> str:
    return f"rgb({', '.join(str(int(part)) for part in rgb)})"


def key(entries: list[tuple[tuple, str]]) -> str:
    spans = (f'<span><i style="background:{colour(rgb)}"></i>{escape(text)}</span>'
             for rgb, text in entries)
    return f'<div class="key">{"".join(spans)}</div>'


def figures_table(values: dict[str, float], missing: dict[str, str]) -> str:
    rows = []
    for figure in FIGURES:
        bound = ("≥ " if figure.at_least else "≤ ") + number(figure.wanted)
        if figure.key in values:
            reached = figure.is_reached(values[figure.key])
            state, value = ("ok" if reached else "missed"), number(values[figure.key])
        else:
            state, value = "missed", "not measured: " + missing.get(figure.key, "")
        rows.append(f'<tr><td>{figure.key}</td><td class="text">{escape(figure.text)}</td>'
                    f"<td>{escape(value)}</td><td>{bound}</td>"
                    f'<td class="{state}">{state}</td></tr>')
    return ('<table><tr><th>figure</th><th class="text">what</th><th>reached</th><th>wanted</th>'
            f'<th></th></tr>{"".join(rows)}</table>')


def notes(detail: dict) -> str:
    """What stands beside the figures: the settings in which they are not reached, too."""
    parts = []
    if "bumps_cm_vs_thesis" in detail:
        parts.append("<b>Bumps.</b> The figure is that of four slots chosen by evidence. In the "
                     "very slots that the thesis's method has, the exact solve comes to "
                     f'{detail["bumps_cm_vs_thesis_slots_kept_max"]:.2f} (worst character) and '
                     f'{detail["bumps_cm_vs_thesis_slots_kept_median"]:.2f} (median).')
    if detail.get("guard_p99"):
        listed = "; ".join(f"{escape(name)}: {max(found.values()):.2f}"
                           for name, found in detail["guard_p99"].items())
        parts.append(f"<b>Guard.</b> Worst character by setting: {listed}. The figure is the last.")
    if "evidence_cases" in detail:
        left = [case for case in detail["evidence_cases"] if not case["counts"]]
        if left:
            told = ", ".join(f'{case["character"]} ({case["damage"]})' for case in left)
            parts.append("<b>Evidence.</b> Not counted, as hop padding alone wins all back but for "
                         f"the rounding of float32: {escape(told)}.")
    if "out_and_back_shown_other_poses" in detail:
        most = max(detail["out_and_back_shown_other_poses"].values())
        parts.append("<b>Out and back.</b> Where each stroke begins from the surface shown, "
                     f"float32 twenty times over leaves up to {number(most)} of L in poses not "
                     "edited.")
    if "noise_other_damages" in detail:
        told = "; ".join(f"{escape(name)}: {ratio:.2f}"
                         for name, ratio in detail["noise_other_damages"].items())
        parts.append("<b>Noise.</b> The figure is that of weights that were smoothed away, at "
                     "μ = 0.01. After the other damages the wanted change is itself rough, and "
                     f"smoothing it costs: {told}.")
    if "rest_cases" in detail:
        missing = [case["ratio"] for case in detail["rest_cases"] if not case["counts"]]
        parts.append("<b>Rest positions.</b> From weights that are nothing but the nearest bone, "
                     f"which the figure leaves out, the ratio goes up to {max(missing):.2f}.")
    if "reduce4_clips_on_random" in detail:
        parts.append("<b>Reduction.</b> Cut by frames of the clips alone, MakeHuman comes to "
                     f'{detail["reduce4_clips_on_random"]:.2f} times the error of the largest four '
                     "in random poses: poses unlike those named are not looked after.")
    if parts:
        parts.insert(0, "What exactly a figure is had to be settled where words leave it open. For "
                     "those below that was done after results had been seen; the other readings "
                     "stand beside them, also where they miss.")
    return "".join(f"<p>{part}</p>" for part in parts)


def method_table(rows: dict) -> str:
    """Millimetres on a body of 2 m; green: the best of a column, red: worse than before."""
    columns = [(kind, name) for kind in ("edited", "other") for name in STATISTICS]
    best = {column: min(rows[row][column[0]][column[1]] for row in rows) for column in columns}
    head = "".join(f"<th>{name}</th>" for _, name in columns)
    body = []
    for row, found in rows.items():
        cells = []
        for kind, name in columns:
            value = found[kind][name]
            mark = (' class="best"' if value <= 1.02 * best[kind, name] + 5e-6 else
                    ' class="worse"' if value > 1.001 * rows["before"][kind][name] else "")
            cells.append(f"<td{mark}>{1e3 * value:.2f}</td>")
        body.append(f"<tr><td>{escape(row)}</td>{''.join(cells)}</tr>")
    return (f'<table><tr><th></th><th colspan="4">edited pose</th><th colspan="4">other poses</th>'
            f"</tr><tr><th></th>{head}</tr>{''.join(body)}</table>")


def over_characters(found: dict, job: str, unit: str) -> dict:
    """The mean over characters of each statistic, but the largest of the largest."""
    rows: dict = {}
    listed = [jobs[job][unit] for jobs in found.values()]
    for row in listed[0]:
        rows[row] = {kind: {name: (max if name == "largest" else mean)(
            [character[row][kind][name] for character in listed]) for name in STATISTICS}
            for kind in ("edited", "other")}
    return rows


def in_all_units(units: dict) -> str:
    return f"<p>Scene in cm</p>{method_table(units['cm'])}" + "".join(
        f"<details><summary>scene in {unit}</summary>{method_table(units[unit])}</details>"
        for unit in ("m", "mm"))


def scenes_table(found: dict, job: str) -> str:
    """Mean error in the edited pose by method and scene: who cares about the unit."""
    units = ("m", "cm", "mm")
    by_unit = {unit: over_characters(found, job, unit) for unit in units}
    rows = "".join(
        f"<tr><td>{row}</td>" + "".join(f"<td>{1e3 * by_unit[unit][row][kind]['mean']:.2f}</td>"
                                        for kind in ("edited", "other") for unit in units) + "</tr>"
        for row in ("before", "thesis", "exact"))
    head = "".join(f"<th>{unit}</th>" for unit in units)
    return ('<table><tr><th></th><th colspan="3">edited pose, mean</th>'
            '<th colspan="3">other poses, mean</th></tr>'
            f"<tr><th>scene in</th>{head}{head}</tr>{rows}</table>")


def tables(found: dict) -> str:
    jobs = list(next(iter(found.values())))
    parts = []
    for job in jobs:
        units = {unit: over_characters(found, job, unit) for unit in ("m", "cm", "mm")}
        parts.append(f"<h3>{escape(job.capitalize())}: mean over all characters (and the largest "
                     f"of all)</h3>{in_all_units(units)}{scenes_table(found, job)}")
    for character, own in found.items():
        inner = "".join(f"<h3>{escape(character)}: {escape(job)}</h3>{in_all_units(own[job])}"
                        for job in jobs)
        parts.append(f"<details><summary>{escape(character)}</summary>{inner}</details>")
    return "".join(parts)


def chapter(slots: list[Picture], reach: list[Picture], limb: dict[str, list[Picture]],
            name: str) -> str:
    names = {1: "one bone", 2: "two", 3: "three", 4: "four", 5: "more"}
    gradient = ", ".join(colour(stop) for stop in HEAT)
    scale = (f'<div class="key">distance to what is wanted: 0<span class="heat" style="background:'
             f'linear-gradient(90deg, {gradient})"></span>{1e3 * FULL_HEAT:g} mm on a body of 2 m; '
             "under each picture mean and largest over the limb</div>")
    return (
        f"<h2>The thesis's chapter 8 again</h2><h3>Influences per vertex, {escape(name)}</h3>"
        + key([(COUNT_COLOURS[count], text) for count, text in names.items()]) + images(slots)
        + "<h3>One bone's reach, after the slots were filled</h3>"
        + key([(REACH_COLOURS["weight"], "moved by this bone"),
               (REACH_COLOURS["free"], "has it in a free slot: weight 0, a stroke may use it"),
               (REACH_COLOURS["none"], "out of its reach")]) + images(reach)
        + "<h3>A limb that is too soft, sculpted in one pose</h3><p>An artist sculpts it as it "
        "should be, with more muscle than weights can make. Thesis and this get one stroke in one "
        "pose, the scene is in centimetres; the last column sculpts the second pose too and lets "
        "rest positions move.</p>" + scale
        + images(limb["edited"], "the pose that is edited")
        + images(limb["edited, heat"], "its error", False)
        + images(limb["other"], "a pose not edited")
        + images(limb["other, heat"], "its error", False))


def sweeps_part(found: list[Sweep]) -> str:
    parts = [f"<div><h3>{escape(sweep.title)}</h3>{svg(sweep)}<p><b>Default: "
             f"{escape(sweep.default)}.</b> {escape(sweep.reason)}</p></div>" for sweep in found]
    return ("<h2>Strengths, and where the defaults come from</h2>"
            f'<div class="charts">{"".join(parts)}</div>')


def compose(title: str, values: dict, missing: dict, detail: dict, body: list[str]) -> str:
    return ('<!doctype html><html lang="en"><meta charset="utf-8"><title>skind: what it finds'
            f"</title><style>{STYLE}</style><h1>skind: the weights that it finds</h1>"
            f"<p>{escape(title)}</p><h2>Figures</h2>{figures_table(values, missing)}"
            f"{notes(detail)}{''.join(body)}</html>")
