# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on: all that touches bpy. Its modules are registered in the order of MODULES."""

from __future__ import annotations

import importlib

# What is used stands before what uses it. The pump comes last, so that nothing ticks before all is
# there, and is the first to stop.
MODULES = (
    "properties", "preferences", "session", "hands", "strokes",
    "history", "files", "overlays", "compare", "operators", "edits", "refit", "claims", "panel",
    "panel_sharing", "panel_options", "pump",
)

_registered: list = []


def register() -> None:
    """Registers each module; when one fails, takes back what was done and raises."""
    try:
        for name in MODULES:
            module = importlib.import_module(f".{name}", __package__)
            if hasattr(module, "register"):
                module.register()
            _registered.append(module)
    except BaseException:
        unregister()
        raise


def unregister() -> None:
    """Unregisters in reverse. One that fails does not keep the others from it."""
    problem: BaseException | None = None
    while _registered:
        module = _registered.pop()
        try:
            if hasattr(module, "unregister"):
                module.unregister()
        except Exception as error:
            problem = problem or error
    if problem is not None:
        raise problem
