"""core.sculpt and core.opening against the real daemon: what is shown, what is believed and what
the daemon holds are the same in the end, whatever others do and whatever breaks.
"""

from __future__ import annotations

import subprocess

import numpy as np
import pytest
import schemas
from core import opening
from core.asks import Stroke
from core.refitting import refit
from core.rig import Y_UP
from daemons import BIN
from tools import Mortal, Other, Tool, V, no_session, rigs, same, sent_and_solved, some


# ---- opening ----


@pytest.mark.parametrize("influences", [4, 8])
def test_created_and_ready(daemon, make_tool, params, influences):
    tool = make_tool().create("My Knight.001", influences)
    sculpt = tool.sculpt
    assert (sculpt.phase, sculpt.problem, sculpt.name) == ("ready", "", "My-Knight.001")
    with daemon.link() as link:
        held = link.call("weights.get", {"session": sculpt.name})
        info = link.call("session.info", {"session": sculpt.name})
        tool.check(link)
    assert sculpt.vertices == V and sculpt.influences == influences
    assert sculpt.joints.dtype == np.uint16 and np.array_equal(sculpt.joints, held["joints"])
    assert sculpt.start.weights.tobytes() == held["weights"].tobytes()
    assert (sculpt.length, sculpt.revision) == (info["length"], 0)
    assert sculpt.bones == params["bones"]["names"] and np.isnan(sculpt.residual).all()
    posed = sculpt.posed(slice(None), rigs.bent(0.4).reshape(-1, 4, 4))
    assert np.allclose(posed, rigs.skin(params, rigs.bent(0.4), held["joints"], held["weights"]),
                       atol=1e-12)


def test_start_weights_stay_what_they_were(daemon, make_tool):
    tool = make_tool().create()
    start = tool.sculpt.start.weights.copy()
    stroke = tool.stroke(55)
    tool.settle()
    assert np.array_equal(tool.sculpt.start.weights, start)
    assert not np.array_equal(tool.sculpt.weights, start)
    assert tool.sculpt.strokes == 1 and tool.sculpt.last["vertices"] == len(stroke.vertices)
    with daemon.link() as link:
        posed = link.call("pose.evaluate", {"session": "s", "pose": stroke.pose_name,
                                            "vertices": stroke.vertices})["positions"]
    apart = np.linalg.norm(posed.astype(float) - stroke.targets, axis=1)
    assert np.allclose(tool.sculpt.residual[stroke.vertices], apart, atol=1e-6)
    assert np.isnan(np.delete(tool.sculpt.residual, stroke.vertices)).all()


def test_names_that_are_taken_get_numbers(daemon, make_tool):
    names = [make_tool(name=f"tool{i}").create("Body").sculpt.name for i in range(3)]
    assert names == ["Body", "Body-2", "Body-3"]


def test_any_text_makes_a_name_that_the_protocol_takes():
    random = np.random.default_rng(1)
    letters = [chr(code) for code in range(128)] + list("äßЖ漢字🙂\u200b\u0301\u2028")
    letters += ["..", "--"]
    wishes = ["", ".", "-", "...", ".hidden", "-x", "a" * 200, ".a" * 60, "name\n", "\n", "é" * 90,
              "Körper.001", "_", "a/b\\c", "\x00"]
    wishes += ["".join(random.choice(letters, random.integers(90))) for _ in range(600)]
    for wish in wishes:
        made = [opening.session_name(wish, attempt) for attempt in (1, 2, 10, 99)]
        assert len(set(made[1:])) == 3, "numbers must tell names apart"
        for name in made:
            schemas.check("common", name, "session")
    assert opening.session_name("Körper.001") == "K-rper.001"
    assert opening.session_name("a" * 80, 12) == "a" * 61 + "-12"


def test_refused_at_the_start(daemon, make_tool, params):
    params["influence_joints"][3] = 4000
    tool = make_tool().create()
    assert tool.sculpt.phase == "ended" and tool.sculpt.problem and tool.sculpt.reason
    with daemon.link() as link:
        assert no_session(link)


