"""Two real Blenders and a watch on one rig session, over deaths of the daemon and of a Blender: in
the end all hold the same weights, and nothing that was answered is lost.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Callable, Iterator

import pytest

from blenders import ASSETS, DEBIAN, VERSIONS, Blender, Job, Window
from core import Link
from daemons import BIN
from test_sessions import needs_assets

SECONDS = 60.0  # patience with two Blenders on a busy machine
FOX = (str(ASSETS / "bevy_fox" / "Fox.glb"), "fox")
TUBE = ("tube", "")
NAMES = ("first", "second")


def until(true: Callable[[], object], what: str) -> None:
    end = time.monotonic() + SECONDS
    while not true():
        assert time.monotonic() < end, f"{what}: still not so"
        time.sleep(0.01)


class Watch:
    """`skinctl watch --digest --keep --json` and what it has told."""

    def __init__(self, socket: Path, session: str, *options: str) -> None:
        self.told: list[dict] = []
        self.process = subprocess.Popen(
            [BIN / "skinctl", "--json", f"--socket={socket}", "watch", "--session", session,
             "--digest", *options], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stdout:
            self.told.append(json.loads(line))

    def digest(self, revision: int) -> dict | None:
        """What it said of all weights as of a revision."""
        return next((told for told in list(self.told)
                     if told["event"] == "digest" and told["revision"] == revision), None)

    def close(self) -> None:
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(SECONDS) == 0
        self._reader.join()
        self.process.stdout.close()


class Studio:
    """Blenders with one home and one socket, and the folder in which they say how far they are."""

    def __init__(self, folder: Path, flags: Path) -> None:
        self.blenders = {version: Blender(version, folder) for version in (DEBIAN, VERSIONS[-1])}
        self.blenders["window"] = Window(folder)
        self.socket = folder / "skind.sock"
        self.flags = flags
        self.jobs: dict[str, Job] = {}
        self.watches: list[Watch] = []

    def begin(self, name: str, version: str, seed: int, *character: str) -> None:
        """A Blender that sculpts a character (file or kind, mesh, and the session that it joins);
        returns when its session is there."""
        job = "sharing.drawer" if version == "window" else "sharing.sculptor"
        self.jobs[name] = self.blenders[version].start(job, str(self.flags), name, seed, *character,
                                                       seconds=240)
        self.hears(name)

    def said(self, name: str) -> str:
        file = self.flags / name
        return file.read_text() if file.exists() else ""

    def hears(self, name: str, word: str = "") -> None:
        """Waits until a Blender says this word, or any other than it has said last."""
        before = self.said(name)

        def is_so() -> bool:
            assert self.jobs[name].process.poll() is None, self.jobs[name].text()
            return self.said(name) == word if word else self.said(name) != before

        until(is_so, f"{name} says {word or 'something new'}")

    def tell(self, word: str) -> None:
        (self.flags / word).touch()

    def watch(self, *options: str) -> Watch:
        self.watches.append(Watch(self.socket, self.session(), *options))
        return self.watches[-1]

    def session(self) -> str:
        with self.link() as link:
            return link.call("session.list")["sessions"][0]["session"]

    def link(self) -> Link:
        return Link.connect(self.socket, name="test")

    def pid(self) -> int:
        with self.link() as link:
            return link.hello["server"]["pid"]

    def start(self) -> None:
        subprocess.run([BIN / "skinctl", "--quiet", f"--socket={self.socket}", "start"],
                       check=True, stdin=subprocess.DEVNULL, timeout=SECONDS)

    def settle(self) -> dict[str, dict]:
        """Has all stop, and waits until nothing more changes. What each holds then, by name."""
        self.tell("stop")
        for name in self.jobs:
            self.hears(name, "settled")
        revision, since = -1, 0.0
        with self.link() as link:
            while revision < 0 or time.monotonic() - since < 1.0:
                now = link.call("session.list")["sessions"][0]["revision"]
                if now != revision:
                    revision, since = now, time.monotonic()
                time.sleep(0.05)
        self.tell("end")
        return {name: job.result() for name, job in self.jobs.items()}

    def close(self) -> None:
        for watch in self.watches:
            if watch.process.poll() is None:
                watch.close()
        for blender in self.blenders.values():
            blender.close()


@pytest.fixture
def studio(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Studio]:
    monkeypatch.setenv("PATH", str(BIN), prepend=os.pathsep)
    made = Studio(folder, tmp_path)
    yield made
    made.close()


def halted_in_a_stroke(studio: Studio, names: tuple[str, ...]) -> int:
    """Halts the daemon while one of these Blenders waits for a stroke. Its process."""
    pid = studio.pid()

    def is_waited_for() -> bool:
        os.kill(pid, signal.SIGSTOP)
        time.sleep(0.3)  # what is said after that waits
        if any(studio.said(name).startswith("stroke") for name in names):
            return True
        os.kill(pid, signal.SIGCONT)
        time.sleep(0.1)
        return False

    until(is_waited_for, "a stroke waits")
    return pid


def changes(watch: Watch) -> dict[int, str]:
    """Who made which revision, as the watch was told; it is not told what it had to fetch."""
    updates = [told for told in watch.told if told["event"] == "session.update"]
    return {each["revision"]: each["client"]
            for told in updates for each in told.get("changes", [told])}


@pytest.mark.parametrize("character", [TUBE, pytest.param(FOX, marks=needs_assets)],
                         ids=["tube", "fox"])
def test_two_blenders_over_deaths_of_the_daemon(studio: Studio, character) -> None:
    studio.begin("first", DEBIAN, 1, *character)
    share(studio, character)


def test_a_pen_in_a_window_and_another_blender(studio: Studio) -> None:
    studio.begin("first", "window", 5)
    share(studio, TUBE)


def share(studio: Studio, character: tuple[str, str]) -> None:
    """A second Blender joins the first; the daemon dies four times while both sculpt."""
    session = studio.session()
    with studio.link() as link:
        instance = link.call("session.info", {"session": session})["instance"]
    watch = studio.watch("--keep")
    studio.begin("second", VERSIONS[-1], 2, *character, session)
    for round in range(4):
        for name in NAMES:
            for _ in range(3):
                studio.hears(name)
        pid = studio.pid() if round == 2 else halted_in_a_stroke(studio, NAMES)
        os.kill(pid, signal.SIGKILL)
        if round % 2:
            studio.start()  # else whoever needs it does
    for name in NAMES:
        studio.hears(name)
    found = studio.settle()

    with studio.link() as link:
        info = link.call("session.info", {"session": session})
        held = link.call("weights.get", {"session": session})
        revision = held["revision"]
        assert info["instance"] == instance, "nothing was lost"
        assert revision == info["revision"]
        for facts in found.values():
            assert facts["phase"] == "ready" and facts["generation"] == 5, facts
            assert facts["revision"] == revision
            for weights in (facts["weights"], facts["shown"], facts["held"]):
                assert weights.tobytes() == held["weights"].tobytes()
        until(lambda: watch.digest(revision), "the watch has heard of the last change")
        fresh = studio.watch()
        until(lambda: fresh.digest(revision), "another has fetched all weights")
        assert fresh.digest(revision) == watch.digest(revision)

        heard = changes(watch)
        assert len(heard) > 20
        assert all(heard.get(at, facts["client"]) == facts["client"]
                   for facts in found.values() for at in facts["answered"])
        answered = [at for facts in found.values() for at in facts["answered"]]
        assert len(set(answered)) == len(answered) > 20, "two changes have the same revision"
        assert max(answered) == revision
        assert info["undo_steps"] > 0
        for _ in range(info["undo_steps"]):
            link.call("history.undo", {"session": session})
        assert link.call("weights.get", {"session": session})["weights"].tobytes() \
            == found["first"]["start"].tobytes(), "the history leads all the way back"


def test_a_blender_killed_in_the_middle_of_a_stroke(studio: Studio) -> None:
    studio.begin("first", DEBIAN, 3, *TUBE)
    studio.begin("second", VERSIONS[-1], 4, *TUBE, studio.session())
    watch = studio.watch()
    for name in NAMES:
        studio.hears(name)
    pid = halted_in_a_stroke(studio, ("second",))
    studio.jobs.pop("second").kill()
    os.kill(pid, signal.SIGCONT)
    for _ in range(5):
        studio.hears("first")
    facts = studio.settle()["first"]
    assert facts["phase"] == "ready" and facts["generation"] == 1
    assert facts["weights"].tobytes() == facts["held"].tobytes()
    until(lambda: watch.digest(facts["revision"]), "the watch has heard of the last change")
