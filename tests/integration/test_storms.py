"""Storms: many connections do everything at once, drop, lie and flood; the daemon stays whole.

Each storm is seeded, so a failure can be had again. After it, what the daemon promises is checked:
revisions without gaps, weights on the simplex, undo back to the first bit, no descriptor kept.
"""

from __future__ import annotations

import json
import os
import random
import socket
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
import schemas
from core import Link, SkindError
from core.wire import encode_request
from daemons import BIN, Daemon
from followers import next_update

QUICK = os.environ.get("SKIND_QUICK", "") not in ("", "0")
STEPS = 300 if QUICK else 1200
SHEETS = {"small": 400, "large": 20_000}

# What a request may be refused with while others close, cancel and undo under it.
EXPECTED = {"cancelled", "no_session", "no_pose", "name_taken", "busy", "nothing_to_undo",
            "nothing_to_redo", "unsupported", "shutting_down"}


class Observer:
    """Listens to sessions and holds their revisions against each other: no gap, no repeat."""

    def __init__(self, daemon: Daemon, lines: bool) -> None:
        self.revisions: dict[str, int] = {}
        self.updates = 0
        self._check = schemas.watch()
        self._attaching: dict[int, str] = {}
        self.link = Link.connect(daemon.socket, name="observer", lines=lines, watch=self._watch)

    def _watch(self, direction: str, raw: dict) -> None:
        self._check(direction, raw)
        if direction == "sent":
            if raw["method"] == "session.attach":
                self._attaching[raw["id"]] = raw["params"]["session"]
        elif raw.get("id") in self._attaching:
            name = self._attaching.pop(raw["id"])
            if "result" in raw:
                assert raw["result"]["revision"] >= self.revisions.get(name, 0)
                self.revisions[name] = raw["result"]["revision"]
        elif raw.get("method") == "session.update":
            name, revision = raw["params"]["session"], raw["params"]["revision"]
            assert raw["params"]["since"] == self.revisions[name], f"{name} jumps to {revision}"
            self.revisions[name] = revision
            self.updates += 1
        elif raw.get("method") == "session.closed":
            del self.revisions[raw["params"]["session"]]

    def step(self, names: list[str]) -> None:
        for name in names:
            if name not in self.revisions and name not in self._attaching.values():
                self.link.send("session.attach", {"session": name})
        self.link.pump()


