"""The command: tortures, writes out/torture/results.json.

Progress goes to stderr, the closing table to stdout. Exit status: 0 where every figure is reached,
1 where one is missed or could not be measured.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import sys
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path

from . import ROOT
from .figures import FIGURES, PARTS, QUICK_SECONDS, Part
from .yard import Failed, Yard


def describe_machine() -> str:
    model = next((line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text()
                  .splitlines() if line.startswith("model name")), platform.machine())
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return (f"{len(os.sched_getaffinity(0))} cores of {model}, {memory:.0f} GiB, "
            f"{platform.system()} {platform.release()}")


@dataclass
class Run:
    """What was measured so far."""

    values: dict = field(default_factory=dict)  # by key
    missing: dict[str, str] = field(default_factory=dict)  # why others were not
    seconds: dict[str, float] = field(default_factory=dict)  # by part

    def measure(self, yard: Yard, part: Part, keys: set[str]) -> None:
        wanted = [figure.key for figure in part.figures if figure.key in keys]
        began = time.monotonic()
        yard.say(", ".join(wanted))
        try:
            found = part.measure(yard, yard.pick(part.seconds, part.quick_seconds))
            self.values.update({key: found[key] for key in wanted})
        except Failed as failure:
            self.missing.update(dict.fromkeys(wanted, str(failure)))
        except Exception as error:  # one figure's trouble must not hide the others
            traceback.print_exc()
            self.missing.update(dict.fromkeys(wanted, f"{type(error).__name__}: {error}"))
        self.seconds[part.name] = round(time.monotonic() - began, 1)


def tell(value: object) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:,.4g}" if value < 100 else f"{value:,.0f}"


def closing_table(results: dict) -> str:
    lines = [f"{'figure':25} {'reached':>12} {'wanted':>10}"]
    for key, bound in results["bounds"].items():
        why = results["missing"].get(key)
        state = f"failed: {why}" if why else "ok" if bound["holds"] else "missed"
        lines.append(f"{key:25} {tell(results[key]):>12} {bound['wanted']:>10}  {state}")
    return "\n".join([*lines, f"on {results['machine']}"])


def parse_arguments() -> tuple[argparse.Namespace, set[str]]:
    """The arguments, and the keys that are asked for."""
    keys = {part.name: {figure.key for figure in part.figures} for part in PARTS}
    every = set().union(*keys.values())
    parser = argparse.ArgumentParser(prog="./run torture", description=__doc__)
    parser.add_argument("--quick", action="store_true",
                        help=f"a little of everything: at most {QUICK_SECONDS / 60:.0f} minutes")
    parser.add_argument("--only", metavar="NAME,...",
                        help=f"only these figures, or these parts: {', '.join(keys)}")
    parser.add_argument("--out", default=str(ROOT / "out" / "torture"), help="folder written to")
    arguments = parser.parse_args()
    if not arguments.only:
        return arguments, every
    names = arguments.only.split(",")
    unknown = [name for name in names if name not in keys and name not in every]
    if unknown:
        parser.error(f"there is no figure or part {', '.join(unknown)}")
    return arguments, set().union(*(keys.get(name, {name}) for name in names))


def main() -> int:
    arguments, keys = parse_arguments()
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))  # a thousand clients are one process
    run, began = Run(), time.monotonic()
    with Yard(arguments.quick) as yard:
        for part in PARTS:
            if any(figure.key in keys for figure in part.figures):
                run.measure(yard, part, keys)
        yard.say("done")
    run.values["seconds"] = round(time.monotonic() - began, 1)
    figures = [figure for figure in FIGURES if figure.key in keys | {"seconds"}]
    results = {
        **{figure.key: run.values.get(figure.key) for figure in figures},
        "bounds": {figure.key: {
            "wanted": figure.wanted(arguments.quick),
            "holds": figure.is_reached(run.values.get(figure.key), arguments.quick)}
            for figure in figures},
        "missing": run.missing,
        "quick": arguments.quick,
        "part_seconds": run.seconds,
        "machine": describe_machine(),
    }
    folder = Path(arguments.out)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    print(closing_table(results))
    return 0 if all(bound["holds"] for bound in results["bounds"].values()) else 1


if __name__ == "__main__":
    sys.exit(main())
