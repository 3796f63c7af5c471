"""core.sculpt and what the daemon keeps: a tool that comes back catches up, what had no answer is done
once, and a session that was closed is taken back with its history and pins.
"""

from __future__ import annotations

import contextlib
import resource
import sqlite3

import numpy as np
import pytest
from core import opening
from core.refitting import refit
from tools import Mortal, Other, Tool, V, no_session, same, sent_and_solved, some


def fetched(tool: Tool) -> int:
    """How often it has asked for all weights."""
    return tool.methods.count("weights.get")


def held(daemon, name: str = "s") -> dict:
    with daemon.link() as link:
        return link.call("session.info", {"session": name})


def pins(daemon) -> list[dict]:
    with daemon.link() as link:
        return link.call("pins.list", {"session": "s"})["pins"]


# ---- catching up ----


@pytest.mark.parametrize("others", [0, 1, 5])
def test_after_a_cut_only_what_was_missed_is_told(daemon, make_tool, others):
    tool, other = make_tool().create(), Other(daemon)
    tool.stroke(50)
    tool.settle()
    before = fetched(tool)
    tool.cut()
    for centre in np.linspace(5, 95, others).astype(int):
        other.stroke(centre)
    other.wait()
    tool.settle()
    assert (fetched(tool), tool.sculpt.revision) == (before, 1 + others)
    tool.check(other.link)


def test_after_a_death_without_loss_nothing_is_fetched(start, make_tool):
    """And the tool's undo is the daemon's: pins come back too."""
    mortal = Mortal(start)
    tool = make_tool().create()
    tool.stroke(50, angle=0.3)
    tool.settle()
    tool.stroke(50, angle=0.6)
    tool.settle()
    before, told = fetched(tool), pins(mortal.daemon)
    assert len(told) == 2
    mortal.die()
    tool.settle()
    assert fetched(tool) == before and pins(mortal.daemon) == told
    assert not tool.sculpt.problem, "nothing was forgotten"
    tool.undo()
    tool.settle()
    assert "weights.set" not in tool.methods
    assert len(pins(mortal.daemon)) == 1 and held(mortal.daemon)["redo_steps"] == 1


def test_a_session_made_again_says_so(start, make_tool):
    mortal = Mortal(start, forgets=True)
    tool = make_tool().create()
    tool.stroke(50)
    tool.settle()
    tool.sculpt.ask_pins()
    tool.settle()
    mortal.die()
    tool.settle()
    assert "sculpted in which pose" in tool.sculpt.problem and pins(mortal.daemon) == []


def test_what_happens_while_all_is_fetched_counts(start, make_tool):
    """Found: what another did between the fetch and the end of the resuming was not heard."""
    mortal = Mortal(start, forgets=True)
    tool = make_tool().create()
    tool.sculpt.keep(np.array([tool.pose(angle) for angle in (0.2, -0.3)]), 2)
    tool.stroke(50)
    tool.settle()
    late: list[Other] = []

    def meanwhile(method: str) -> None:
        if method == "guard.set" and not late:
            late.append(Other(mortal.daemon))
            late[0].stroke(20)
            late[0].wait()

    tool.on_request = meanwhile
    mortal.die()
    tool.settle()
    assert late
    tool.check(late[0].link)


def test_a_guard_taken_away_while_the_connection_is_lost(daemon, make_tool):
    """Found: only a guard that was set was told again, so the daemon kept the old poses."""
    tool = make_tool().create()
    tool.sculpt.keep(np.array([tool.pose(angle) for angle in (0.2, -0.3)]), 2)
    tool.settle()
    tool.cut()
    tool.sculpt.keep(None, 2)
    tool.settle()
    with daemon.link() as link:
        assert link.call("guard.get", {"session": "s"})["poses"] == []


