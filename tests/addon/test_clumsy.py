"""A clumsy artist with a pen, in a window: what is done at a bad moment neither crashes Blender nor
loses what was sculpted."""

from __future__ import annotations

from test_pen import holds


def test_the_pen_is_down_at_bad_moments(window) -> None:
    """Blender crashes when undo is used, or the mesh written, below a modal operator."""
    found = window.run("clumsy.held")
    waiting, shown = found["dragged"]
    assert waiting == 1 and shown > 0  # the answer waits for the hand
    strokes, left, state = found["filtered"]
    assert (strokes, left) == (2, 0) and holds(state)  # what the filter did is in the weights
    assert found["finished"] == (3, 0)
    assert found["early"]
    left, state = found["begun"]
    assert left == 0 and holds(state)


def test_undo_leads_back_and_what_is_gone_can_be_left(window) -> None:
    found = window.run("clumsy.strayed")
    assert found["landed"] == (1, 0)
    assert found["undone"] == [(1, True), (1, True), (1, False)]
    assert holds(found["state"])
    solved, told = found["renamed"]
    assert solved == 0 and "bone.3" in told and "undo" in told
    assert "gone" in found["gone"]
