"""skinctl over more than one pose: pins, guards, edits of weights, shapes, refit.

Oracles: NumPy for matching, sums and point caches; the positions that the session itself shows."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from test_cli import VERTICES, Cli, body, cli, humanoid  # noqa: F401

STROKE = ["stroke", "bent", "--bone", "forearm.L", "--radius", 0.1, "--out", 0.01]


@pytest.fixture
def posed(body: Cli) -> Cli:  # noqa: F811
    """The character with a second pose."""
    body.run("pose", "raised", "--clip", "bend", "--time", "0.6")
    return body


def rows(cli: Cli) -> tuple[np.ndarray, np.ndarray]:  # noqa: F811
    joints, weights = cli.weights()
    return joints.reshape(VERTICES, -1), weights.reshape(VERTICES, -1)


# ---- pins ----


def test_pins_of_two_poses(posed: Cli) -> None:
    assert posed.run("pins", "list").stdout == "nothing is pinned\n"
    at = posed.positions("bent")
    wanted = at[[7, 9]] + np.float32(0.01)
    (posed.folder / "t").write_text("".join(
        f"{v} {x!r} {y!r} {z!r}\n" for v, (x, y, z) in zip((7, 9), wanted.tolist())))
    assert posed.json("stroke", "bent", "--vertices", "t")["poses"] == 1
    second = posed.json("stroke", "raised", "--vertex", "7=" + ",".join(
        map(str, posed.positions("raised")[7] + np.float32(0.01))))
    assert second["poses"] == 2, "the stroke keeps the other pose's target in mind"
    pins = posed.json("pins", "list")["pins"]
    assert [(pin["pose"], pin["current"]) for pin in pins] == [("bent", True), ("raised", True)]
    table = np.array([line.split() for line in posed.run("pins", "list", "bent")
                      .stdout.splitlines()], float)
    found = dict(zip(table[:, 0].astype(int), table[:, 1:4]))
    assert np.allclose([found[7], found[9]], wanted, atol=1e-7) and set(table[:, 4]) == {1}
    posed.json("pins", "weigh", "bent", 3, "--vertices", 9)
    weights = {int(line.split()[0]): float(line.split()[4])
               for line in posed.run("pins", "list", "bent").stdout.splitlines()}
    assert weights[9] == 3 and weights[7] == 1
    solved = posed.run("pins", "solve", "bent", "--stiffness", 0.001)
    assert "bent: " in solved.stdout and "2 poses" in solved.stdout
    assert "stiffness 0.001" in solved.stdout
    posed.run("pins", "clear", "raised")
    assert [pin["pose"] for pin in posed.json("pins", "list")["pins"]] == ["bent"]
    posed.run("undo")
    assert len(posed.json("pins", "list")["pins"]) == 2, "clearing is a step to undo"
    posed.run("pose", "bent", "--clip", "bend", "--time", "0.2")
    assert "bent (as it was before)" in posed.run("pins", "list").stdout
    posed.run("pins", "clear")
    assert posed.json("pins", "list")["pins"] == []


def test_strokes_that_pin_nothing_or_go_half_the_way(posed: Cli) -> None:
    whole = posed.json(*STROKE, "--pin", "none", "--stiffness", 0.001)
    assert posed.json("pins", "list")["pins"] == []
    assert len(whole["residuals"]) > 10
    assert max(whole["residuals"]) == pytest.approx(whole["residual"]["after"]["max"], rel=1e-5)
    posed.run("undo")
    half = posed.json(*STROKE, "--mix", 0.5, "--stiffness", 0.001)
    assert half["residual"]["before"]["mean"] == pytest.approx(
        whole["residual"]["before"]["mean"], rel=1e-4) or (
        half["residual"]["before"]["mean"] == pytest.approx(
            whole["residual"]["before"]["mean"] / 2, rel=1e-4))
    at = posed.positions("bent")
    (posed.folder / "t").write_text("7 0 9 0 0\n")  # a mask of 0: it stays where it is
    masked = posed.json("stroke", "bent", "--vertices", "t")
    assert np.allclose(posed.positions("bent"), at, atol=1e-6), masked


def test_scripts_say_how_to_solve(posed: Cli) -> None:
    (posed.folder / "s.yaml").write_text(
        "strokes:\n"
        "  - {pose: bent, brush: {bone: forearm.L, radius: 0.1, out: 0.01}, stiffness: 0.25,\n"
        "     pin: none, smooth: 0.1, guard: 0, mix: 0.5, slots: keep, residual: report}\n")
    (stroke,) = posed.json("replay", "s.yaml")["strokes"]
    assert stroke["stiffness"] == 0.25 and "residuals" not in stroke
    assert posed.json("pins", "list")["pins"] == []
    (stroke,) = posed.json("replay", "s.yaml", "--stiffness", 0.125, "--pin", "set")["strokes"]
    assert stroke["stiffness"] == 0.125, "the command line goes above the script"
    assert len(posed.json("pins", "list")["pins"]) == 1


def test_shapes_take_what_weights_cannot_reach(posed: Cli) -> None:
    text = posed.run("shapes").stdout
    assert text == "there are no corrective shapes\n0 vertices have another rest position\n"
    stroke = posed.json(*STROKE, "--residual", "shape")
    assert stroke["shaped"] > 0 and stroke["residual"]["after"]["max"] < 1e-5
    shapes = posed.json("shapes")["shapes"]
    assert shapes == [{"pose": "bent", "vertices": stroke["shaped"], "current": True}]
    offsets = np.array([line.split() for line in posed.run("shapes", "bent").stdout.splitlines()],
                       float)
    assert offsets.shape == (stroke["shaped"], 4) and np.abs(offsets[:, 1:]).max() > 1e-4
    refused = posed.run(*STROKE, "--residual", "rest", status=1)
    assert "second pose" in refused.stderr and refused.stdout == ""


# ---- guards ----


def test_guard(posed: Cli) -> None:
    assert posed.run("guard").stdout == "no poses are guarded\n"
    picked = posed.json("guard", "--clip", "bend", "--pose", "raised", "--count", 3)
    assert len(picked["poses"]) == 3 < picked["candidates"]
    assert {pose["source"] for pose in picked["poses"]} <= {"clip", "pose"}
    assert posed.json("guard") == picked
    table = posed.run("guard").stdout.splitlines()
    assert table[0].startswith("3 of ") and len(table) == 5
    posed.run("guard", "--clip", "nosuch", status=1)
    assert posed.json("guard") == picked, "what was refused changed nothing"
    assert posed.json("guard", "--clear")["poses"] == []
    assert posed.run("guard").stdout == "no poses are guarded\n"


# ---- edits ----


def test_mirror_makes_the_sides_alike(posed: Cli) -> None:
    posed.run(*STROKE)
    rest = posed.positions("rest")
    names = [bone["name"] for bone in posed.json("info")["bones"]]
    side = posed.positions("rest")[np.array(rows(posed)[0])[:, 0] == names.index("forearm.L"), 0]
    sign = "+" if side.mean() > 0 else "-"
    mirrored = posed.json("weights", "mirror", "--from", sign)
    assert mirrored["revision"] == 2 and mirrored["unmatched"] < 10
    assert mirrored["vertices"] > 10 and mirrored["unpaired_bones"] == []
    joints, weights = rows(posed)
    swap = str.maketrans("LR", "RL")
    other = [names.index(name[:-1] + name[-1].translate(swap)) if name.endswith((".L", ".R"))
             else i for i, name in enumerate(names)]
    dense = np.zeros((VERTICES, len(names) + 1), np.float32)
    np.add.at(dense, (np.arange(VERTICES)[:, None], np.minimum(joints, len(names))), weights)
    written = np.flatnonzero(rest[:, 0] * (1 if sign == "+" else -1) < -1e-3)
    image = rest * np.float32([-1, 1, 1])
    gaps = np.array([np.linalg.norm(rest - image[vertex], axis=1).min() for vertex in written])
    assert (gaps > 2e-3).sum() < 10
    for vertex in written[gaps < 1e-4]:
        source = np.argmin(((rest - image[vertex]) ** 2).sum(1))
        expected = np.zeros(len(names) + 1, np.float32)
        expected[other] = dense[source, :-1]
        assert np.abs(dense[vertex] - expected).max() < 1e-6


def test_prune_and_reduce(posed: Cli) -> None:
    before = rows(posed)[1]
    answer = posed.json("weights", "prune", "--below", 0.05)
    weights = rows(posed)[1]
    assert answer["removed"] == ((before > 0) & (weights == 0)).sum() > 0
    assert weights[weights > 0].min() >= 0.05 and np.abs(weights.sum(1) - 1).max() < 1e-6
    posed.run("undo")
    assert np.array_equal(rows(posed)[1], before)
    answer = posed.json("weights", "reduce", "--influences", 2, "--pose", "bent")
    weights = rows(posed)[1]
    assert (weights > 0).sum(1).max() == 2 < (before > 0).sum(1).max()
    assert answer["vertices"] == ((before > 0).sum(1) > 2).sum()
    assert 0 < answer["moved"]["mean"] <= answer["moved"]["max"]
    posed.run("undo")
    text = posed.run("weights", "reduce", "-i", 1, "--by", "size", "--vertices", "0-99").stdout
    assert "in 1 poses" in text or " poses this moves them by " in text
    weights = rows(posed)[1]
    assert (weights[:100] > 0).sum(1).max() == 1 and np.array_equal(weights[100:], before[100:])


# ---- refit ----


def write_pc2(path: Path, frames: list[np.ndarray], rate: float = 1.0) -> None:
    """A point cache as other programs write it."""
    header = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(frames[0]), 0.0, rate, len(frames))
    path.write_bytes(header + np.concatenate(frames).astype("<f4").tobytes())


TIMES = (0.0, 0.5, 1.0, 1.5)


@pytest.fixture
def damaged(posed: Cli) -> Cli:
    """walk.pc2 has the character in a clip; damaged.glb has weights that no longer fit it."""
    frames = []
    for time in TIMES:
        posed.run("pose", "frame", "--clip", "bend", "--time", time)
        frames.append(posed.positions("frame"))
    write_pc2(posed.folder / "walk.pc2", frames, rate=12)
    posed.run("weights", "reduce", "--influences", 1, "--by", "size")
    posed.run("export", "-o", "damaged.glb")
    posed.run("close")
    return posed


def gaps_of(cli: Cli, file: str) -> np.ndarray:  # noqa: F811
    """How far each of a file's vertices is from the cache: root mean square over its poses."""
    cli.run("load", file, "--name", "gaps")
    shown = []
    for time in TIMES:
        cli.run("pose", "frame", "--clip", "bend", "--time", time)
        shown.append(cli.positions("frame"))
    cli.run("close")
    wanted = np.fromfile(cli.folder / "walk.pc2", "<f4", offset=32).reshape(len(TIMES), -1, 3)
    return np.sqrt(((np.array(shown, float) - wanted) ** 2).sum(2).mean(0))


