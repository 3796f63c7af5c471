"""kill -9 at random moments under load; then everything that was answered has to be there.

    asked ──> answered with a revision ─────────────────────────────┐
      │                                                              ├─> the order of all steps
      └──> not answered ──> asked again under its sequence ──────────┘

Two clients work on each session, others make, save, fork and delete sessions. After each restart
the order of a session's steps is known by their revisions, and a daemon that is never killed plays
them in this order: it must hold the same bytes at the revision that the restart came up with, and
at the one after all was asked again. Sessions live over several kills.

A journal's log is folded into its file when nobody works (100 ms) and it is large (1 MiB), so one
of the sessions has large strokes and artists who rest, and a share of the kills comes at the moment
in which its file begins to change.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from core import Link, SkindError

from .. import work
from ..yard import Daemon, Failed, Yard, expect, greet

DEPTH = 3  # requests that a client has under way
LIFE = 6  # kills that a session lives through
REST_SECONDS = 0.3  # of which an artist who rests works for the first half
FOLDING_SHARE = 0.35  # of the kills that wait for a log to be folded in
FOLDING_SECONDS = 0.002  # it takes about as long


@dataclass
class Asked:
    """A request of a client, and what is known of it."""

    method: str
    params: dict
    id: int = 0
    revision: int = 0  # that it made; 0: none, there was nothing to do

    def settle(self, link: Link) -> bool:
        """Takes the answer, if it came."""
        try:
            answer = link.exchange.take(self.id)
        except SkindError as error:
            expect(error.name in work.NOTHING_TO_DO, f"{self.method} is refused with {error}")
            return True
        if answer is None:
            return False
        if answer["vertices"] > 0 or self.method.startswith("history."):
            self.revision = answer["revision"]
        return True


class Client:
    """One of those who work on a session; keeps its id over the daemon's lives."""

    def __init__(self, story: "Story", name: str, recipe: work.Recipe) -> None:
        self.story, self.name, self.recipe = story, name, recipe
        self.sequence = 0
        self.waiting: list[Asked] = []
        self.link: Link | None = None

    def connect(self, daemon: Daemon) -> None:
        self.link = greet(daemon.socket, self.name)

    def step(self, works: bool) -> None:
        """Takes what came, sends as much as may be under way. Raises once the daemon is gone."""
        self.link.pump()
        self.link.notifications.clear()
        self.waiting = [asked for asked in self.waiting if not self.take(asked)]
        while works and len(self.waiting) < DEPTH:
            method, params = self.recipe.next()
            if method == "pose.set":  # takes no turn, so that its place in the order is not known
                continue
            self.sequence += 1
            asked = Asked(method, {**params, "sequence": self.sequence})
            self.waiting.append(asked)
            self.send(asked)

    def take(self, asked: Asked) -> bool:
        if not asked.settle(self.link):
            return False
        self.story.learn(asked)
        return True

    def send(self, asked: Asked) -> None:
        asked.id = self.link.send(asked.method, asked.params)

    def ask_again(self) -> None:
        """All that was under way when the daemon died."""
        for asked in self.waiting:
            self.send(asked)
        deadline = time.monotonic() + 20
        while self.waiting:
            expect(time.monotonic() < deadline, f"again, {self.waiting[0].method} is not answered")
            self.link.pump(0.001)
            self.waiting = [asked for asked in self.waiting if not self.take(asked)]


@dataclass(frozen=True)
class Kind:
    """What sessions there are."""

    name: str
    vertices: int
    brush: int  # vertices of its largest strokes
    history_bytes: int
    rests: bool = False


KINDS = (Kind("small", 100, 60, 512 << 20),
         Kind("short", 300, 60, 1 << 20),  # a history that forgets
         Kind("large", 20_000, 4000, 16 << 20, rests=True))  # a log that is folded in