def test_undone_while_others_were_at_work_on_the_same(daemon, make_tool):
    """Found: after the update that told what was missed nobody made the daemon follow."""
    tool, other = make_tool().create(), Other(daemon)
    stroke = tool.stroke(50)
    tool.settle()
    tool.cut()
    tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    other.set(stroke.vertices, np.random.default_rng(1))
    other.wait()
    tool.undo()
    tool.settle()
    tool.check(other.link)
    assert np.array_equal(tool.sculpt.weights, tool.sculpt.start.weights)


# ---- what has no answer ----


def ask(tool: Tool, what: str) -> None:
    """One change of each kind."""
    if what == "stroke":
        tool.stroke(30)
    elif what == "paint":
        tool.paint(some(np.random.default_rng(2), V), np.random.default_rng(3))
    elif what in ("undo", "redo"):
        getattr(tool, what)()
    else:
        tool.sculpt.edit(*{"prune": ("weights.prune", {"below": 0.05}),
                           "reduce": ("weights.reduce", {"influences": 2, "by": "size"}),
                           "clear": ("pins.clear", {})}[what], tool.edits.append)


@pytest.mark.parametrize("how", ["cut", "died"])
@pytest.mark.parametrize("done", [False, True])
@pytest.mark.parametrize("what", ["stroke", "paint", "undo", "redo", "prune", "reduce", "clear"])
def test_it_is_done_once(start, make_tool, what, done, how):
    """Whether the daemon had done it before the answer was lost, or never heard of it."""
    mortal = Mortal(start)
    tool = make_tool().create()
    tool.edits: list[dict] = []
    for centre in (50, 60):
        tool.stroke(centre)
        tool.settle()
    if what == "redo":
        tool.undo()
        tool.settle()
    before = held(mortal.daemon)
    if not done:
        mortal.pause()
    ask(tool, what)
    if done:
        sent_and_solved(tool, Other(mortal.daemon))
    if how == "died":
        mortal.die()
    else:
        tool.cut_unread() if done else tool.cut()
        if not done:
            mortal.go_on()
    tool.settle()
    after = held(mortal.daemon)
    assert after["revision"] == before["revision"] + 1, "once"
    assert after["instance"] == before["instance"]
    steps = {"undo": -1}.get(what, 1)
    assert after["undo_steps"] == before["undo_steps"] + steps
    assert len(tool.edits) == (what in ("prune", "reduce", "clear")) and not tool.sculpt.problem
    with mortal.daemon.link() as link:
        tool.check(link)


@pytest.mark.parametrize("options", [{}, {"residual": "shape"}])
def test_a_corrective_shape_whose_answer_was_lost(daemon, make_tool, options):
    """Vertices that have one keep it with any stroke."""
    tool = make_tool().create()
    tool.stroke(50, 0.05, options={"residual": "shape"})
    tool.settle()
    other = Other(daemon)
    tool.stroke(50, 0.03, options=options)
    sent_and_solved(tool, other)
    tool.cut_unread()
    tool.settle()
    tool.check(other.link)


@pytest.mark.parametrize("asked", [20, 200])
def test_many_that_wait_are_done_once_and_in_order(start, make_tool, asked):
    """More than the daemon remembers of a client; it has done some when it dies."""
    mortal = Mortal(start)
    tool, whole = make_tool().create(), make_tool(name="whole").create("whole")
    mortal.pause()
    for centre in range(asked):
        for each in (tool, whole):
            each.stroke(centre % V)
    mortal.go_on()
    tool.until(lambda: sum(each.is_answered for each in tool.sculpt.pending) > 3, showing=False)
    mortal.die()
    for each in (tool, whole):
        each.settle()
        assert each.sculpt.strokes == asked and not each.refused
        assert held(mortal.daemon, each.sculpt.name)["revision"] == asked


def test_an_edit_that_was_asked_for_without_a_connection(start, make_tool):
    """Found: it was forgotten."""
    mortal = Mortal(start)
    tool = make_tool().create()
    tool.stroke(50)
    tool.settle()
    mortal.die()
    tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    done: list[dict] = []
    tool.sculpt.edit("weights.prune", {"below": 0.2}, done.append)
    tool.stroke(20)
    tool.settle()
    assert done[0]["vertices"] > 0 and tool.sculpt.strokes == 2
    with mortal.daemon.link() as link:
        tool.check(link)


