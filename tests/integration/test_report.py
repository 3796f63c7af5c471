"""`./run report --quick`: one character, every figure measured, a page that needs nothing else."""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from daemons import BIN, ROOT
from report.characters import FILES
from report.figures import FIGURES
from report.lab import ASSETS

SECONDS = 600  # generous, for the sanitizers' builds; it takes 15
HAS_ASSETS = all((ASSETS / file).exists() for file in FILES.values())
# Of MakeHuman's files alone, so not measured without them.
OF_MAKEHUMAN = {"noise_fine_meshes", "reduce4_clips", "reduce4_random"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def run(folder: Path) -> subprocess.CompletedProcess:
    """The package as ./run calls it, on the build under test."""
    return subprocess.run(
        [sys.executable, "-m", "report", "--quick", "--out", folder], cwd=ROOT, text=True,
        capture_output=True, timeout=SECONDS,
        env={**os.environ, "PYTHONPATH": str(ROOT / "tests"), "SKIND_BUILD": str(BIN.parent)})


@pytest.fixture(scope="module")
def results(run: subprocess.CompletedProcess, folder: Path) -> dict:
    assert run.returncode in (0, 1), run.stderr
    return json.loads((folder / "results.json").read_text())


def test_every_figure_is_a_number_or_told_as_missing(results) -> None:
    missing = set() if HAS_ASSETS else OF_MAKEHUMAN
    assert set(results["missing"]) == missing
    for figure in FIGURES:
        if figure.key not in missing:
            assert isinstance(results[figure.key], (int, float)), figure.key
            assert results[figure.key] == results[figure.key], figure.key
    assert results["quick"] is True and len(results["characters"]) == 1


def test_the_figures_that_hold_on_any_character(results) -> None:
    """Those that one character can answer for; the rest is for the whole run."""
    assert results["worse_vertices"] == 0
    assert results["drift20"] <= 1.001
    assert results["out_and_back_over_L"] <= 1e-6
    assert results["fix_kept20"] >= 0.98
    assert results["evidence4_vs_hop_max"] <= 0.1
    assert results["rest4_vs_weights_max"] <= 0.1
    assert results["refit_unseen_rms_over_L_max"] <= 1e-4


def test_the_closing_table_and_the_status_agree(run, results) -> None:
    rows = {line.split()[0]: line.split()[-1] for line in run.stdout.splitlines()}
    reached = [figure.key in results and figure.is_reached(results[figure.key])
               for figure in FIGURES]
    for figure, good in zip(FIGURES, reached):
        assert (rows[figure.key] == "ok") == good, run.stdout
    assert run.returncode == (0 if all(reached) else 1)


def test_the_page_stands_alone(run, results, folder) -> None:
    page = (folder / "report.html").read_text()
    links = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert links and all(link.startswith("data:image/png;base64,") for link in links)
    assert "http" not in page.replace("http-equiv", "")
    for link in links:
        assert base64.b64decode(link.split(",", 1)[1])[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(links) >= 24  # slots, reach, and a limb in two poses with its heat-maps
    for text in ("edited pose", "other poses", "chapter 8", *(figure.key for figure in FIGURES)):
        assert text in page


def test_the_tables_have_every_method_in_every_scene(results) -> None:
    (jobs,) = results["detail"]["tables"].values()
    for units in jobs.values():
        assert set(units) == {"m", "cm", "mm"}
        for rows in units.values():
            assert set(rows) >= {"before", "thesis", "exact", "exact + guard", "exact + pins",
                                 "+ slots", "+ smooth", "+ rest"}
            for row in rows.values():
                for kind in ("edited", "other"):
                    told = row[kind]
                    assert 0 <= told["mean"] <= told["largest"]
                    assert told["95th"] <= told["99th"] <= told["largest"]
        # The thesis's constants are in scene units, ours are not.
        one, other = units["m"]["exact"], units["mm"]["exact"]
        assert one["edited"]["mean"] == pytest.approx(other["edited"]["mean"], rel=0.02)