class Storm:
    """Random requests on random connections, without waiting for most of the answers."""

    def __init__(self, daemon: Daemon, folder: Path, seed: int) -> None:
        self.daemon = daemon
        self.folder = folder
        self.random = random.Random(seed)
        self.links: list[Link] = []
        self.asked: dict[Link, list[int]] = {}
        self.outcomes: dict[str, int] = {}
        self.rigs = {name: rigs.sheet(count) for name, count in SHEETS.items()}
        self.file = folder / "body.glb"
        subprocess.run([BIN / "skinctl", "generate", "--vertices", "1000", str(self.file)],
                       check=True, capture_output=True, timeout=60)

    def connect(self) -> None:
        link = Link.connect(self.daemon.socket, lines=self.random.random() < 0.3,
                            watch=schemas.watch())
        self.links.append(link)
        self.asked[link] = []

    def request(self, lines: bool) -> tuple[str, dict]:
        pick = self.random
        # The large one's arrays do not fit into a line.
        name = pick.choice(["small", "small", "small" if lines else "large", "body"])
        who = {"session": name}
        count = {"small": 400, "large": 20_000, "body": 900}[name]
        some = np.unique(np.array([pick.randrange(count) for _ in range(40)], np.uint32))
        towards = np.array([pick.uniform(-1, 1) for _ in range(len(some) * 3)], np.float32)
        kind = pick.choices(
            ["stroke", "sweep", "set", "undo", "redo", "evaluate", "weights", "mesh", "pose", "attach",
             "detach", "info", "list", "stats", "create", "close", "export"],
            [8, 3, 3, 5, 4, 4, 3, 1, 4, 4, 2, 2, 2, 1, 5, 1, 2])[0]
        if kind == "stroke":
            return "stroke.apply", {**who, "pose": pick.choice(["rest", "bent"]), "vertices": some,
                                    "positions": towards.reshape(-1, 3),
                                    "stream": pick.random() < 0.5,
                                    "constraint": pick.choice(["simplex", "affine", "simplex"]),
                                    "stiffness": pick.choice([0, 0.008, 10])}
        if kind == "sweep":
            everyone = np.arange(count, dtype=np.uint32)
            return "stroke.apply", {**who, "pose": "rest", "vertices": everyone,
                                    "positions": np.full((count, 3), pick.random(), np.float32)}
        if kind == "set":  # the first slot of each vertex has a bone
            row = np.array([pick.uniform(0.9995, 1.0005), 0, 0, 0], np.float32)
            return "weights.set", {**who, "vertices": some, "weights": np.tile(row, (len(some), 1))}
        if kind == "pose":
            return "pose.set", {**who, "pose": "bent", "bend": pick.uniform(-90, 90)}
        if kind == "evaluate":
            return "pose.evaluate", {**who, "pose": "bent", "vertices": some}
        if kind == "weights":
            return "weights.get", {**who, **({"vertices": some} if pick.random() < 0.5 else {})}
        if kind == "create":
            made = {"file": str(self.file)} if name == "body" else self.rigs[name]
            return "session.create", {"name": name, **made}
        if kind == "export":
            return "session.export", {**who, "path": str(self.folder / f"{pick.randrange(3)}.glb")}
        if kind in ("list", "stats"):
            return {"list": "session.list", "stats": "stats"}[kind], {}
        names = {"undo": "history.undo", "redo": "history.redo", "mesh": "mesh.get",
                 "attach": "session.attach", "detach": "session.detach", "info": "session.info",
                 "close": "session.close"}
        return names[kind], who

    def step(self) -> None:
        pick = self.random
        if len(self.links) < 8:
            self.connect()
        link = pick.choice(self.links)
        action = pick.random()
        if action < 0.03:
            self.drop(link)
        elif action < 0.12 and self.asked[link]:
            link.cancel(pick.choice(self.asked[link]))
        elif action < 0.20:
            self.take_in(link)
        elif not (link.exchange.lines and link.exchange.unanswered > 60):
            self.asked[link].append(link.send(*self.request(link.exchange.lines)))

    def drop(self, link: Link) -> None:
        """Hangs up: between messages, within one, or after saying that no more comes."""
        pick = self.random
        how = pick.choice(["now", "within", "half"])
        link.socket.setblocking(True)
        if how == "within":
            pieces = encode_request(99, *self.request(link.exchange.lines),
                                    lines=link.exchange.lines)
            raw = b"".join(bytes(piece) for piece in pieces)
            link.socket.settimeout(1)
            try:
                link.socket.sendall(raw[:pick.randrange(1, len(raw))])
            except OSError:  # it is not read, because too much of its own waits to be read
                pass
        elif how == "half":
            link.socket.shutdown(socket.SHUT_WR)
        link.close()
        self.links.remove(link)
        del self.asked[link]

    def take_in(self, link: Link, seconds: float = 0) -> None:
        link.pump(seconds)
        for id in list(self.asked[link]):
            try:
                if link.exchange.take(id) is None:
                    continue
                name = "ok"
            except SkindError as error:
                name = error.name
                assert name in EXPECTED, error
            self.asked[link].remove(id)
            self.outcomes[name] = self.outcomes.get(name, 0) + 1

    def settle(self) -> None:
        """Every request of a connection that is still there gets its one answer."""
        deadline = time.monotonic() + 60
        for link in self.links:
            while self.asked[link]:
                assert time.monotonic() < deadline, f"no answer to {self.asked[link]}"
                self.take_in(link, 0.01)
            link.close()
        self.links.clear()


def check_session(link: Link, name: str, anchors: dict[str, np.ndarray]) -> None:
    """What holds for a session at any time, and that undo leads back to the bit."""
    who = {"session": name}
    info = link.call("session.info", who)
    assert not info["busy"]
    before = link.call("weights.get", who)
    weights = before["weights"].astype(np.float64)
    assert np.isfinite(weights).all()
    assert np.abs(weights.sum(1) - 1).max() <= 1e-7
    revision = before["revision"]
    for _ in range(info["undo_steps"]):
        revision += 1
        assert link.call("history.undo", who)["revision"] == revision
    with pytest.raises(SkindError, match="nothing to undo"):
        link.call("history.undo", who)
    np.testing.assert_array_equal(link.call("weights.get", who)["weights"], anchors[name])
    for _ in range(info["undo_steps"]):
        revision += 1
        assert link.call("history.redo", who)["revision"] == revision
    np.testing.assert_array_equal(link.call("weights.get", who)["weights"], before["weights"])


