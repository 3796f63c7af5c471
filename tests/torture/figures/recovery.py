"""How long it takes until everything is there again after kill -9: 200k vertices, 1,000 strokes of
2,000. From the daemon's start to its answer that lists the session; the slowest of some starts.
"""

from __future__ import annotations

import time

import numpy as np

from .. import work
from ..yard import Daemon, Yard, expect

VERTICES = 200_000
BRUSH = 45  # a stroke has so many rows of so many vertices
DEPTH = 8


def fill(daemon: Daemon, vertices: int, strokes: int) -> tuple[int, str]:
    """A session with that many strokes; its revision, and what it holds."""
    pick = np.random.default_rng(3)
    positions = work.rigs.sheet(vertices)["positions"]
    side = int(np.ceil(np.sqrt(vertices)))
    with daemon.link() as link:
        work.create(link, "large", vertices)
        waiting = []
        for _ in range(strokes):
            # A patch of the sheet.
            corner = pick.integers(0, side - BRUSH - 1, 2)
            rows = (corner[1] + np.arange(BRUSH))[:, None] * side + corner[0] + np.arange(BRUSH)
            some = rows.ravel().astype(np.uint32)
            targets = positions[some] + pick.normal(0, 0.01, (len(some), 3))
            waiting.append(link.send("stroke.apply", {
                "session": "large", "pose": work.POSES[pick.integers(0, 3)], "vertices": some,
                "positions": targets.astype(np.float32), "stream": False, "stiffness": 0.008}))
            if len(waiting) >= DEPTH:
                link.wait(waiting.pop(0))
        revision = [link.wait(id)["revision"] for id in waiting][-1]
        return revision, work.digest(link, "large")


def measure(yard: Yard, seconds: float) -> dict:
    vertices, strokes = yard.pick((VERTICES, 1000), (VERTICES, 100))
    times = []
    with yard.daemon() as daemon:
        revision, held = fill(daemon, vertices, strokes)
        for _ in range(yard.pick(5, 2)):
            daemon.kill()
            began = time.monotonic()
            daemon.launch()
            with daemon.link() as link:
                rows = link.call("session.list")["sessions"]
                times.append((time.monotonic() - began) * 1e3)
                expect([(row["session"], row["revision"]) for row in rows] == [("large", revision)],
                       f"after a restart there is {rows}")
        with daemon.link() as link:
            expect(work.digest(link, "large") == held, "other bytes after a restart")
            info = link.call("session.info", {"session": "large"})
            expect(info["undo_steps"] == strokes, f"{info['undo_steps']} steps can be undone")
            link.call("history.undo", {"session": "large"})
    yard.say(f"  {min(times):.0f} to {max(times):.0f} ms, {bytes_of(daemon) >> 20} MiB of files")
    return {"recovery_ms": round(max(times), 1)}


def bytes_of(daemon: Daemon) -> int:
    return sum(path.stat().st_size for path in daemon.state.rglob("*") if path.is_file())