@pytest.mark.parametrize("options", [(), ("--slots", "keep", "--stiffness", 0)])
def test_refit_of_a_file(damaged: Cli, options: tuple) -> None:
    arguments = ["refit", "damaged.glb", "--clip", "bend", "--positions", "walk.pc2", *options]
    done = damaged.run(*arguments, "-o", "out.glb")
    assert "refitting 4,000 vertices to 4 poses of clip bend" in done.stderr
    assert done.stdout.startswith("4 poses: 4,000 vertices") and "wrote " in done.stdout
    assert damaged.json("list")["sessions"] == [], "its session is closed"
    answer = damaged.json(*arguments, "--times", "0,0.5,1,1.5")
    residual = answer["refit"]["residual"]
    assert answer["refit"]["poses"] == 4
    before, after = (gaps_of(damaged, path) for path in ("damaged.glb", "out.glb"))
    assert residual["before"]["mean"] == pytest.approx(before.mean(), rel=1e-3)
    assert residual["before"]["max"] == pytest.approx(before.max(), rel=1e-3)
    assert residual["after"]["mean"] == pytest.approx(after.mean(), rel=1e-2, abs=1e-7)
    assert after.mean() < 0.1 * before.mean()
    assert Path(answer["export"]["path"]) == damaged.folder / "damaged-skind.glb"
    assert (damaged.folder / "damaged-skind.glb").stat().st_size > 1000