def test_a_session_that_ends_answers_what_waits(daemon, make_tool):
    """An edit that never went out is refused; nobody waits for it for ever."""
    tool = make_tool().create()
    tool.cut()
    tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    said: list = []
    poses = np.array([tool.pose(angle) for angle in (0.3, 0.6)])
    assert refit(tool.sculpt, poses, np.zeros((2, V, 3), np.float32), ["a", "b"], True,
                 lambda *answer: said.append(answer)) is not None
    opening.leave(tool.sculpt)
    (result, error), = said
    assert result is None and error.name == "lost"


def test_a_refit_that_is_given_up_without_a_connection(daemon, make_tool):
    tool = make_tool().create()
    tool.cut()
    tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    said: list = []
    poses = np.array([tool.pose(angle) for angle in (0.3, 0.6)])
    asked = refit(tool.sculpt, poses, np.zeros((2, V, 3), np.float32), ["a", "b"], True,
                  lambda *answer: said.append(answer))
    tool.sculpt.asks.cancel(asked)
    tool.settle()
    assert len(said) == 1 and "session.refit" not in tool.methods


def test_an_edit_that_changed_nothing_tells_no_revision(daemon, make_tool):
    """Found: its answer told the revision of a change before it, which was then passed over."""
    tool = make_tool().create()
    tool.stroke(50)
    tool.settle()
    (pose,) = pins(daemon)
    for number in range(5):
        tool.sculpt.edit("weights.prune", {"below": 0.02 * (number + 1)})
        tool.sculpt.edit("pins.weigh", {"pose": pose["pose"], "weight": 1.0})
    tool.settle()
    with daemon.link() as link:
        tool.check(link)


def test_a_stroke_with_rest_that_was_cancelled_and_one_that_cannot_be(start, make_tool):
    """From one pose rest cannot be told: it is solved without. Not if it was undone meanwhile."""
    mortal = Mortal(start)
    tool = make_tool().create()
    mortal.pause()
    kept = tool.stroke(30, options={"residual": "rest"})
    undone = tool.stroke(70, options={"residual": "rest"})
    tool.until(lambda: not tool.channel.unsent_bytes)
    tool.undo()
    mortal.go_on()
    tool.settle()
    assert kept.result and "residual" not in kept.options and undone.dropped and not undone.result
    assert tool.sculpt.strokes == 1 and held(mortal.daemon)["undo_steps"] == 1
    with mortal.daemon.link() as link:
        tool.check(link)


# ---- sessions that were closed ----


def close(daemon, method: str = "session.close") -> None:
    with daemon.link() as link:
        link.call(method, {"session": "s"})


def test_closed_while_the_tool_was_away(start, make_tool):
    mortal = Mortal(start)
    tool = make_tool().create()
    for centre in (50, 20):
        tool.stroke(centre)
        tool.settle()
    before, told = held(mortal.daemon), pins(mortal.daemon)
    tool.cut()
    tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    close(mortal.daemon)
    tool.stroke(80)
    tool.settle()
    after = held(mortal.daemon)
    assert after["instance"] == before["instance"] and after["undo_steps"] == 3
    assert pins(mortal.daemon)[0]["vertices"] > told[0]["vertices"]
    with mortal.daemon.link() as link:
        tool.check(link)


def test_deleted_while_the_tool_was_away(daemon, make_tool):
    """What was answered is there again, in a session that begins anew."""
    tool = make_tool().create()
    tool.stroke(50)
    tool.settle()
    kept = tool.sculpt.weights.copy()
    tool.cut()
    tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    close(daemon, "session.delete")
    tool.settle()
    assert np.array_equal(tool.sculpt.weights, kept)
    with daemon.link() as link:
        tool.check(link)