def anchors_of(storm: Storm, link: Link) -> dict[str, np.ndarray]:
    """The weights that each session begins with."""
    anchors = {}
    for name in ("small", "large", "body"):
        made = {"file": str(storm.file)} if name == "body" else storm.rigs[name]
        link.call("session.create", {"name": name, **made})
        anchors[name] = link.call("weights.get", {"session": name})["weights"].copy()
        link.call("session.close", {"session": name})
    return anchors


def descriptors(daemon: Daemon) -> int:
    return len(os.listdir(f"/proc/{daemon.process.pid}/fd"))


def wait_until(condition, what: str, seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


def take_steps(storm: Storm, count: int, every: int) -> list[Observer]:
    """The storm's steps, and between them those of two observers, who have hung up at the end."""
    observers = [Observer(storm.daemon, lines) for lines in (False, True)]
    for number in range(count):
        storm.step()
        if number % every == 0:
            for observer in observers:
                observer.step(["small", "large", "body"])
    storm.settle()
    for observer in observers:
        observer.link.pump(0.05)
        observer.link.close()
    return observers


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_everything_at_once(start, folder, seed) -> None:
    daemon = start("--workers", str(1 + seed))
    storm = Storm(daemon, folder, seed)
    with daemon.link() as link:
        anchors = anchors_of(storm, link)
    wait_until(lambda: daemon_is_alone(daemon), "the first connections stayed")
    before = descriptors(daemon)
    observers = take_steps(storm, STEPS // 3, 4)
    assert storm.outcomes["ok"] > STEPS / 60
    with daemon.link() as link:
        assert observers[0].updates > 0 and observers[1].updates > 0
        for row in link.call("session.list")["sessions"]:
            check_session(link, row["session"], anchors)
            link.call("session.close", {"session": row["session"]})
    wait_until(lambda: descriptors(daemon) <= before, "descriptors are left open")
    assert [path.name for path in folder.iterdir() if "tmp" in path.name] == []


def daemon_is_alone(daemon: Daemon) -> bool:
    with daemon.link() as link:
        return link.call("stats")["connections"] == 1


@pytest.mark.parametrize("end", ["shutdown", "signal"])
def test_an_end_in_the_middle_of_it(start, folder, end) -> None:
    daemon = start()
    storm = Storm(daemon, folder, 7)
    for _ in range(STEPS // 10):
        storm.step()
    if end == "shutdown":
        with daemon.link() as link:
            link.call("shutdown")
    else:
        daemon.process.terminate()
    # Everybody gets all of their answers, and then a bye.
    for link in storm.links:
        with pytest.raises(ConnectionError):
            while True:
                storm.take_in(link, 0.1)
        try:
            storm.take_in(link)
        except ConnectionError:
            pass
        assert link.notifications[-1].method == "bye"
        link.close()
    assert daemon.process.wait(30) == 0


def test_those_who_do_not_read_keep_nobody_waiting(daemon) -> None:
    """Attached and deaf, or sending strokes and deaf: others go on (test_stall.py: for how long)."""
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(40_000)})
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
        stroke = {"session": "sheet", "pose": "rest", "positions": posed + np.float32(0.01),
                  "vertices": np.arange(len(posed), dtype=np.uint32)}
        listener = Link.connect(daemon.socket)
        listener.call("session.attach", {"session": "sheet"})
        sender = Link.connect(daemon.socket)
        sender.timeout = 0.5
        with pytest.raises(TimeoutError):
            for _ in range(1000):
                # Past Link, which would read on.
                _, pieces = sender.exchange.request("stroke.apply", stroke)
                sender.socket.setblocking(True)
                sender.socket.settimeout(0.5)
                for piece in pieces:
                    sender.socket.sendall(piece)
        for turn in range(120):  # 100 MiB of updates
            link.call(("history.undo", "history.redo")[turn % 2], {"session": "sheet"})
            link.call("ping", timeout=5)
        listener.close()
        sender.close()


# ---- one bug each ----


def line(**members) -> bytes:
    return json.dumps({"jsonrpc": "2.0", **members}, separators=(",", ":")).encode() + b"\n"


HELLO = line(id=1, method="hello", params={"protocol": {"min": 1, "max": 1}})


def test_many_small_lines_behind_a_full_queue(daemon) -> None:
    """A request that is answered at once ends a hold; that once nested as deep as lines waited."""
    pings = 20_000
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(100_000)})
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
        stroke = {"session": "sheet", "pose": "rest", "positions": posed, "stream": False,
                  "vertices": np.arange(len(posed), dtype=np.uint32)}
        strokes = [link.send("stroke.apply", stroke) for _ in range(2)]
        # 63 that wait for the session, then one long line, which a worker reads while the daemon
        # gathers the many short ones behind it.
        sent = HELLO + b"".join(line(id=2 + i, method="history.undo", params={"session": "sheet"})
                                for i in range(63))
        sent += line(id=1, method="ping", params={"padding": "x" * 600_000})
        sent += line(id=1, method="ping") * pings
        raw = socket.socket(socket.AF_UNIX)
        raw.connect(str(daemon.socket))
        raw.settimeout(60)
        writer = threading.Thread(target=raw.sendall, args=(sent,), daemon=True)
        writer.start()
        answers = 0
        while answers < 1 + 63 + 1 + pings:
            got = raw.recv(1 << 20)
            assert got, "the daemon hung up"
            answers += got.count(b"\n")
        raw.close()
        for id in strokes:
            link.wait(id)


