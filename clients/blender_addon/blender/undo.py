# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's undo stack, as far as it can be used: push, and take back our own last steps.

There is no stack without a window, so in the background both do nothing.
"""

from __future__ import annotations

from typing import Callable

import bpy

_is_ours = False


def is_ours() -> bool:
    """True in Blender's undo handlers while it is we who undo."""
    return _is_ours


def _window() -> bpy.types.Window | None:
    """Timers have no window in their context, and the operators want one."""
    if bpy.app.background:
        return None
    return bpy.context.window or bpy.context.window_manager.windows[0]


def push(message: str) -> None:
    window = _window()
    if window is not None:
        with bpy.context.temp_override(window=window):
            bpy.ops.ed.undo_push(message=message)


def take_back(steps: int, is_right: Callable[[], bool]) -> bool:
    """Undoes the last steps. If that did not lead where it should, redoes them: False."""
    global _is_ours
    window = _window()
    if window is None:
        return False
    _is_ours = True
    try:
        undone = 0
        with bpy.context.temp_override(window=window):
            while undone < steps and bpy.ops.ed.undo.poll():
                bpy.ops.ed.undo()
                undone += 1
            if undone == steps and is_right():
                return True
            for _ in range(undone):
                bpy.ops.ed.redo()
    except RuntimeError:
        pass  # the stack had no more; what is shown is decided by the caller
    finally:
        _is_ours = False
    return False
