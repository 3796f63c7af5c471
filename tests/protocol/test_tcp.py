"""Channel and Link over TCP: the port, and the token that hello shows."""

from __future__ import annotations

import socket
import time
from pathlib import Path
from typing import Callable, Iterator

import pytest
from core import Channel, Launcher, Link, SkindError
from core.dial import Refused, port_of
from daemons import Daemon

SECONDS = 20.0


class Port:
    """A daemon with a port, its token in the usual place."""

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon
        token, port = Path(f"{daemon.socket}.token").read_text().splitlines()
        self.token, self.path = token, f"tcp:{port}"


@pytest.fixture
def usual(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The socket of a user who chose nothing."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.delenv("SKIND_TOKEN", raising=False)
    monkeypatch.delenv("SKIND_SOCKET", raising=False)
    return folder / "skind" / "skind.sock"


@pytest.fixture
def port(start: Callable[..., Daemon], usual: Path) -> Port:
    return Port(start("--tcp", "0", socket=usual))


@pytest.fixture
def make() -> Iterator[Callable[..., Channel]]:
    channels: list[Channel] = []

    def run(path: str, **more: object) -> Channel:
        channels.append(Channel(path, name="tcp", **more))
        channels[-1].open()
        return channels[-1]

    yield run
    for channel in channels:
        channel.close()


def until(channel: Channel, state: str) -> Channel:
    end = time.monotonic() + SECONDS
    while channel.state != state:
        assert time.monotonic() < end, (channel.state, channel.problem)
        channel.pump()
        time.sleep(0.0005)
    return channel


def test_a_channel_finds_the_token_by_itself(port: Port, make: Callable[..., Channel]) -> None:
    channel = until(make(port.path, user="Anna"), "ready")
    assert channel.hello["server"]["pid"] == port.daemon.process.pid
    answers: list = []
    channel.request("ping", {}, lambda *answer: answers.append(answer))
    end = time.monotonic() + SECONDS
    while not answers:
        assert time.monotonic() < end
        channel.pump()
    assert answers == [({}, None)]


def test_a_token_from_elsewhere(port: Port, make: Callable[..., Channel], folder: Path,
                                monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder / "another"))
    channel = until(make(port.path), "waiting")
    assert "cannot read skind's token" in channel.problem and "SKIND_TOKEN" in channel.problem
    monkeypatch.setenv("SKIND_TOKEN", port.token)
    channel.open()
    until(channel, "ready")
    with Link.connect(port.path) as link:
        link.call("ping")


def test_a_wrong_token_is_told(port: Port, make: Callable[..., Channel],
                               monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SKIND_TOKEN", "0" * 64)
    channel = until(make(port.path), "waiting")
    assert "not the daemon's token" in channel.problem and port.token not in channel.problem
    with pytest.raises(SkindError, match="token"):
        Link.connect(port.path)


def test_the_token_of_another_port(port: Port, make: Callable[..., Channel]) -> None:
    channel = until(make("tcp:9"), "waiting")
    assert f"is for port {port.path[4:]}" in channel.problem


@pytest.mark.parametrize("content", [b"", b"one", b"\xff\xfe\n7"])
def test_a_file_that_holds_no_token(usual: Path, make: Callable[..., Channel],
                                    content: bytes) -> None:
    usual.parent.mkdir()
    Path(f"{usual}.token").write_bytes(content)
    assert "does not hold a token" in until(make("tcp:7531"), "waiting").problem


def test_a_link_finds_the_token_too(port: Port, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SKIND_SOCKET", port.path)
    with Link.connect(user="Ben") as link:
        assert link.hello["server"]["pid"] == port.daemon.process.pid


def test_nobody_listens(make: Callable[..., Channel], monkeypatch: pytest.MonkeyPatch) -> None:
    """No daemon can be started on a port from here: that is for the user, who is told how."""
    monkeypatch.setenv("SKIND_TOKEN", "0" * 64)
    with socket.create_server(("127.0.0.1", 0)) as free:
        path = f"tcp:{free.getsockname()[1]}"
    launcher = Launcher(path, [])
    channel = until(make(path, launcher=launcher), "waiting")
    assert "nobody listens" in channel.problem and f"start --tcp {path[4:]}" in channel.problem
    assert launcher.poll() == "idle"


def test_a_full_backlog(make: Callable[..., Channel], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SKIND_TOKEN", "0" * 64)
    with socket.create_server(("127.0.0.1", 0), backlog=0) as busy:
        path = f"tcp:{busy.getsockname()[1]}"
        until(make(path), "greeting")
        channel = until(make(path), "waiting")
    assert "too many programs" in channel.problem


@pytest.mark.parametrize("path", ["tcp:", "tcp:0", "tcp:65536", "tcp:12x", "tcp:-1", "tcp: 7",
                                  "tcp:99999999", "tcp:\u0661\u0662"])
def test_what_is_no_port(path: str, make: Callable[..., Channel]) -> None:
    channel = until(make(path), "closed")
    assert "is not tcp: and a port" in channel.problem
    with pytest.raises(Refused):
        Link.connect(path)


def test_ports() -> None:
    assert [port_of(path) for path in ("/a/b", "tcp:1", "tcp:65535", "tcp:0080")] \
        == [None, 1, 65535, 80]


def test_a_name_is_cut_to_what_fits() -> None:
    user = Channel("/nowhere", name="x", user="ä" * 40)._client["user"]
    assert user == "ä" * 32
    assert Channel("/nowhere", name="x", user="a" + "ä" * 40)._client["user"] == "a" + "ä" * 31
    assert Channel("/nowhere", name="x")._client["user"]