def test_refit_of_a_session_is_one_step(damaged: Cli) -> None:
    damaged.run("load", "damaged.glb", "--name", "d")
    before = damaged.weights()[1]
    answer = damaged.json("refit", "--clip", "bend", "--positions", "walk.pc2", "--step", 3,
                          "--rounds", 1, "--slots", "keep")
    assert answer["refit"]["revision"] == 1 and answer["refit"]["poses"] == 2
    assert "export" not in answer
    assert {"refit-0", "refit-3"} <= set(damaged.json("info")["poses"])
    assert not np.array_equal(damaged.weights()[1], before)
    damaged.run("undo")
    assert np.array_equal(damaged.weights()[1], before)


@pytest.mark.parametrize(("change", "words"), [
    (lambda data: data[:-1], "cut short: sample 3"),
    (lambda data: data[:20], "no PC2 point cache"),
    (lambda data: data + b"x", "longer than the 4 samples"),
    (lambda data: b"X" + data[1:], "no PC2 point cache"),
    (lambda data: data[:16] + struct.pack("<i", 3999) + data[20:], "3999 points"),
    (lambda data: data[:28] + struct.pack("<i", -4) + data[32:], "no samples"),
    (lambda data: data[:40] + struct.pack("<f", float("inf")) + data[44:], "not finite"),
    (lambda data: data[:24] + struct.pack("<f", 2400.0) + data[28:], "clip \"bend\" ends at"),
])
def test_refit_of_a_broken_cache(damaged: Cli, change, words: str) -> None:
    path = damaged.folder / "walk.pc2"
    path.write_bytes(change(path.read_bytes()))
    done = damaged.run("refit", "damaged.glb", "--clip", "bend", "--positions", "walk.pc2",
                       status=1)
    assert words in done.stderr and done.stdout == ""
    assert damaged.json("list")["sessions"] == []
    assert not (damaged.folder / "damaged-skind.glb").exists()


def test_refit_says_what_is_missing(damaged: Cli) -> None:
    refit = ["refit", "damaged.glb", "--clip", "bend", "--positions"]
    assert "cannot open nosuch.pc2" in damaged.run(*refit, "nosuch.pc2", status=1).stderr
    assert "2 times for 4 samples" in damaged.run(*refit, "walk.pc2", "--times", "0,1",
                                                  status=1).stderr
    wrong = damaged.run("refit", "damaged.glb", "--clip", "x", "--positions", "walk.pc2", status=1)
    assert "has no clip \"x\"" in wrong.stderr
    assert damaged.json("list")["sessions"] == []
