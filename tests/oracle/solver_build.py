"""Where the solver's test library lies, and what has to be loaded before it.

A library that was built with a sanitizer can only be loaded into a process that started with the
sanitizer's runtime. Test files that need the library are skipped in other processes;
test_solver_sanitized.py runs them in one that has it.
"""

import os
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("SKIND_BUILD", ROOT / "build" / "release"))
LIBRARY = BUILD / "lib" / "libskd_solver_test.so"


def missing_runtime() -> str | None:
    """The sanitizer runtime that LD_PRELOAD must name, if it is not here already."""
    needed = subprocess.run(["ldd", str(LIBRARY)], capture_output=True, text=True, check=True)
    found = re.search(r"=> (\S*/lib[at]san\.so\S*)", needed.stdout)
    loaded = pathlib.Path("/proc/self/maps").read_text()
    if found is None or os.path.realpath(found.group(1)) in loaded:
        return None
    return found.group(1)
