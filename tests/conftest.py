"""What all Python tests share: where modules are found, and daemons that end clean."""

from __future__ import annotations

import signal
import sys
import tempfile
from pathlib import Path
from typing import Callable, Iterator

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "clients" / "blender_addon"), str(ROOT / "tests"),
                str(ROOT / "tests" / "protocol")]

from daemons import BIN, Daemon  # noqa: E402


@pytest.fixture(scope="session", autouse=True)
def state_home() -> Iterator[None]:
    """Daemons keep their sessions here, and not with those of whoever runs the tests."""
    with tempfile.TemporaryDirectory(prefix="skind-state-") as path:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("XDG_STATE_HOME", path)
            yield


@pytest.fixture(scope="session")
def probe_path() -> str:
    """The C library behind stdin and stdout; see protocol/wire_probe.c."""
    path = BIN / "wire_probe"
    if not path.exists():
        pytest.fail(f"{path} is not built")
    return str(path)


@pytest.fixture
def folder() -> Iterator[Path]:
    """A private folder with a path short enough for a socket."""
    with tempfile.TemporaryDirectory(prefix="skind-test-") as path:
        yield Path(path)


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[..., Daemon]]:
    """start(*options, socket=...) runs one more daemon; all must end clean."""
    daemons: list[Daemon] = []

    def run(*options: str, socket: Path | None = None) -> Daemon:
        daemons.append(Daemon(folder, *options, socket=socket))
        return daemons[-1].wait_ready()

    yield run
    for daemon in daemons:
        status = daemon.stop()
        assert status in (0, -signal.SIGKILL), daemon.log.read_text()


@pytest.fixture
def daemon(start: Callable[..., Daemon]) -> Daemon:
    return start()
