# SPDX-License-Identifier: GPL-3.0-or-later
"""What an artist may set, and which of it the daemon that answered can do. Pure.

A settings object has the attributes that `usable` reads. What a daemon does not name among its
capabilities is never sent to it.
"""

from __future__ import annotations

from typing import Any, Collection, Sequence

# option, or one value of it -> the capability that it needs, and what it does
NEEDS: dict[str, tuple[str, str]] = {
    "influences.8": ("influences.8", "hold 8 influences"),
    "automatic": ("stiffness.auto", "choose the stiffness"),
    "method.thesis": ("method.thesis", "solve by the thesis's method"),
    "pins": ("pins", "keep targets in several poses"),
    "keep": ("guards", "keep other poses"),
    "slots.EVIDENCE": ("slots.evidence", "let vertices use other bones"),
    "smoothing": ("smoothing", "smooth the change"),
    "mix": ("mix", "go a part of the way"),
    "use_mask": ("mix", "take masks"),
    "residual.REST": ("residual.rest", "move the rest shape"),
    "residual.SHAPE": ("residual.shape", "make corrective shape keys"),
    "durability.second": ("durability", "keep less than all"),
    "durability.off": ("durability", "keep less than all"),
    "locks": ("locks", "leave locked groups alone"),
    "mirror": ("mirror", "mirror weights"),
    "prune": ("prune", "prune weights"),
    "refit": ("refit", "fit weights to another mesh's motion"),
    "reduce": ("reduce", "reduce influences by what poses show"),
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


def _number(value: float) -> float:
    """A host's single-precision float as it was typed: 0.008 should go out as 0.008."""
    return float(f"{value:.7g}")


def solving(settings: Any, capabilities: Collection[str], locked: Sequence[str] = ()) -> dict:
    """The members that say how to solve: of stroke.apply's params and of pins.solve's.

    `locked` names the bones whose weights must stay. What the daemon does by itself when nothing
    is said is not sent.
    """
    params: dict[str, Any] = {}
    if not (settings.automatic and can("automatic", capabilities)):
        params["stiffness"] = _number(settings.stiffness)
    if locked and can("locks", capabilities):
        params["locked_bones"] = list(locked)
    if can("keep", capabilities):
        params["guard"] = _number(settings.keep_strength) if settings.keep else 0.0
    if settings.slots == "EVIDENCE" and can("slots.EVIDENCE", capabilities):
        params["slots"] = "evidence"
    if settings.smoothing > 0 and can("smoothing", capabilities):
        params["smooth"] = _number(settings.smoothing)
    if settings.residual != "REPORT" and can(f"residual.{settings.residual}", capabilities):
        params["residual"] = settings.residual.lower()
    return params


def usable(settings: Any, capabilities: Collection[str], locked: Sequence[str] = ()) -> dict:
    """The members of stroke.apply's params that come from the settings."""
    params = solving(settings, capabilities, locked)
    if settings.method == "thesis" and can("method.thesis", capabilities):
        known = ("stiffness", "locked_bones")  # it is asked to do what it did in 2020, alone
        return {**{name: params[name] for name in known if name in params}, "method": "thesis"}
    if can("pins", capabilities):
        params["pin"] = "move"  # what the anchor held back of one stroke is not lost for the next
    if settings.mix < 1 and can("mix", capabilities):
        params["mix"] = _number(settings.mix)
    return params
