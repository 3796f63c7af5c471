"""core.presence against the real daemon: two tools and a script in one session, and what they claim."""

from __future__ import annotations

import time
from typing import Callable

import numpy as np
import pytest
from core import Link
from core.presence import Claim, Presence, called
from core.skin import NO_BONE
from core.state import State
from core.wire import SkindError
from tools import Mortal, Tool, V

NONE: list[int] = []


@pytest.fixture
def script(daemon) -> Link:
    with daemon.link("script", id="script") as link:
        yield link


def attach(link: Link) -> None:
    link.call("session.attach", {"session": "s"})


def claim(link: Link, **what: object) -> None:
    link.call("session.claim", {"session": "s", **what})


def claimed(tool: Tool) -> list[int]:
    sculpt = tool.sculpt
    return np.flatnonzero(sculpt.presence.claimed(sculpt.shown, sculpt.bones)).tolist()


def names(tool: Tool) -> list[str]:
    return [other.client for other in tool.sculpt.presence.others]


def heaviest(tool: Tool, bone: str) -> list[int]:
    """The vertices that follow this bone more than any other, the first of equals."""
    found = []
    for vertex, (joints, weights) in enumerate(zip(tool.sculpt.joints.tolist(),
                                                   tool.sculpt.weights.tolist())):
        first = joints[weights.index(max(weights))]
        if first != NO_BONE and tool.sculpt.bones[first] == bone:
            found.append(vertex)
    return found


def test_others_come_and_go(daemon, make_tool: Callable[..., Tool], script: Link) -> None:
    before = int(time.time())
    first = make_tool(name="first").create()
    assert names(first) == []
    second = make_tool(name="second").join()
    assert names(second) == ["first"]
    first.until(lambda: names(first) == ["second"])
    assert before <= first.sculpt.presence.others[0].since <= time.time()
    attach(script)
    first.until(lambda: names(first) == ["second", "script"])
    second.until(lambda: names(second) == ["first", "script"])
    version = first.sculpt.presence.version
    script.call("session.detach", {"session": "s"})
    first.until(lambda: names(first) == ["second"])
    assert first.sculpt.presence.version > version


def test_tools_of_the_same_name_see_each_other(daemon, make_tool: Callable[..., Tool]) -> None:
    first, second = make_tool(name="twin").create(), make_tool(name="twin")
    second.join()
    assert names(second) == ["twin"]
    first.until(lambda: names(first) == ["twin"])
    first.sculpt.presence.claim(vertices=np.array([4], np.uint32))
    first.settle()
    second.until(lambda: claimed(second) == [4])
    assert claimed(first) == NONE


def test_claims_are_seen(daemon, make_tool: Callable[..., Tool], script: Link) -> None:
    tool = make_tool().create()
    attach(script)
    claim(script, vertices=[5, 3, 3])
    tool.until(lambda: claimed(tool) == [3, 5])
    (other,) = tool.sculpt.presence.claiming
    assert (other.client, other.bones, other.vertices) == ("script", (), 2)
    bone = tool.sculpt.bones[1]
    claim(script, bones=[bone], vertices=[0])
    expected = sorted({0, *heaviest(tool, bone)})
    assert 2 < len(expected) < V
    tool.until(lambda: claimed(tool) == expected)
    assert tool.sculpt.presence.claiming[0].bones == (bone,)
    claim(script)
    tool.until(lambda: not tool.sculpt.presence.claiming)
    assert claimed(tool) == NONE
    claim(script, vertices=[1])
    tool.until(lambda: claimed(tool) == [1])
    script.close()
    tool.until(lambda: names(tool) == [])
    assert claimed(tool) == NONE


def test_who_comes_later_hears_of_the_claims_before(daemon, make_tool: Callable[..., Tool],
                                                    script: Link) -> None:
    make_tool(name="first").create()
    attach(script)
    claim(script, vertices=[7])
    late = make_tool(name="late").join()
    late.until(lambda: claimed(late) == [7])