@pytest.mark.parametrize("after", ["session.create", "session.attach", "weights.get"])
def test_ended_while_creating_leaves_nothing(daemon, make_tool, after):
    tool = make_tool().connect()
    tool.on_request = lambda method: method == after and opening.leave(tool.sculpt)
    opening.create(tool.sculpt, "s", 4, False)
    tool.until(lambda: "session.close" in tool.methods and not tool.channel.unanswered)
    assert (tool.sculpt.phase, tool.sculpt.problem) == ("ended", "")
    with daemon.link() as link:
        assert no_session(link)


def test_lost_while_creating_is_an_end(daemon, make_tool):
    tool = make_tool().connect()
    opening.create(tool.sculpt, "s", 4, False)
    tool.cut()
    tool.until(lambda: tool.sculpt.phase != "creating", budget_s=0.0)
    assert (tool.sculpt.phase, tool.sculpt.reason) == ("ended", "lost") and tool.sculpt.problem
    opening.create(tool.sculpt, "s", 4, False)  # while there is no connection at all
    assert (tool.sculpt.phase, tool.sculpt.reason) == ("ended", "lost")


# ---- joining ----


def test_joins_a_session_of_the_same_mesh(daemon, make_tool, params):
    """Its bones are fewer and in another order than the tool's."""
    order = np.array([7, 3, 11, 0, 1, 2, 4, 5, 6, 8, 9, 10])
    theirs = {**params, "influences": 8, "bones": {
        "names": [params["bones"]["names"][bone] for bone in order],
        "parents": np.full(12, -1, np.int32), "binds": params["bones"]["binds"][order]}}
    theirs["influence_joints"] = np.argsort(order)[params["influence_joints"]].astype(np.uint16)
    spare = np.eye(4).reshape(1, 16)
    params["bones"] = {"names": [*params["bones"]["names"], "spare"], "parents": np.arange(-1, 12),
                       "binds": np.concatenate([params["bones"]["binds"], spare])}
    with daemon.link() as link:
        link.call("session.create", {"name": "s", **theirs})
        tool = make_tool().join()
        sculpt = tool.sculpt
        assert (sculpt.phase, sculpt.problem, sculpt.influences) == ("ready", "", 8)
        held = link.call("weights.get", {"session": "s"})["joints"]
        assert np.array_equal(sculpt.joints, np.where(held == 65535, 65535,
                                                      order[np.where(held == 65535, 0, held)]))
        stroke = tool.stroke(50)
        tool.settle()
        tool.check(link)
        check_where_it_is(tool, link, stroke, np.eye(3))
        opening.leave(sculpt)
        tool.until(lambda: not tool.channel.unanswered)
        assert no_session(link), "the last of those that made it closes it"


def check_where_it_is(tool: Tool, link, stroke: Stroke, turn: np.ndarray) -> None:
    """The daemon's posed vertices and ours are the same points, and so are the residuals."""
    posed = link.call("pose.evaluate", {"session": "s", "pose": stroke.pose_name})["positions"]
    assert np.allclose(posed, tool.sculpt.posed(slice(None), stroke.pose) @ turn.T, atol=1e-5)
    told = tool.sculpt.last["residual"]
    ours = tool.sculpt.residual[stroke.vertices]
    assert told["after"]["max"] == pytest.approx(ours.max(), abs=1e-5)
    assert told["after"]["mean"] < told["before"]["mean"]


@pytest.mark.parametrize("why, says", [("vertices", "has 121 vertices"), ("bone", '"bone.4"'),
                                       ("places", "other places"), ("none", "no session")])
