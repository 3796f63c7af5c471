# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's preferences, and from them: where skind listens and where its programs are."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core.link import default_socket_path

ADDON = __package__.rpartition(".")[0]  # "skind", or "bl_ext.<repository>.skind"
OWN_PROGRAMS = Path(__file__).resolve().parents[1] / "bin"


class SKIND_AP_preferences(bpy.types.AddonPreferences):
    """All are empty for nearly everybody."""

    bl_idname = ADDON

    programs: StringProperty(
        name="skinctl",
        description="The program skinctl, or the folder that holds it and skind. "
                    "Empty: the ones that came with the add-on",
        subtype='FILE_PATH',
        default="",
    )
    socket: StringProperty(
        name="Socket",
        description="Where skind listens: a path, or tcp: and a port, as in tcp:7531. "
                    "Empty: $SKIND_SOCKET, else the usual place",
        subtype='FILE_PATH',
        default="",
    )
    person: StringProperty(
        name="Name",
        description="Your name, as others in a session see it. Empty: that of your login",
        default="",
    )

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.prop(self, "person")
        column.prop(self, "programs")
        column.prop(self, "socket")
        column.label(text=f"Empty means: {default_socket_path()}")
        column.label(text="A change counts from the next time that the add-on is enabled.")


def _chosen(name: str) -> str:
    """A preference as it was typed; "" without an entry in the preferences."""
    addon = bpy.context.preferences.addons.get(ADDON)
    return getattr(addon.preferences, name, "").strip() if addon is not None else ""


def _chosen_path(name: str) -> str:
    """A preference as an absolute path, or "" when it is empty."""
    text = _chosen(name)
    return os.path.expanduser(bpy.path.abspath(text)) if text else ""


def socket_path() -> str:
    """Where skind listens: a path, or "tcp:PORT"."""
    chosen = _chosen("socket")
    return chosen if chosen.startswith("tcp:") else _chosen_path("socket") or default_socket_path()


def person() -> str:
    """Whom others see at work here; "": by the name of the login."""
    return _chosen("person")


def candidates() -> list[Path]:
    """Where to look for skinctl, before PATH: what the user named, then the add-on's own."""
    chosen = _chosen_path("programs")
    return [Path(chosen), OWN_PROGRAMS] if chosen else [OWN_PROGRAMS]


def _make_runnable() -> None:
    """Blender unpacks an add-on without its files' modes; the programs need theirs back."""
    for name in ("skind", "skinctl"):
        program = OWN_PROGRAMS / name
        if program.is_file() and not os.access(program, os.X_OK):
            try:
                program.chmod(program.stat().st_mode | 0o111)
            except OSError as error:  # a folder of the system's; the launcher will say it too
                print(f"skind: {program} cannot be made executable: {error}")


def register() -> None:
    _make_runnable()
    bpy.utils.register_class(SKIND_AP_preferences)


def unregister() -> None:
    bpy.utils.unregister_class(SKIND_AP_preferences)
