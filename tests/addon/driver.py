"""The half of the harness that runs inside Blender; blenders.py is the other one.

Usage, by blenders.py alone: `blender --python driver.py -- JOB`, or `python3 driver.py JOB` where
bpy is a module. Loads the job, enables the add-on from the checkout under the name that its zip
has, calls the function, and writes what it returns or raises. A headless job is an ordinary
function. A job in a window is a generator function whose first parameter is `window` (see
inside/windows.py): after each `yield SECONDS` Blender handles events, runs timers and draws.
"""

from __future__ import annotations

import faulthandler
import importlib
import os
import pickle
import sys
import traceback
from pathlib import Path
from typing import Any, Callable, Iterator

import bpy
import numpy

JOB = pickle.loads(Path(sys.argv[-1]).read_bytes())


def finish(answer: dict[str, Any]) -> None:
    """Writes the answer in one piece: the outside never sees half a file."""
    output = Path(JOB["output"])
    part = output.with_suffix(".part")
    part.write_bytes(pickle.dumps(answer))
    part.rename(output)


def leave() -> None:
    """Ends this Blender. The 4.5 wheel hangs for ever in its static destructors after a Rigify
    rig, so a wheel's process is left by the short way, with the add-on's farewell first."""
    import addon_utils

    if JOB["window"]:
        bpy.ops.wm.quit_blender()
    elif "bpy" in sys.modules and not bpy.app.binary_path:
        if JOB["addon"]:
            addon_utils.disable("skind")
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def prepare() -> Callable:
    """Makes this Blender ready; returns the job's function."""
    if "bool" not in vars(numpy):
        numpy.bool = bool  # the glTF importer of Debian's 3.4 uses the name that NumPy dropped
    sys.path[:0] = [JOB["packages"], str(Path(__file__).parent)]
    if JOB["addon"]:
        enable_addon()
    module, _, function = JOB["call"].rpartition(".")
    return getattr(importlib.import_module(f"inside.{module}"), function)


def enable_addon() -> None:
    """As the preferences' checkbox does, with an entry in the preferences."""
    import addon_utils

    def fail(error: BaseException) -> None:
        raise error

    addon_utils.enable("skind", default_set=True, handle_error=fail)


def run() -> None:
    """A headless job, whole."""
    try:
        finish({"value": prepare()(*JOB["arguments"], **JOB["named"])})
    except BaseException:
        finish({"error": traceback.format_exc()})


def run_in_window() -> None:
    """A job in a window, one step of it at each firing of a timer."""
    steps: Iterator[float] | None = None

    def step() -> float | None:
        nonlocal steps
        try:
            if steps is None:
                function = prepare()
                from inside.windows import Window
                steps = function(Window(), *JOB["arguments"], **JOB["named"])
            return next(steps)
        except StopIteration as end:
            finish({"value": end.value})
        except BaseException:
            finish({"error": traceback.format_exc()})
        leave()
        return None

    bpy.context.preferences.view.show_splash = False  # it would swallow the first stroke
    # Persistent: a job may open files.
    bpy.app.timers.register(step, first_interval=0.1, persistent=True)


# A watchdog that needs no cooperation: it says where Blender hangs, and ends it.
faulthandler.dump_traceback_later(JOB["seconds"], exit=True)
if JOB["window"]:
    run_in_window()
else:
    run()
    leave()