def test_what_is_not_of_this_mesh_is_not_joined(daemon, make_tool, params, why, says):
    with daemon.link() as link:
        if why != "none":
            theirs = rigs.sheet(121) if why == "vertices" else dict(params)
            if why == "places":
                theirs["positions"] = params["positions"].copy()
                theirs["positions"][7] += np.float32(0.001)
            link.call("session.create", {"name": "s", **theirs})
        if why == "bone":
            params["bones"]["names"][4] = "renamed"
        tool = make_tool().join()
        assert tool.sculpt.phase == "ended" and says in tool.sculpt.problem
        assert tool.sculpt.reason == ("no_session" if why == "none" else "another_mesh")
        listed = link.call("session.list")["sessions"]
        assert [each["attached"] for each in listed] == ([] if why == "none" else [0])


def test_a_new_session_after_one_that_could_not_be_joined(daemon, make_tool):
    """Found: the problem of the first try stayed."""
    tool = make_tool().join("gone")
    assert tool.sculpt.reason == "no_session"
    opening.create(tool.sculpt, "gone", 4, False)
    tool.begin("creating")
    assert (tool.sculpt.phase, tool.sculpt.problem, tool.sculpt.reason) == ("ready", "", "")


def test_joins_a_file_from_a_program_with_z_up(start, folder, join_file):
    made = folder / "character.glb"
    subprocess.run([BIN / "skinctl", "generate", "--vertices", "1000", made], check=True,
                   capture_output=True)
    mortal = Mortal(start)
    tool = join_file(mortal.daemon, made)
    assert (tool.sculpt.phase, tool.sculpt.problem) == ("ready", "")
    assert tool.sculpt.source == str(made)
    with mortal.daemon.link() as link:
        stroke = tool.stroke(50)
        tool.settle()
        tool.check(link)
        check_where_it_is(tool, link, stroke, Y_UP[:3, :3])
    mortal.die()  # it is made again from its file
    tool.undo()
    tool.settle()
    with mortal.daemon.link() as link:
        tool.check(link)
        assert link.call("session.info", {"session": "s"})["source"] == tool.sculpt.source
        opening.leave(tool.sculpt)
        tool.until(lambda: not tool.channel.unanswered)
        assert not no_session(link), "a file's session has a life of its own"


# ---- refit ----


@pytest.mark.parametrize("slots", [False, True])
def test_refit_wins_weights_back_and_is_undone(daemon, make_tool, slots):
    tool = make_tool().create()
    sculpt = tool.sculpt
    poses = np.array([tool.pose(angle) for angle in (-0.9, -0.5, 0.4, 0.8, 0.8)])
    right = np.array([sculpt.posed(slice(None), pose) for pose in poses], np.float32)
    tool.paint(np.arange(V, dtype=np.uint32), np.random.default_rng(5))
    tool.settle()
    answers: list = []
    wanted = right.copy()
    wanted[4] += 1  # the same pose again: its first positions count
    labels = [f"frame {number}" for number in range(len(poses))]
    assert refit(sculpt, poses, wanted, labels, slots,
                 lambda *said: answers.append(said)) is not None
    tool.settle()
    (result, error), = answers
    assert error is None and result["vertices"] == V
    apart = [np.abs(sculpt.posed(slice(None), pose) - place).max()
             for pose, place in zip(poses, right)]
    assert max(apart) < 1e-4 * sculpt.length < 1e-2 * result["residual"]["before"]["mean"]
    with daemon.link() as link:
        tool.check(link)
        tool.undo()
        tool.settle()
        tool.check(link)


def test_refit_needs_poses_that_differ(daemon, make_tool):
    tool = make_tool().create()
    pose = tool.pose(0.3)
    places = np.zeros((2, V, 3), np.float32)
    said: list = []
    assert refit(tool.sculpt, np.array([pose, pose]), places, ["a", "b"], True,
                 lambda *answer: said.append(answer)) is None
    tool.settle()
    assert said == [] and tool.sculpt.revision == 0


# ---- leaving ----


def test_leaving_closes_what_is_ours_and_nobody_elses(daemon, make_tool):
    tool = make_tool().create()
    opening.leave(tool.sculpt)
    assert tool.sculpt.phase == "ended"
    tool.until(lambda: not tool.channel.unanswered)
    with daemon.link() as link:
        assert no_session(link)


