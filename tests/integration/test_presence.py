"""Who is attached to a rig session, and what they claim."""

from __future__ import annotations

import time

import numpy as np
import pytest
import rigs
from core import Link, SkindError
from core.exchange import Exchange
import schemas
import socket as sockets

WHO = {"session": "sheet"}


def connect(daemon, name: str, user: str = "", lines: bool = False, **more) -> Link:
    """A connection that says who it is."""
    connection = sockets.socket(sockets.AF_UNIX, sockets.SOCK_STREAM)
    connection.connect(str(daemon.socket))
    link = Link(connection, Exchange(lines=lines, watch=schemas.watch()), 60)
    link.call("hello", {"protocol": {"min": 1, "max": 1},
                        "client": {"name": name, "version": "2.1", "user": user, **more}})
    return link


@pytest.fixture
def sheet(daemon):
    with daemon.link() as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(400)})
    return daemon


def take(link: Link, method: str, seconds: float = 10) -> dict:
    """The next notification of that kind; others before it are dropped."""
    deadline = time.monotonic() + seconds
    while True:
        while link.notifications:
            message = link.notifications.popleft()
            if message.method == method:
                return message.params
        assert time.monotonic() < deadline, f"no {method}"
        link.pump(0.01)


def until(link: Link, condition, seconds: float = 10) -> list[dict]:
    """Takes session.presence until what it says is so."""
    deadline = time.monotonic() + seconds
    while True:
        present = take(link, "session.presence", max(0.01, deadline - time.monotonic()))["present"]
        if condition(present):
            return present


def test_names_and_times(sheet) -> None:
    before = int(time.time())
    with connect(sheet, "Blender", "Anna") as anna, connect(sheet, "skinctl", "Ben") as ben:
        (alone,) = anna.call("session.attach", WHO)["present"]
        assert (alone["client"], alone["user"], alone["version"]) == ("Blender", "Anna", "2.1")
        assert before <= alone["since"] <= time.time()
        assert alone["claim"] == {"bones": [], "vertices": 0}
        attached = ben.call("session.attach", WHO)
        first, second = attached["present"]
        assert first == alone and (second["client"], second["user"]) == ("skinctl", "Ben")
        assert attached["connection"] == second["connection"]
        assert first["connection"] != second["connection"]
        assert until(anna, lambda present: len(present) == 2) == [first, second]
        assert ben.call("session.info", WHO)["present"] == [first, second]
        ben.call("session.detach", WHO)
        assert until(anna, lambda present: len(present) == 1) == [first]


def test_who_hangs_up_is_gone(sheet) -> None:
    with connect(sheet, "Blender", "Anna") as anna:
        anna.call("session.attach", WHO)
        with connect(sheet, "skinctl", "Ben") as ben:
            ben.call("session.attach", WHO)
            ben.call("session.claim", {**WHO, "bones": ["bone.1"]})
            until(anna, lambda present: len(present) == 2
                  and present[1]["claim"] == {"bones": ["bone.1"], "vertices": 0})
        (left,) = until(anna, lambda present: len(present) == 1)
        assert left["user"] == "Anna"


@pytest.mark.parametrize("lines", [False, True])
def test_claims_are_told_and_let_go(sheet, lines) -> None:
    with connect(sheet, "Blender", "Anna") as anna, connect(sheet, "x", "Ben", lines) as ben:
        for link in (anna, ben):
            link.call("session.attach", WHO)
        claim = {**WHO, "bones": ["bone.3", "bone.2"], "vertices": np.array([9, 4, 9], np.uint32)}
        assert anna.call("session.claim", claim)["vertices"] == 2
        told = take(ben, "session.claims")
        assert (told["client"], told["user"]) == ("Blender", "Anna")
        assert told["bones"] == ["bone.2", "bone.3"] and list(told["vertices"]) == [4, 9]
        assert anna.call("session.claim", WHO)["vertices"] == 0
        told = take(ben, "session.claims")
        assert told["bones"] == [] and len(told["vertices"]) == 0


def test_two_of_a_kind_are_told_apart_by_who_sits_at_them(start) -> None:
    """In what is told of a change, and in what stands in the way of undo; also after a restart."""
    daemon = start()
    rows = {**WHO, "vertices": np.arange(3, dtype=np.uint32)}
    with connect(daemon, "Blender", "Anna", id="b-1") as anna, \
            connect(daemon, "Blender", "Ben", id="b-2") as ben:
        anna.call("session.create", {"name": "sheet", **rigs.sheet(400)})
        held = anna.call("weights.get", rows)["weights"]
        for link in (anna, ben):
            link.call("session.attach", WHO)
        anna.call("weights.set", {**rows, "weights": held[::-1].copy()})
        assert take(ben, "session.update")["user"] == "Anna"
        ben.call("weights.set", {**rows, "weights": held})
        assert take(anna, "session.update")["user"] == "Ben"
    daemon.stop()
    with connect(start(), "Blender", "Anna", id="b-1") as anna:
        with pytest.raises(SkindError, match=r"by Ben \(Blender\) touches the same vertices"):
            anna.call("history.undo", {**WHO, "own": True})


