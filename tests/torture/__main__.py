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
from pathlib import Path

from . import ROOT
from .figures import FIGURES, GROUPS
from .yard import Failed, Yard


def describe_machine() -> str:
    model = next((line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text()
                  .splitlines() if line.startswith("model name")), platform.machine())
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return (f"{len(os.sched_getaffinity(0))} cores of {model}, {memory:.0f} GiB, "
            f"{platform.system()} {platform.release()}")


def torture(yard: Yard, keys: set[str]) -> tuple[dict, dict]:
    """(values by key, why others are missing)."""
    values: dict = {}
    missing: dict[str, str] = {}
    for group in GROUPS:
        wanted = [figure.key for figure in group.figures if figure.key in keys]
        if not wanted:
            continue
        yard.say(", ".join(wanted))
        try:
            found = group.measure(yard, yard.pick(group.seconds, group.quick_seconds))
            values.update({key: found.get(key) for key in wanted})
        except Failed as failure:
            missing.update(dict.fromkeys(wanted, str(failure)))
        except Exception as error:  # one figure's trouble must not hide the others
            traceback.print_exc()
            missing.update(dict.fromkeys(wanted, f"{type(error).__name__}: {error}"))
    return values, missing


def tell(value: object) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:,.4g}" if value < 100 else f"{value:,.0f}"


def closing_table(values: dict, missing: dict, keys: set[str], quick: bool) -> tuple[str, bool]:
    lines, good = [f"{'figure':25} {'reached':>12} {'wanted':>10}"], True
    for figure in FIGURES:
        if figure.key not in keys:
            continue
        value = values.get(figure.key)
        reached = figure.is_reached(value, quick)
        good &= reached
        state = "ok" if reached else "missed"
        if figure.key in missing:
            state = f"failed: {missing[figure.key]}"
        lines.append(f"{figure.key:25} {tell(value):>12} {figure.wanted(quick):>10}  {state}")
    return "\n".join(lines), good


def main() -> int:
    parser = argparse.ArgumentParser(prog="./run torture", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a little of everything: 3 minutes")
    parser.add_argument("--only", metavar="KEY,...", help="only these figures")
    parser.add_argument("--out", default=str(ROOT / "out" / "torture"), help="folder written to")
    arguments = parser.parse_args()
    keys = {figure.key for figure in FIGURES}
    if arguments.only:
        unknown = set(arguments.only.split(",")) - keys
        if unknown:
            parser.error(f"there is no figure {', '.join(sorted(unknown))}")
        keys = set(arguments.only.split(","))
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))  # a thousand clients are one process
    began = time.monotonic()
    with Yard(arguments.quick) as yard:
        values, missing = torture(yard, keys)
        yard.say("done")
    folder = Path(arguments.out)
    folder.mkdir(parents=True, exist_ok=True)
    results = {figure.key: values.get(figure.key) for figure in FIGURES if figure.key in keys}
    results["machine"] = describe_machine()
    (folder / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    text, good = closing_table(values, missing, keys, arguments.quick)
    print(text)
    print(f"{time.monotonic() - began:.0f} s on {results['machine']}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
