"""Tools for the tests of core.sculpt."""

from __future__ import annotations

from pathlib import Path
from typing import Callable, Iterator

import pytest
from tools import Tool, V, rig_of, rigs, turned_rig


@pytest.fixture
def params() -> dict:
    return rigs.sheet(V)


@pytest.fixture
def make_tool(folder: Path, params: dict) -> Iterator[Callable[..., Tool]]:
    """make_tool(...) makes a tool at the folder's socket; all are closed in the end."""
    tools: list[Tool] = []

    def run(**options) -> Tool:
        tools.append(Tool(folder / "skind.sock", rig_of(params), **options))
        return tools[-1]

    yield run
    for tool in tools:
        tool.channel.close()


@pytest.fixture
def join_file():
    """join_file(daemon, path): a tool in a session that was made from a file."""
    tools: list[Tool] = []

    def run(daemon, path: Path) -> Tool:
        with daemon.link() as link:
            link.call("session.create", {"name": "s", "file": str(path)})
            tools.append(Tool(daemon.socket, turned_rig(link)).join())
        return tools[-1]

    yield run
    for tool in tools:
        tool.channel.close()
