"""What the documents say to paste does run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from daemons import BIN

ROOT = Path(__file__).resolve().parents[2]


def blocks(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text("utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def environment(folder: Path):
    """A user's shell: skinctl on the path, a socket of its own, stopped at the end."""
    values = {**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}",
              "SKIND_SOCKET": str(folder / "skind.sock"),
              "PYTHONPATH": str(ROOT / "clients" / "blender_addon")}
    yield values
    subprocess.run(["skinctl", "stop"], env=values, check=True, capture_output=True, timeout=60)


def paste(script: str, folder: Path, environment: dict) -> str:
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", script], cwd=folder, env=environment,
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_protocols_examples(folder, environment) -> None:
    shell = blocks("protocol/PROTOCOL.md", "sh")
    lines, stroke = shell
    assert '"id":2,"result":{"sessions":[]' in paste(lines, folder, environment)
    assert '"revision":1' in paste(stroke, folder, environment).replace(" ", "")
    (example,) = blocks("protocol/PROTOCOL.md", "python")
    done = subprocess.run([sys.executable, "-c", example], cwd=folder, env=environment,
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("3 {") and "chunks" in done.stdout


def watch_and_end(folder: Path, environment: dict, *options: str) -> None:
    """Runs skinctl watch as somebody at a terminal would, who ends it after a look.

    One SIGTERM and nothing else: timeout(1) sends a SIGCONT behind it. As skinctl ends,
    LeakSanitizer stops its threads with ptrace, and a SIGCONT in that moment takes the stop back
    that it waits for, for ever.
    """
    log = folder / "watch.log"
    with log.open("w") as talk:
        watch = subprocess.Popen(["skinctl", "watch", *options], cwd=folder, env=environment,
                                 stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=talk)
    try:
        deadline = time.monotonic() + 60
        while "watching" not in log.read_text():
            assert watch.poll() is None and time.monotonic() < deadline, log.read_text()
            time.sleep(0.02)
        watch.terminate()
        assert watch.wait(60) == 0, log.read_text()
    finally:
        watch.kill()
        watch.wait()


def test_the_readmes_commands_by_hand(folder, environment) -> None:
    by_hand = next(block for block in blocks("README.md", "sh") if "skinctl load" in block)
    before, after = by_hand.split("skinctl watch")
    paste(before, folder, environment)
    watch_and_end(folder, environment)
    paste("#" + after.replace("skinctl stop", "true"), folder, environment)
    assert (folder / "sculpted.glb").stat().st_size == (folder / "body.glb").stat().st_size


def test_the_notes_are_the_documented_ones() -> None:
    header = (ROOT / "server" / "rig" / "rig.h").read_text("utf-8")
    section = (ROOT / "protocol" / "PROTOCOL.md").read_text("utf-8").split("## What is mended")[1]
    documented = re.findall(r"^\| `(\w+)` \|", section.split("\n## ")[0], re.MULTILINE)
    assert documented == re.findall(r'X\([A-Z_]+,\s*"(\w+)"', header)


def test_the_readmes_commands_for_sessions(folder, environment) -> None:
    """With the session that is made by hand."""
    [by_hand] = [block for block in blocks("README.md", "sh") if "skinctl load" in block]
    [sessions] = [block for block in blocks("README.md", "sh") if "session save" in block]
    paste(by_hand.split("skinctl undo")[0], folder, environment)
    before, watch, after = re.split(r"^skinctl watch(.*?)  .*$", sessions, flags=re.MULTILINE)
    said = paste(before, folder, environment)
    assert "whole" in said and "body" in said and "try" in said
    watch_and_end(folder, environment, *watch.split())
    paste(after.split("./run torture")[0], folder, environment)
