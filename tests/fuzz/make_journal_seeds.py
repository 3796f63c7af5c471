"""Writes the first inputs of fuzz_journal: a small session's file, and one with a log beside it.

usage: make_journal_seeds.py SKIND CORPUS    with SKIND the daemon's program
The fuzzer's reader takes every checksum for 0 (fuzz_journal.c), so they are 0 here. Pages are as
small as SQLite makes them, so that most of an input is ours.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "clients" / "blender_addon"), str(ROOT / "tests" / "fuzz")]

from core import Link  # noqa: E402
from make_seeds import BEND, CREATE, S, STROKE, TALKS  # noqa: E402

PAGE_BYTES = 512
WAL = 2  # a file's format in its bytes 18 and 19


def play(program: str, folder: Path) -> Path:
    """A session with a bit of everything; its file after a clean stop."""
    daemon = subprocess.Popen([program, "--socket", str(folder / "s")], stderr=subprocess.DEVNULL,
                              env={"XDG_STATE_HOME": str(folder / "state"), "HOME": str(folder)})
    while not (folder / "s").exists():
        time.sleep(0.01)
    with Link.connect(folder / "s") as link:
        for method, params in [(CREATE[0], {**CREATE[1], "durability": "full"}), BEND, STROKE,
                               *TALKS["rest"][1:2], *TALKS["guards"][:1],
                               ("stroke.apply", {**STROKE[1], "residual": "shape", "sequence": 2}),
                               *TALKS["edits"][:1], ("history.undo", S)]:
            link.call(method, params)
    daemon.terminate()
    daemon.wait(10)
    return next((folder / "state").rglob("s-*.skind"))


def shrink(path: Path) -> None:
    """Checksums to 0, small pages."""
    with sqlite3.connect(path, isolation_level=None) as db:
        db.execute("PRAGMA journal_mode=DELETE")
        for (table,) in db.execute("SELECT name FROM sqlite_master WHERE type='table'").fetchall():
            for column in [row[1] for row in db.execute(f"PRAGMA table_info({table})")]:
                if column in ("sum", "chain"):
                    db.execute(f"UPDATE {table} SET {column}=0")
        db.execute(f"PRAGMA page_size={PAGE_BYTES}")
        db.execute("VACUUM")
    db.close()
    content = bytearray(path.read_bytes())
    content[18] = content[19] = WAL
    path.write_bytes(content)


def add_log(path: Path) -> bytes:
    """Another undo, in a log that is not folded in."""
    db = sqlite3.connect(path, isolation_level=None)
    db.execute("PRAGMA wal_autocheckpoint=0")
    db.execute("UPDATE state SET revision=revision+1, position=position-1")
    log = Path(f"{path}-wal").read_bytes()
    db.close()
    return log


def seed(file: bytes, log: bytes = b"") -> bytes:
    return struct.pack("<I", len(file)) + file + log


def write(program: str, corpus: Path) -> None:
    corpus.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="skf-") as name:
        path = Path(name) / "seed.skind"
        shutil.copy(play(program, Path(name)), path)
        shrink(path)
        file = path.read_bytes()
        (corpus / "file").write_bytes(seed(file))
        (corpus / "log").write_bytes(seed(file, add_log(path)))
        (corpus / "empty").write_bytes(seed(b""))


if __name__ == "__main__":
    write(sys.argv[1], Path(sys.argv[2]))