class Story:
    """A session: what made each of its revisions, and its twin in a daemon that is never killed."""

    def __init__(self, kind: "Kind", number: int, twin: Link) -> None:
        self.kind, self.twin = kind, twin
        self.name = f"{kind.name}{number}"
        self.steps: dict[int, Asked] = {}
        self.played = 0  # revisions that the twin has
        self.kills = 0
        self.clients = [Client(self, f"{self.name}-{index}", work.Recipe(
            self.name, kind.vertices, 10 * number + index, kind.brush)) for index in range(2)]

    def create(self, link: Link) -> None:
        limit = {"history_bytes": self.kind.history_bytes}
        work.create(link, self.name, self.kind.vertices, **limit)
        work.create(self.twin, self.name, self.kind.vertices, **limit, durability="off")

    def step(self) -> None:
        works = not self.kind.rests or time.monotonic() % REST_SECONDS < REST_SECONDS / 2
        for client in self.clients:
            client.step(works)

    def learn(self, asked: Asked) -> None:
        if asked.revision == 0:
            return
        other = self.steps.setdefault(asked.revision, asked)
        expect(other is asked, f"{other.method} and {asked.method} both made revision "
                               f"{asked.revision} of {self.name}")

    def play(self, revision: int) -> str:
        """What the twin holds at a revision."""
        while self.played < revision:
            self.played += 1
            asked = self.steps[self.played]
            params = {key: value for key, value in asked.params.items() if key != "sequence"}
            made = self.twin.call(asked.method, params)["revision"]
            expect(made == self.played, f"the twin's revision is {made}, not {self.played}")
        return work.digest(self.twin, self.name)

    def check(self, daemon: Daemon, link: Link) -> None:
        """After a restart: all that was answered is there, and nothing else."""
        info = link.call("session.info", {"session": self.name})
        answered = max(self.steps, default=0)
        revision = info["revision"]
        expect(revision >= answered, f"{self.name} is at {revision}, answered was {answered}")
        expect("damage" not in info, f"{self.name} was damaged: {info.get('damage')}")
        held = work.digest(link, self.name)
        for client in self.clients:
            client.connect(daemon)
        for client in self.clients:
            client.ask_again()
        after = link.call("session.info", {"session": self.name})
        missing = set(range(1, after["revision"] + 1)) - set(self.steps)
        expect(not missing, f"nobody made revisions {sorted(missing)[:5]} of {self.name}")
        expect(self.play(revision) == held, f"{self.name} holds other bytes at {revision}")
        expect(self.play(after["revision"]) == work.digest(link, self.name),
               f"{self.name} holds other bytes at {after['revision']}, after asking again")
        twin = self.twin.call("session.info", {"session": self.name})
        for key in ("undo_steps", "redo_steps"):
            expect(twin[key] == after[key], f"{self.name}: {after[key]} {key}, not {twin[key]}")
        self.kills += 1

    def end(self, link: Link) -> None:
        """Its last test: everything is undone, and the file is whole."""
        verified = link.call("session.verify", {"session": self.name})
        expect(verified["ok"], f"{self.name}: {verified['problems']}")
        for each in (link, self.twin):
            try:
                for _ in range(40):
                    each.call("history.undo", {"session": self.name})
            except SkindError as error:
                expect(error.name == "nothing_to_undo", str(error))
        expect(work.digest(link, self.name) == work.digest(self.twin, self.name),
               f"{self.name} holds other bytes after undo")
        for each in (link, self.twin):
            each.call("session.delete", {"session": self.name})


@dataclass
class Guest:
    """Makes, saves, forks and deletes sessions; knows what has to be there and what must not."""

    daemon: Daemon
    random: random.Random
    link: Link | None = None
    there: dict[str, int] = field(default_factory=dict)  # sessions by name, and their revisions
    gone: set[str] = field(default_factory=set)
    saved: list[str] = field(default_factory=list)
    unsure: set[str] = field(default_factory=set)
    count: int = 0

    def step(self) -> None:
        """One request, answered. Raises once the daemon is gone."""
        kind = self.random.choice(["create", "create", "stroke", "stroke", "save", "fork", "delete",
                                   "close"])
        name = self.random.choice(sorted(self.there)) if self.there else ""
        if kind == "create" or not name:
            self.make("session.create", **work.rigs.sheet(64))
        elif kind == "fork":
            self.make("session.fork", session=name)
        elif kind == "stroke":
            self.unsure.add(name)
            made = self.link.call(*work.Recipe(name, 64, self.count).stroke(pose="rest"))
            self.there[name] = made["revision"]
            self.unsure.discard(name)
        elif kind == "save":
            path = str(self.daemon.folder / f"saved-{self.random.randrange(3)}.skind")
            self.saved = [one for one in self.saved if one != path] + [path] * (path in self.saved)
            self.link.call("session.save", {"session": name, "path": path})
            self.saved = [one for one in self.saved if one != path] + [path]
        else:
            del self.there[name]
            self.unsure.add(name)
            self.link.call(f"session.{kind}", {"session": name})
            self.unsure.discard(name)
            self.gone.add(name)

    def make(self, method: str, **params: object) -> None:
        self.count += 1
        name = f"guest-{self.count}"
        self.unsure.add(name)
        self.link.call(method, {**params, "name": name})
        self.unsure.discard(name)
        self.there[name] = 0 if method == "session.create" else self.there[params["session"]]

    def check(self, link: Link) -> None:
        found = {row["session"]: row["revision"] for row in link.call("session.list")["sessions"]
                 if row["session"].startswith("guest-")}
        for name, revision in self.there.items():
            expect(name in found, f"{name}, which was answered, is not there")
            expect(found[name] >= revision, f"{name} is at {found[name]}, answered was {revision}")
        back = self.gone & set(found)
        expect(not back, f"deleted sessions are back: {sorted(back)}")
        extra = set(found) - set(self.there) - self.unsure
        expect(not extra, f"sessions that nobody made: {sorted(extra)}")
        for path in self.saved:
            verified = link.call("session.verify", {"path": path})
            expect(verified["ok"], f"{path}: {verified['problems']}")
        for name in found:
            link.call("session.delete", {"session": name})
        self.there.clear()
        self.unsure.clear()
        self.gone.clear()


