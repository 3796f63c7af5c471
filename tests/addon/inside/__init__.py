"""Functions that run inside Blender; driver.py imports them, tests name them."""
