"""On a sanitizer build, the solver's Python tests in a process that has the sanitizer's runtime."""

import os
import pathlib
import subprocess
import sys

import pytest

import solver_build

HERE = pathlib.Path(__file__).parent


@pytest.mark.parametrize(
    "name",
    [
        "test_solver_oracle.py", "test_solver_terms_oracle.py", "test_slots_oracle.py",
        "test_evidence_oracle.py",
    ],  # fmt: skip
)
def test_under_the_sanitizer(name: str) -> None:
    runtime = solver_build.missing_runtime()
    if runtime is None:
        pytest.skip("this build's library loads as it is")
    # Python's own allocations at exit are not ours to answer for.
    environment = dict(os.environ, LD_PRELOAD=runtime, ASAN_OPTIONS="detect_leaks=0")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(HERE / name)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    assert "passed" in done.stdout and "skipped" not in done.stdout
