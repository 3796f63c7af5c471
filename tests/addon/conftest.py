"""Fixtures for tests in real Blenders. `daemon` (tests/conftest.py) meets them on one socket."""

from __future__ import annotations

from pathlib import Path
from typing import Iterator

import pytest

from blenders import VERSIONS, Blender, Window


@pytest.fixture(params=VERSIONS)
def blender(request: pytest.FixtureRequest, folder: Path) -> Iterator[Blender]:
    """Each version in turn, without a window."""
    instance = Blender(request.param, folder)
    yield instance
    instance.close()


@pytest.fixture
def window(folder: Path) -> Iterator[Window]:
    """Debian's Blender, in a window."""
    instance = Window(folder)
    yield instance
    instance.close()
