# SPDX-License-Identifier: GPL-3.0-or-later
"""skind for Blender: sculpt a posed character, get skin weights.

`core/` knows no Blender and serves any Python tool; `blender/` is the add-on. This file imports
neither, so that `import skind.core` works where there is no bpy.
"""

import importlib
import sys

# Blender before 4.2 reads this without running the file; the newer ones read blender_manifest.toml.
bl_info = {
    "name": "skind",
    "author": "the skind authors",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > Skind",
    "description": "Sculpt a posed character, get skin weights",
    "category": "Rigging",
}
__version__ = "0.1.0"


def register() -> None:
    """Called by Blender when the add-on is enabled."""
    importlib.import_module(".blender", __name__).register()


def unregister() -> None:
    """Called by Blender when the add-on is disabled, and before it ends."""
    importlib.import_module(".blender", __name__).unregister()
    # An update replaces the files while Blender runs; what is enabled next must be the new ones.
    for name in [name for name in sys.modules if name.startswith(f"{__name__}.")]:
        del sys.modules[name]
