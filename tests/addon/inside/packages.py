"""Jobs that install and enable the add-on as its users do. They begin without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import addon_utils
import bpy

PROGRAMS = ("skind", "skinctl")


def _traces() -> dict:
    """Where an add-on can leave something behind."""
    handlers = {name: len(getattr(bpy.app.handlers, name)) for name in dir(bpy.app.handlers)
                if isinstance(getattr(bpy.app.handlers, name), list)}
    keys = [item.idname for config in bpy.context.window_manager.keyconfigs
            for keymap in config.keymaps for item in keymap.keymap_items
            if item.idname.startswith("skind.") or "skind" in keymap.name.lower()]
    return {"types": [name for name in dir(bpy.types) if "skind" in name.lower()],
            "operators": list(dir(bpy.ops.skind)),
            "properties": [f"{owner.__name__}.{name}"
                           for owner in (bpy.types.Scene, bpy.types.Object, bpy.types.Mesh,
                                         bpy.types.WindowManager)
                           for name in dir(owner) if "skind" in name.lower()],
            "handlers": handlers, "keys": keys,
            "modules": [name for name in sys.modules if name.startswith("skind.")]}


def _fail(error: BaseException) -> None:
    raise error


def twice(addon: str) -> list[dict]:
    """Enables and disables it twice; the traces before, and after each."""
    folder = Path("packages-here").resolve()
    folder.mkdir()
    (folder / "skind").symlink_to(addon)
    sys.path.insert(0, str(folder))
    seen = [_traces()]
    for _ in range(2):
        addon_utils.enable("skind", default_set=True, handle_error=_fail)
        seen.append(_traces())
        tick = sys.modules["skind.blender.pump"].tick
        assert bpy.app.timers.is_registered(tick)
        addon_utils.disable("skind", default_set=True, handle_error=_fail)
        assert not bpy.app.timers.is_registered(tick)
        seen.append(_traces())
    return seen


def _facts(module: str) -> dict:
    """Of an add-on that is enabled."""
    found = sys.modules[module]
    programs = Path(found.__file__).parent / "bin"
    says = {}
    for name in PROGRAMS:
        done = subprocess.run([programs / name, "--version"], capture_output=True, text=True,
                              timeout=30, check=True)
        says[name] = done.stdout.strip()
    traces = _traces()
    preferences = sys.modules[f"{module}.blender.preferences"]
    return {"file": found.__file__, "says": says, "types": traces["types"],
            "entry": module in bpy.context.preferences.addons,
            "candidates": [str(path) for path in preferences.candidates()]}


def install_addon(archive: str) -> dict:
    """As before 4.2: Preferences > Add-ons > Install, then the tick."""
    bpy.ops.preferences.addon_install(filepath=archive)
    programs = Path(bpy.utils.user_resource("SCRIPTS", path="addons")) / "skind" / "bin"
    unpacked = {name: os.access(programs / name, os.X_OK) for name in PROGRAMS}
    bpy.ops.preferences.addon_enable(module="skind")
    facts = _facts("skind")
    bpy.ops.preferences.addon_disable(module="skind")
    return {**facts, "unpacked": unpacked, "left": _traces()}


def install_extension(archive: str) -> dict:
    """As since 4.2: Install from Disk."""
    module = "bl_ext.user_default.skind"
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default",
                                             enable_on_install=True)
    facts = _facts(module)
    addon_utils.disable(module, default_set=True, handle_error=_fail)
    return {**facts, "left": _traces()}
