"""Jobs in a window that show the panel in its states."""

from __future__ import annotations

from pathlib import Path
from typing import Iterator

import bpy

from inside import rigs
from inside.windows import Window


def states(window: Window, folder: str) -> Iterator[float]:
    """Takes pictures of the panel: without a daemon or with one, refused, sculpting, options."""
    from skind.blender import session

    def picture(name: str) -> Iterator[float]:
        yield from window.screenshot(str(Path(folder) / f"{name}.png"))

    seen = {}
    rigs.clear()
    mesh, armature = rigs.tube(2000, 6)
    rigs.activate(mesh)
    yield from window.look(mesh)
    yield from window.last_tab()
    yield 1.0
    seen["link"] = session.channel().state
    yield from picture("idle")
    mesh.shape_key_add(name="Basis")
    with window.context():
        try:
            bpy.ops.skind.start()
        except RuntimeError as error:
            seen["refused"] = str(error)
    yield 0.3
    yield from picture("refused")
    mesh.shape_key_clear()
    return seen
