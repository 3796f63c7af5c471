# SPDX-License-Identifier: GPL-3.0-or-later
"""The one timer: moves bytes, shows what arrived, goes on with jobs; within 4 ms a tick.

It must never end and never raise: what goes wrong is told in the panel, and the next tick comes.
"""

from __future__ import annotations

import time

import bpy

from . import hands, jobs, panel, session

BUDGET_S = 0.004
BUSY_S, SESSION_S, IDLE_S = 0.005, 0.03, 0.25  # until the next tick

_shown: tuple = ()


def tick() -> float:
    """One tick. Returns the seconds until the next, as Blender's timers want it."""
    global _shown
    begun = time.perf_counter()
    try:
        session.channel().pump(BUDGET_S / 2)
        live = session.current()
        if live is not None:
            live.tick()
        if jobs.current() is not None and not hands.are_busy():
            jobs.advance(BUDGET_S - (time.perf_counter() - begun))
        shown = session.face()
        if shown != _shown:
            _shown = shown
            panel.tag_redraw()
    except Exception as error:
        session.fault(error)
    if session.is_busy():
        return BUSY_S
    return IDLE_S if session.current() is None else SESSION_S


def register() -> None:
    bpy.app.timers.register(tick, first_interval=0.1, persistent=True)


def unregister() -> None:
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