def test_leaving_leaves_it_to_others(daemon, make_tool):
    tool = make_tool().create()
    with daemon.link() as link:
        link.call("session.attach", {"session": "s"})
        opening.leave(tool.sculpt)
        tool.until(lambda: not tool.channel.unanswered)
        listed = link.call("session.list")["sessions"]
        assert [(each["session"], each["attached"]) for each in listed] == [("s", 1)]


def test_closed_by_another(daemon, make_tool):
    tool = make_tool().create()
    with daemon.link() as link:
        link.call("session.close", {"session": "s"})
    tool.until(lambda: tool.sculpt.phase == "ended")
    assert "closed" in tool.sculpt.problem
    shown = tool.sculpt.weights.copy()
    tool.stroke(3)  # nobody is there to solve it
    tool.until(lambda: not tool.channel.unanswered)
    assert np.array_equal(tool.sculpt.weights, shown)


# ---- strokes, undo, others ----


def test_one_undo_a_stroke_is_one_undo_of_the_daemon(daemon, make_tool):
    tool = make_tool().create()
    with daemon.link() as link:
        for centre in (10, 50, 90):
            tool.stroke(centre)
            tool.settle()
        for presses in (1, 2, 3):
            tool.undo()
            tool.settle()
            info = link.call("session.info", {"session": "s"})
            assert (info["undo_steps"], info["redo_steps"]) == (3 - presses, presses)
        assert np.array_equal(tool.sculpt.weights, tool.sculpt.start.weights)
        for _ in range(3):
            tool.redo()
        tool.settle()
        info = link.call("session.info", {"session": "s"})
        assert (info["undo_steps"], info["redo_steps"], info["revision"]) == (3, 0, 9)
        assert "weights.set" not in tool.methods
        tool.check(link)


def test_dropped_before_its_answer(daemon, make_tool):
    tool = make_tool().create()
    with daemon.link() as link:
        for pumps in (0, 1, 3):
            tool.stroke(50)
            for _ in range(pumps):
                tool.channel.pump()
            tool.undo()
            tool.settle()
            tool.check(link)
        assert np.array_equal(tool.sculpt.weights, tool.sculpt.start.weights)
        assert tool.sculpt.strokes == 0 and len(tool.stack) == 1


def test_the_later_of_two_answered_strokes_is_dropped(daemon, make_tool):
    """Found: two arrivals of ours could not be told apart."""
    tool = make_tool().create()
    tool.stroke(50)
    tool.stroke(50)
    tool.until(lambda: len(tool.sculpt.arrived) == 2, showing=False)
    tool.undo()
    tool.settle()
    assert tool.sculpt.strokes == 1
    with daemon.link() as link:
        tool.check(link)
        assert link.call("session.info", {"session": "s"})["undo_steps"] == 1


def test_a_pose_solved_again_on_the_vertices_of_a_stroke(daemon, make_tool):
    """Found in a storm: told late, it was taken for the stroke, whose pose is another."""
    tool = make_tool().create()
    first = tool.stroke(50, 0.05, options={"residual": "shape"})
    tool.settle()
    for round in range(5):
        tool.sculpt.edit("weights.prune", {"below": 0.02 * round})  # from here on updates come late
        tool.stroke(50, 0.04, angle=0.5)
        tool.sculpt.edit("pins.solve", {"pose": first.pose_name})
        tool.stroke(50, 0.03, angle=0.5)
    tool.settle()
    with daemon.link() as link:
        tool.check(link)


@pytest.mark.parametrize("is_shown", [False, True])
def test_a_stroke_that_changed_nothing_is_no_step(daemon, make_tool, is_shown):
    """Found: its undo was an undo of the step before it."""
    tool = make_tool().create()
    tool.stroke(20)
    tool.settle()
    nothing = np.empty(0, np.uint32), np.empty((0, 3), np.float32)
    tool.sculpt.stroke(*nothing, tool.pose(0.3), {})
    tool.until(lambda: tool.sculpt.pending[0].result, showing=False)
    assert tool.sculpt.pending[0].result["vertices"] == 0
    if is_shown:
        tool.settle()
    tool.undo()
    tool.settle()
    with daemon.link() as link:
        assert link.call("session.info", {"session": "s"})["undo_steps"] == 1
        tool.check(link)