def test_a_stroke_is_warned_where_the_mask_says_so(daemon, make_tool: Callable[..., Tool],
                                                   script: Link) -> None:
    """The mask follows the daemon's rule: its warning counts the same vertices."""
    tool = make_tool().create()
    attach(script)
    claim(script, bones=[tool.sculpt.bones[1]], vertices=list(range(0, V, 7)))
    tool.until(lambda: claimed(tool))
    for centre in (0, V // 2, V - 1):
        tool.settle()
        mask = tool.sculpt.presence.claimed(tool.sculpt.shown, tool.sculpt.bones)
        stroke = tool.stroke(centre)
        tool.settle()
        counts = [each["count"] for each in stroke.result["warnings"] if each["name"] == "claimed"]
        assert sum(counts) == mask[stroke.vertices].sum()


def test_our_claim_is_told_again_after_a_loss(daemon, make_tool: Callable[..., Tool],
                                              script: Link) -> None:
    tool = make_tool().create()
    attach(script)
    claim(script, vertices=[7])
    bone = tool.sculpt.bones[0]
    tool.sculpt.presence.claim(bones=[bone])
    tool.until(lambda: claimed(tool) == [7]).settle()
    alone: list[bool] = []
    tool.channel.on_lost = lambda reason: (tool.sculpt.lost(), alone.append(
        names(tool) == [] and claimed(tool) == NONE and bool(tool.sculpt.presence.own)))
    tool.cut()
    tool.until(lambda: tool.channel.generation == 2).settle()
    assert alone == [True]
    tool.until(lambda: claimed(tool) == [7])
    held = {each["client"]: each["claim"]
            for each in script.call("session.info", {"session": "s"})["present"]}
    assert held["tool"] == {"bones": [bone], "vertices": 0}
    tool.sculpt.presence.release()
    tool.settle()
    held = script.call("session.info", {"session": "s"})["present"]
    assert [each["claim"]["bones"] for each in held] == [[], []]


def test_our_claim_outlives_the_daemon(start, make_tool: Callable[..., Tool]) -> None:
    mortal = Mortal(start)
    tool = make_tool().create()
    tool.sculpt.presence.claim(vertices=np.array([1, 2], np.uint32))
    tool.settle()
    mortal.die()
    tool.settle()
    with mortal.daemon.link() as link:
        (alone,) = link.call("session.info", {"session": "s"})["present"]
    assert alone["claim"]["vertices"] == 2


def test_a_claim_that_is_refused_is_told_and_forgotten(daemon, make_tool: Callable[..., Tool]
                                                       ) -> None:
    tool = make_tool().create()
    tool.sculpt.presence.claim(bones=["no such bone"])
    tool.settle()
    assert "no such bone" in tool.sculpt.problem and not tool.sculpt.presence.own


def test_all_is_forgotten_when_the_session_ends(daemon, make_tool: Callable[..., Tool],
                                                script: Link) -> None:
    tool = make_tool().create()
    attach(script)
    claim(script, vertices=[7])
    tool.sculpt.presence.claim(vertices=np.array([1], np.uint32))
    tool.until(lambda: claimed(tool) == [7])
    script.call("session.close", {"session": "s"})
    tool.until(lambda: tool.sculpt.phase == "ended")
    presence = tool.sculpt.presence
    assert not presence.others and not presence.own and claimed(tool) == NONE


def test_a_claim_waits_while_there_is_no_connection() -> None:
    asked: list[tuple[str, dict]] = []
    is_up = False

    def ask(method: str, params: dict, done: Callable) -> None:
        if is_up:
            asked.append((method, params))
        else:
            done(None, SkindError(0, "lost", "skind is not connected"))

    presence = Presence(ask, pytest.fail)
    presence.claim(bones=["arm"])
    is_up = True
    presence.attached({"connection": 1, "present": []})
    assert asked == [("session.claim", {"bones": ["arm"]})]


def test_ties_and_empty_slots() -> None:
    joints = np.array([[1, 2], [2, 1], [NO_BONE, 1], [0, NO_BONE]], np.uint16)
    weights = np.array([[0.5, 0.5], [0.5, 0.5], [0, 0], [1, 0]], np.float32)
    state = State(joints, weights, np.zeros((4, 3), np.float32))
    presence = Presence(lambda *_: None, pytest.fail)
    presence._claims[3] = Claim(("one",))
    assert presence.claimed(state, ["zero", "one", "two"]).tolist() == [True, False, False, False]
    assert presence.claimed(state, ["zero", "one", "two"], slice(1, 3)).tolist() == [False] * 2


def test_names_for_people() -> None:
    presence = Presence(lambda *_: None, pytest.fail)
    presence.attached({"connection": 1, "present": [
        {"connection": number, "client": client, "user": user, "version": "", "since": 0,
         "claim": {"bones": [], "vertices": 0}}
        for number, client, user in ((1, "Blender 4.5 (0a1b2c)", "Anna"), (2, "Blender 4.5 (123456)", "Ben"),
                                     (3, "skinctl", "Ben"), (4, "skinctl", "Carl"), (5, "", ""))]})
    assert [(other.name, other.tool) for other in presence.others] == [
        ("Ben", "Blender 4.5"), ("Ben", "skinctl"), ("Carl", "skinctl"),
        ("another tool", "another tool")]
    assert called("Blender 4.5 (123456)", "Ben") == "Ben (Blender 4.5)"
    assert called("skinctl", "") == "skinctl"