def test_who_comes_later_sees_the_claims_there_are(sheet) -> None:
    with connect(sheet, "a", "Anna") as anna, connect(sheet, "b", "Ben") as ben:
        for link, bone in ((anna, "bone.1"), (ben, "bone.2")):
            link.call("session.attach", WHO)
            link.call("session.claim", {**WHO, "bones": [bone]})
        anna.call("session.claim", WHO)
        with connect(sheet, "c", "Carl") as carl:
            present = carl.call("session.attach", WHO)["present"]
            assert [one["claim"]["bones"] for one in present] == [[], ["bone.2"], []]
            carl.pump(0.3)
            claims = [note.params for note in carl.notifications
                      if note.method == "session.claims"]
            assert [(claim["user"], claim["bones"]) for claim in claims] == [("Ben", ["bone.2"])]


def test_what_cannot_be_claimed(sheet) -> None:
    with connect(sheet, "a") as link:
        with pytest.raises(SkindError) as refused:
            link.call("session.claim", {**WHO, "bones": ["bone.1"]})
        assert refused.value.name == "bad_params" and "attach" in str(refused.value)
        link.call("session.attach", WHO)
        for params, name in (({"bones": ["none"]}, "no_bone"),
                             ({"vertices": np.array([400], np.uint32)}, "bad_index")):
            with pytest.raises(SkindError) as refused:
                link.call("session.claim", {**WHO, **params})
            assert refused.value.name == name
        assert link.call("session.claim", {**WHO, "vertices": np.array([399], np.uint32)})


def stroke(link: Link, vertices: list[int]) -> dict:
    some = np.array(vertices, np.uint32)
    link.call("pose.set", {**WHO, "pose": "bent", "matrices": rigs.bent(0.3)})
    posed = link.call("pose.evaluate", {**WHO, "pose": "bent", "vertices": some})["positions"]
    return link.call("stroke.apply", {**WHO, "pose": "bent", "vertices": some,
                                      "positions": posed + np.float32(0.001)})


def claimed(answer: dict) -> tuple[int, str] | None:
    found = [warning for warning in answer["warnings"] if warning["name"] == "claimed"]
    return (found[0]["count"], found[0]["text"]) if found else None


def test_a_stroke_is_told_what_it_runs_into(sheet) -> None:
    """By vertex, or by the bone that weighs most there; it is done all the same."""
    rig = rigs.sheet(400)
    with connect(sheet, "Blender", "Anna") as anna, connect(sheet, "skinctl", "Ben") as ben:
        for link in (anna, ben):
            link.call("session.attach", WHO)
        got = ben.call("weights.get", WHO)
        heaviest = got["joints"][np.arange(400), got["weights"].argmax(1)]
        bone = int(heaviest[200])
        anna.call("session.claim", {**WHO, "bones": [f"bone.{bone}"],
                                    "vertices": np.array([0, 1], np.uint32)})
        touched = [0, 5, 200, 201, 399]
        expected = sum(int(vertex in (0, 1) or heaviest[vertex] == bone) for vertex in touched)
        assert 1 < expected < len(touched) and len(rig["bones"]["names"]) > bone
        before = ben.call("session.info", WHO)["revision"]
        count, text = claimed(stroke(ben, touched))
        assert count == expected and "Anna (Blender)" in text
        assert ben.call("session.info", WHO)["revision"] == before + 1
        assert claimed(stroke(anna, touched)) is None  # its own claim
        anna.call("session.claim", WHO)
        assert claimed(stroke(ben, touched)) is None


def test_a_tool_that_comes_back_does_not_run_into_its_old_self(sheet) -> None:
    with connect(sheet, "Blender", "Anna", id="anna-1") as old, \
            connect(sheet, "Blender", "Anna", id="anna-1") as new:
        old.call("session.attach", WHO)
        old.call("session.claim", {**WHO, "vertices": np.arange(400, dtype=np.uint32)})
        assert claimed(stroke(new, [1, 2])) is None
        with connect(sheet, "x", id="ben") as ben:
            assert claimed(stroke(ben, [1, 2]))[0] == 2


def test_many_who_come_at_once_are_told_together(sheet) -> None:
    with connect(sheet, "first") as first:
        first.call("session.attach", WHO)
        links = [connect(sheet, f"tool {number}") for number in range(40)]
        for link in links:
            link.call("session.attach", WHO)
        until(first, lambda present: len(present) == 41)
        told = 1
        for link in links:
            link.close()
        while True:
            told += 1
            if len(take(first, "session.presence")["present"]) == 1:
                break
        assert told < 30