class Round:
    """A daemon that is killed again and again, and all who work on it."""

    def __init__(self, yard: Yard, seed: int) -> None:
        self.random = random.Random(seed)
        self.daemon = yard.daemon("--workers", 2).start()
        self.twins = yard.daemon("--workers", 1).start()
        self.twin = self.twins.link()
        self.guest = Guest(self.daemon, random.Random(seed + 1))
        self.stories: list[Story] = []
        self.made = 0
        self.folding = 0  # kills that came when a log was folded in

    def fill(self, link: Link) -> None:
        """A session of each kind."""
        for kind in KINDS:
            if any(story.kind == kind for story in self.stories):
                continue
            self.made += 1
            story = Story(kind, self.made, self.twin)
            story.create(link)
            for client in story.clients:
                client.connect(self.daemon)
            self.stories.append(story)

    def run(self) -> None:
        with self.daemon.link() as link:
            self.fill(link)
        self.guest.link = greet(self.daemon.socket, "guest")
        killer = self.start_killer()
        try:
            while True:
                for story in self.stories:
                    story.step()
                self.guest.step()
        except (ConnectionError, OSError):
            pass
        finally:
            killer.join()
            self.daemon.process.wait()
            self.folding += killer.exitcode == FOLDING
        self.daemon.start()
        with self.daemon.link() as link:
            for story in self.stories:
                story.check(self.daemon, link)
            self.guest.check(link)
            for story in [story for story in self.stories if story.kills >= LIFE]:
                story.end(link)
                self.stories.remove(story)

    def start_killer(self) -> multiprocessing.Process:
        """Some time from now, or when the large session's log is folded in."""
        target, args = kill_after, (
            self.random.choice([0.02, 0.1, 0.3, 0.6]) * self.random.random(),)
        if self.random.random() < FOLDING_SHARE:
            name = next(story.name for story in self.stories if story.kind.rests)
            target, args = kill_folding, (
                next(self.daemon.state.rglob(f"{name}-*.skind")),
                FOLDING_SECONDS * self.random.random())
        killer = multiprocessing.Process(target=target, args=(self.daemon.pid, *args))
        killer.start()
        return killer

    def close(self) -> None:
        self.daemon.stop()
        self.twin.close()
        self.twins.stop()


FOLDING = 1  # exit status of a killer that saw it


def kill_after(pid: int, seconds: float) -> None:
    time.sleep(seconds)
    os.kill(pid, 9)


def kill_folding(pid: int, file: Path, seconds: float) -> None:
    """So long after the file begins to change; or when it does not."""
    before, deadline = file.stat().st_mtime_ns, time.monotonic() + 4 * REST_SECONDS
    while file.exists() and time.monotonic() < deadline:
        if file.stat().st_mtime_ns != before:
            time.sleep(seconds)
            os.kill(pid, 9)
            sys.exit(FOLDING)
        time.sleep(0.0001)
    os.kill(pid, 9)


def rounds_of(yard: Yard, seed: int, seconds: float, least: int) -> tuple[int, int, list[str]]:
    """(rounds, of these while a log was folded in, what was lost) of one daemon."""
    began, done, folding, lost = time.monotonic(), 0, 0, []
    while time.monotonic() - began < seconds or done < least:
        current = Round(yard, seed + 1000 * done)
        try:
            while time.monotonic() - began < seconds or done < least:
                current.run()
                done += 1
            current.close()
        except Failed as failure:
            done += 1
            lost.append(f"round {done} of seed {seed}: {failure}")
            yard.say(f"  {lost[-1]}")
            current.daemon.kill()
            current.twins.kill()
        folding += current.folding
        if time.monotonic() - began > 2 * seconds:
            break
    return done, folding, lost


def measure(yard: Yard, seconds: float) -> dict:
    at_once = yard.pick(3, 2)
    least = yard.pick(-(-500 // at_once), 5)
    with ProcessPoolExecutor(at_once, multiprocessing.get_context("fork")) as pool:
        running = [pool.submit(rounds_of, yard, seed + 1, seconds, least)
                   for seed in range(at_once)]
        results = [one.result() for one in running]
    rounds, folding = sum(one[0] for one in results), sum(one[1] for one in results)
    yard.say(f"  {rounds} rounds, {folding} of them while a log was folded in")
    expect(folding > 0, "no kill came while a log was folded in")
    return {"kill9_rounds": rounds, "kill9_lost": sum(len(one[2]) for one in results)}
