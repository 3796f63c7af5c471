"""`./run torture --quick`: a little of every torture, each figure within its bound."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from daemons import BIN, ROOT
from torture.figures import FIGURES, PARTS, QUICK_SECONDS, SECONDS


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess, dict]:
    """The package as ./run calls it, on the build under test; with what it wrote."""
    folder = tmp_path_factory.mktemp("torture")
    done = subprocess.run(
        [sys.executable, "-m", "torture", "--quick", "--out", folder], cwd=ROOT, text=True,
        capture_output=True, timeout=2 * QUICK_SECONDS,
        env={**os.environ, "PYTHONPATH": str(ROOT / "tests"), "SKIND_BUILD": str(BIN.parent)})
    assert (folder / "results.json").exists(), done.stderr
    return done, json.loads((folder / "results.json").read_text())


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.key)
def test_each_figure_is_within_its_bound(run, figure) -> None:
    done, results = run
    assert figure.is_reached(results[figure.key], quick=True), done.stdout + done.stderr


def test_the_file_has_each_figure_with_its_bound(run) -> None:
    done, results = run
    keys = {figure.key for figure in FIGURES}
    assert keys < set(results) and set(results["bounds"]) == keys
    assert all(bound["holds"] for bound in results["bounds"].values())
    assert results["quick"] and results["missing"] == {} and results["machine"]
    assert done.returncode == 0, done.stdout


def test_the_parts_have_room_in_the_time_that_all_may_take() -> None:
    assert sum(part.seconds for part in PARTS) <= 0.9 * SECONDS
    assert sum(part.quick_seconds for part in PARTS) <= 0.9 * QUICK_SECONDS


@pytest.mark.parametrize("value, holds", [(1.1, True), (1.1001, False), (None, False)])
def test_a_figure_knows_its_bound(value, holds) -> None:
    ratio = next(figure for figure in FIGURES if figure.key == "stalled_reader_p99_ratio")
    assert ratio.is_reached(value, quick=False) == holds
    assert ratio.is_reached(1.2, quick=True)


def test_every_fuzzer_has_inputs_that_are_replayed() -> None:
    """The corpus is kept small: it is read in every preset's unit tests."""
    folder = ROOT / "tests" / "fuzz"
    for target in folder.glob("fuzz_*.c"):
        assert list((folder / "corpus" / target.stem.removeprefix("fuzz_")).iterdir())
    assert sum(path.stat().st_size for path in (folder / "corpus").rglob("*")
               if path.is_file()) < 600 << 10
