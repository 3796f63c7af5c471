# SPDX-License-Identifier: GPL-3.0-or-later
"""What an artist may set, and which of it the daemon that answered can do. Pure.

A settings object has the attributes `stiffness` and `method` ("exact", "thesis"); the other options
wait for their members in stroke.apply. What a daemon does not name among its capabilities is never
sent to it.
"""

from __future__ import annotations

from typing import Any, Collection, Sequence

# option, or one value of it -> the capability that it needs, and what it does
NEEDS: dict[str, tuple[str, str]] = {
    "influences.8": ("influences.8", "hold 8 influences"),
    "method.thesis": ("method.thesis", "solve by the thesis's method"),
    "keep_poses": ("guards", "keep other poses"),
    "smoothing": ("smoothing", "smooth the change"),
    "residual.REST": ("residual.rest", "move the rest shape"),
    "residual.SHAPE": ("residual.shape", "make corrective shape keys"),
    "locks": ("locks", "leave locked groups alone"),
}


def can(option: str, capabilities: Collection[str]) -> bool:
    """Whether the option may be offered; one that needs no capability always may."""
    return option not in NEEDS or NEEDS[option][0] in capabilities


def reason(option: str, hello: dict) -> str:
    """Why the option is not offered, as a sentence; "" when it is. `hello`: the daemon's answer."""
    if can(option, hello.get("capabilities", ())):
        return ""
    if not hello:
        return "What skind can do is known once it answers."
    capability, does = NEEDS[option]
    server = hello.get("server", {})
    name = f"{server.get('name', 'skind')} {server.get('version', '')}".strip()
    return f"{name} cannot {does} yet: needs capability `{capability}`."


def usable(settings: Any, capabilities: Collection[str], locked: Sequence[str] = ()) -> dict:
    """The members of stroke.apply's params that come from the settings.

    `locked` names the bones whose weights must stay.
    """
    # A host's single-precision float: 0.008 should go out as 0.008.
    params: dict[str, Any] = {"stiffness": float(f"{settings.stiffness:.7g}")}
    if can(f"method.{settings.method}", capabilities):
        params["method"] = settings.method
    if locked and can("locks", capabilities):
        params["locked_bones"] = list(locked)
    return params