def test_who_attaches_in_the_middle_of_a_change_hears_of_it(daemon) -> None:
    """Lines are spelled out by a worker, which once was not asked for those who came meanwhile."""
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(40_000)})
        posed = link.call("pose.evaluate", {"session": "sheet", "pose": "rest"})["positions"]
        link.call("stroke.apply", {"session": "sheet", "pose": "rest", "positions": posed,
                                   "vertices": np.arange(len(posed), dtype=np.uint32)})
        for _ in range(30):
            with daemon.link(lines=True) as listener:
                turns = [link.send("history.undo", {"session": "sheet"}),
                         link.send("history.redo", {"session": "sheet"})]
                held = listener.call("session.attach", {"session": "sheet"})["revision"]
                done = [link.wait(turn)["revision"] for turn in turns][-1]
                while held < done:
                    told = next_update(listener)
                    assert told["since"] == held
                    held = told["revision"]
                assert held == done


def test_numbers_that_overflow_are_told_as_numbers(daemon) -> None:
    far = np.full((4, 3), -3.4e38, np.float32)
    with daemon.link() as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(16)})
        answer = link.call("stroke.apply", {"session": "sheet", "pose": "rest", "positions": far,
                                            "vertices": np.arange(4, dtype=np.uint32)})
        assert answer["unreached"] == 4
        assert answer["residual"]["after"]["max"] == np.finfo(np.float32).max
        weights = link.call("weights.get", {"session": "sheet"})["weights"].astype(np.float64)
        assert (weights >= 0).all() and np.abs(weights.sum(1) - 1).max() <= 1e-7


def write_one_point(folder: Path, count: int) -> Path:
    """A glTF file whose vertices all lie in one place, with the same influence: one ring."""
    arrays = {"POSITION": np.zeros((count, 3), np.float32), "JOINTS_0": np.zeros((count, 4), "u1"),
              "WEIGHTS_0": np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))}
    views, accessors, data = [], [], b""
    for array in arrays.values():
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessors.append({"bufferView": len(accessors), "count": count,
                          "componentType": 5126 if array.dtype == np.float32 else 5121,
                          "type": f"VEC{array.shape[1]}"})
        data += array.tobytes()
    accessors[0] |= {"min": [0, 0, 0], "max": [0, 0, 0]}
    (folder / "point.bin").write_bytes(data)
    path = folder / "point.gltf"
    path.write_text(json.dumps({
        "asset": {"version": "2.0"}, "buffers": [{"uri": "point.bin", "byteLength": len(data)}],
        "bufferViews": views, "accessors": accessors, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "skin": 0}, {"name": "root"}], "skins": [{"joints": [1]}],
        "meshes": [{"primitives": [{"attributes": {name: index for index, name
                                                   in enumerate(arrays)}}]}]}))
    return path


def test_one_ring_of_twins_locked_by_every_vertex(daemon, folder) -> None:
    """All of a file may be one seam; locking each vertex once walked the whole ring each time."""
    count = 300_000
    everyone = np.arange(count, dtype=np.uint32)
    with daemon.link() as link:
        link.call("session.create", {"file": str(write_one_point(folder, count))})
        answer = link.call("stroke.apply", {"session": "point", "pose": "rest", "vertices": [5],
                                            "positions": [[1, 1, 1]],
                                            "locked_vertices": everyone}, timeout=20)
        assert answer["vertices"] == count and answer["unreached"] == count


def test_more_indices_than_any_rig_has(daemon) -> None:
    many = np.zeros(8_000_001, np.uint32)
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(16)})
        for method, more in (("weights.get", {}), ("pose.evaluate", {"pose": "rest"})):
            with pytest.raises(SkindError) as refusal:
                link.call(method, {"session": "sheet", "vertices": many, **more})
            assert refusal.value.name == "too_large"