def test_another_closed_session_of_that_name_stays_closed(start, make_tool):
    """Of one that was on no disk nothing is left; the other is not it."""
    mortal = Mortal(start)
    older = make_tool(name="older").create()
    older.stroke(50)
    older.settle()
    opening.leave(older.sculpt)
    older.until(lambda: not older.channel.unanswered)
    tool = make_tool().create(durability="off")
    tool.stroke(20)
    tool.settle()
    kept = tool.sculpt.weights.copy()
    mortal.die()
    tool.settle()
    assert np.array_equal(tool.sculpt.weights, kept)
    with mortal.daemon.link() as link:
        tool.check(link)
        listed = link.call("session.list")
        assert [each["durability"] for each in listed["sessions"]] == ["off"]
        assert [each["session"] for each in listed["closed"]] == ["s"]


def test_a_closed_session_is_taken_back_with_its_history(daemon, make_tool):
    first = make_tool().create()
    first.stroke(50)
    first.settle()
    kept, instance = first.sculpt.shown.copy(), first.sculpt.instance
    opening.leave(first.sculpt)
    first.until(lambda: not first.channel.unanswered)
    tool = make_tool(name="later").connect()
    opening.join(tool.sculpt, "s")
    tool.begin("joining")
    assert tool.sculpt.reason == "no_session", "only who asks for it gets it"
    opening.join(tool.sculpt, "s", kept="0" * 16)
    tool.begin("joining")
    assert tool.sculpt.reason == "no_session", "another one of that name is not it"
    opening.join(tool.sculpt, "s", kept=instance)
    tool.begin("joining")
    assert tool.sculpt.phase == "ready" and same(tool.sculpt.shown, kept)
    assert held(daemon)["undo_steps"] == 1 and len(pins(daemon)) == 1
    with daemon.link() as link:
        tool.check(link)


def test_a_closed_session_of_another_mesh_stays_closed(daemon, make_tool, params):
    with daemon.link() as link:
        theirs = {**params, "positions": params["positions"] + np.float32(1)}
        instance = link.call("session.create", {"name": "s", **theirs})["instance"]
        other = Other(daemon)
        other.stroke(50)  # who closes one in which nothing was done throws it away
        other.wait()
    close(daemon)
    tool = make_tool().connect()
    opening.join(tool.sculpt, "s", kept=instance)
    tool.begin("joining")
    tool.until(lambda: not tool.channel.unanswered)
    assert tool.sculpt.reason == "another_mesh"
    with daemon.link() as link:
        assert no_session(link)
        assert [each["session"] for each in link.call("session.list")["closed"]] == ["s"]


# ---- what is told of the disk ----


def test_a_full_disk_is_told_as_long_as_it_is_full(daemon, make_tool):
    tool, other = make_tool().create(), make_tool(name="other").join()
    pid = daemon.process.pid
    limits = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        tool.stroke(50)
        for each in (tool, other):
            each.until(lambda: each.sculpt.unkept)
        tool.settle()
        tool.cut()
        tool.settle()
        assert tool.sculpt.unkept, "who comes back is told, too"
    finally:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)
    for each in (tool, other):
        each.until(lambda: not each.sculpt.unkept)
    with daemon.link() as link:
        tool.check(link)


def test_damage_is_told(start, folder, make_tool):
    """What the daemon has left is shown, and what it lost is said."""
    state = folder / "state"
    daemon = start("--state", str(state))
    tool = make_tool().create()
    for centre in (20, 50, 80):
        tool.stroke(centre)
        tool.settle()
    kept = tool.sculpt.shown.copy()
    assert not tool.sculpt.damage
    assert daemon.stop() == 0
    (file,) = state.glob("*.skind")
    with contextlib.closing(sqlite3.connect(file)) as database, database:
        database.execute("update steps set weights = zeroblob(length(weights)) "
                         "where id = (select max(id) from steps)")
    daemon = start("--state", str(state))
    tool.settle()
    assert tool.sculpt.damage == held(daemon)["damage"]
    tool.undo()
    tool.settle()
    assert same(tool.sculpt.shown, kept), "undo shows what was lost"
    with daemon.link() as link:
        tool.check(link)