def test_what_others_bring_back_stays(daemon, make_tool):
    """Found: a dropped stroke that another redid was undone again, if only for a moment."""
    tool = make_tool().create()
    other = Other(daemon)
    tool.stroke(50)
    tool.until(lambda: tool.sculpt.arrived, showing=False)
    tool.undo()
    tool.settle()
    other.send("history.redo")
    other.wait()
    tool.settle()
    tool.paint(np.arange(5, dtype=np.uint32), np.random.default_rng(1))
    tool.settle()
    assert tool.methods.count("history.undo") == 1 and tool.methods[-1] == "weights.set"
    tool.check(other.link)


def test_an_undo_waits_for_what_arrived_and_then_goes_out(daemon, make_tool):
    """Found: after the last arrival was shown nobody made the daemon follow."""
    tool = make_tool().create()
    tool.stroke(20)
    tool.settle()
    other = Other(daemon)
    other.stroke(80)
    other.wait()
    tool.until(lambda: tool.sculpt.arrived, showing=False)
    tool.undo()
    tool.settle()
    tool.check(other.link)


def test_anothers_change_arrives_while_ours_is_being_set(daemon, make_tool):
    """Found: what was set under an arrival was not what was shown in the end."""
    random = np.random.default_rng(5)
    tool = make_tool().create()
    other = Other(daemon)
    vertices = np.arange(20, dtype=np.uint32)
    tool.paint(vertices, random)  # queued in the tool, not sent yet
    other.set(vertices, random)
    other.wait()
    tool.settle()
    tool.check(other.link)


def test_rows_that_the_daemon_scales_come_back(daemon, make_tool):
    """Found: what weights.set had scaled was not what was believed."""
    tool = make_tool().create()
    rows = tool.sculpt.weights[:10].copy()
    rows[:, 0] += np.float32(4e-4)
    tool.sculpt.painted(np.arange(10, dtype=np.uint32), rows)
    tool.push()
    tool.settle()
    with daemon.link() as link:
        tool.check(link)


def test_rows_that_the_daemon_refuses_are_taken_back(daemon, make_tool):
    tool = make_tool().create()
    before = tool.sculpt.weights.copy()
    rows = before[:10].copy()
    rows[:, 0] += 1
    tool.sculpt.painted(np.arange(10, dtype=np.uint32), rows)
    tool.push()
    tool.settle()
    assert tool.sculpt.problem and np.array_equal(tool.sculpt.weights, before)
    with daemon.link() as link:
        tool.check(link)


def test_a_stroke_is_refused(daemon, make_tool):
    tool = make_tool().create()
    vertices, targets, pose = tool.bump(30)
    targets[0] = np.nan
    refused = tool.sculpt.stroke(vertices, targets, pose, {})
    tool.stroke(60)
    tool.settle()
    assert tool.refused == [refused] and refused.error.name == "not_finite"
    assert tool.sculpt.strokes == 1
    with daemon.link() as link:
        tool.check(link)


def test_others_undo_and_redo_what_was_there_before_us(daemon, make_tool):
    """The daemon's history is longer than what a tool saw of it after a loss."""
    tool = make_tool().create()
    other = Other(daemon)
    for centre in (20, 40):
        tool.stroke(centre)
        tool.settle()
    tool.cut()
    tool.until(lambda: tool.channel.generation == 2)
    tool.stroke(60)
    tool.settle()
    for method in ["history.undo"] * 3 + ["history.redo"] * 2 + ["history.undo"]:
        other.send(method)
        other.wait()
        tool.settle()
        tool.check(other.link)
    for _ in range(3):
        tool.undo()
        tool.settle()
        tool.check(other.link)


