"""The demo, as ./run demo runs it once everything is built."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from daemons import BIN

ROOT = Path(__file__).resolve().parents[2]


def demo(folder: Path, *arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run(["bash", ROOT / "clients" / "cli" / "demo.sh", BIN,
                           *map(str, arguments)], cwd=folder, capture_output=True, text=True,
                          timeout=120)


def test_it_solves_in_three_poses_and_writes_the_file(folder) -> None:
    done = demo(folder, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert len({stroke["pose"] for stroke in result["strokes"]}) >= 3
    for stroke in result["strokes"]:
        assert stroke["vertices"] > 0 and stroke["ms"]["total"] > 0 and "unreached" in stroke
        assert stroke["residual"]["after"]["mean"] < stroke["residual"]["before"]["mean"]
    source, written = folder / "out/demo/humanoid.glb", folder / "out/demo/humanoid-skind.glb"
    assert source.stat().st_size == written.stat().st_size
    changed = [a != b for a, b in zip(source.read_bytes(), written.read_bytes())]
    assert 0 < sum(changed) < 0.2 * len(changed)


def test_it_prints_a_line_a_stroke_and_the_file(folder) -> None:
    done = demo(folder, folder / "out" / "demo" / "nothing.glb")
    assert done.returncode == 1 and "there is no file" in done.stderr
    subprocess.run([BIN / "skinctl", "generate", "--vertices", "2000", folder / "my body.glb"],
                   check=True, capture_output=True, timeout=60)
    done = demo(folder, folder / "my body.glb")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[2:8]] == list("123456")
    assert lines[-1].startswith("wrote ") and "my body-skind.glb" in lines[-1]


@pytest.mark.parametrize("arguments, status", [(["--loud"], 2), ([__file__], 1)])
def test_what_it_cannot_do_it_says_once(folder, arguments, status) -> None:
    done = demo(folder, *arguments)
    assert done.returncode == status
    talk = [line for line in done.stderr.splitlines() if not line.startswith("started")]
    assert len(talk) == 1, done.stderr
