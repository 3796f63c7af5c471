"""`./run torture`: what skind survives, measured on the real daemon and told in figures.

    yard         daemons under test with folders of their own; time, progress, /proc
    work         small rigs, and requests that change them
    figures/     one module for each question of the closing table
    faults.c     a library that makes the n-th write, fsync or malloc of a daemon fail
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "clients" / "blender_addon"), str(ROOT / "tests" / "integration")]