# ---- the connection alone breaks ----


def test_cut_and_others_go_on(daemon, make_tool):
    random = np.random.default_rng(3)
    tool = make_tool().create()
    other = Other(daemon)
    tool.stroke(50)
    tool.settle()
    tool.cut()
    for centre in (5, 55):
        other.stroke(centre)
    other.set(some(random, V), random)
    other.wait()
    theirs = other.call("weights.get")["weights"]
    tool.settle()
    assert np.array_equal(tool.sculpt.weights, theirs), "catching up shows what others did"
    tool.check(other.link)
    assert len(tool.stack) == 3, "in one step"
    tool.undo()
    tool.settle()
    tool.check(other.link)


def test_cut_with_a_stroke_solved_that_nobody_told_us_of(daemon, make_tool):
    """It is asked for again; not shown as if it were another's."""
    tool = make_tool().create()
    other = Other(daemon)
    tool.stroke(50)
    sent_and_solved(tool, other)
    tool.cut_unread()
    tool.settle()
    tool.check(other.link)
    assert tool.sculpt.strokes == 1 and len(tool.stack) == 2
    tool.undo()
    tool.settle()
    assert np.array_equal(tool.sculpt.weights, tool.sculpt.start.weights)
    tool.check(other.link)


@pytest.mark.parametrize("when", ["before", "lost", "resumed"])
def test_cut_with_a_stroke_solved_and_then_undone(daemon, make_tool, when):
    """Found: its result came back as a change of others, or stayed in the daemon alone."""
    tool = make_tool().create()
    other = Other(daemon)
    tool.stroke(50)
    sent_and_solved(tool, other)
    tool.cut_unread()
    if when == "lost":
        tool.until(lambda: tool.sculpt.phase == "lost", budget_s=0.0)
    elif when == "resumed":
        tool.until(lambda: tool.methods.count("stroke.apply") == 2, budget_s=0.0)
    tool.undo()
    tool.settle()
    tool.check(other.link)
    assert np.array_equal(tool.sculpt.weights, tool.sculpt.start.weights)
    assert len(tool.stack) == 1


def test_the_tool_undoes_while_it_does_not_know_of_the_loss(daemon, make_tool):
    """Found: endless, because each try failed at once and asked for the next."""
    tool = make_tool().create()
    for centre in (20, 70):
        tool.stroke(centre)
        tool.settle()
    tool.undo()  # asked for and not answered
    tool.cut()
    tool.until(lambda: tool.channel.state != "ready", budget_s=0.0)
    assert tool.sculpt.phase == "ready"
    tool.undo()
    tool.settle()
    with daemon.link() as link:
        tool.check(link)
    assert np.array_equal(tool.sculpt.weights, tool.sculpt.start.weights)


def test_left_while_resuming(daemon, make_tool):
    """Found: a session that was left came back to life."""
    tool = make_tool().create()
    tool.cut()
    tool.until(lambda: tool.sculpt.phase == "resuming", budget_s=0.0)
    opening.leave(tool.sculpt)
    tool.until(lambda: "session.close" in tool.methods and not tool.channel.unanswered)
    assert tool.sculpt.phase == "ended"
    with daemon.link() as link:
        assert no_session(link)


def test_another_session_of_that_name_is_left_alone(daemon, make_tool, params):
    tool = make_tool().create()
    tool.stroke(50)
    tool.settle()
    shown = tool.sculpt.weights.copy()
    tool.cut()
    with daemon.link() as link:
        link.call("session.close", {"session": "s"})
        link.call("session.create", {"name": "s", "influences": 8, **params})
        tool.until(lambda: tool.sculpt.phase == "ended" and not tool.channel.unanswered)
        assert "another one now" in tool.sculpt.problem
        assert np.array_equal(tool.sculpt.weights, shown)
        listed = link.call("session.list")["sessions"]
        assert [(each["session"], each["attached"]) for each in listed] == [("s", 0)]
