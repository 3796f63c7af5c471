"""The Khronos validator finds no error in the characters that skinctl makes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from daemons import BIN
from rig_lib import run_node


@pytest.mark.parametrize("vertices, bones", [(1000, 20), (5003, 53), (70_000, 250)])
def test_no_errors(tmp_path: Path, vertices: int, bones: int) -> None:
    path = tmp_path / "body.glb"
    subprocess.run([BIN / "skinctl", "generate", "--vertices", str(vertices), "--bones",
                    str(bones), path], check=True, capture_output=True, timeout=60)
    assert run_node("rig_validate.mjs", [str(path)]) == [{}]
