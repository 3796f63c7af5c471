"""Who may connect, what lies on the disk, and a daemon that has no descriptors left."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import shutil
import socket
import stat
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rigs
import schemas
from core import Link, SkindError
from core.dial import Refused, dial
from core.exchange import Exchange
from daemons import BIN, Daemon

HELLO = {"protocol": {"min": 1, "max": 1}}
HELLO_BYTES = 64 << 10  # a message before hello


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


def cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def refused(folder: Path, *options: str) -> str:
    """Runs a daemon that must not start, and returns what it says."""
    done = subprocess.run([BIN / "skind", *options], capture_output=True, text=True, timeout=30)
    assert done.returncode == 1, done.stderr
    return done.stderr


# ---- files -----------------------------------------------------------------------------------

@pytest.mark.parametrize("mask", [0o777, 0o000, 0o022])
def test_modes_do_not_depend_on_the_umask(folder, mask) -> None:
    before = os.umask(mask)
    try:
        process = subprocess.Popen(
            [BIN / "skind", "--socket", folder / "run" / "skind.sock", "--state", folder / "kept",
             "--tcp", "0"], stderr=subprocess.PIPE)
    finally:
        os.umask(before)
    where = folder / "run" / "skind.sock"
    try:
        deadline = time.monotonic() + 30
        while True:
            try:
                link = Link.connect(where)
                break
            except OSError:
                assert time.monotonic() < deadline and process.poll() is None
                time.sleep(0.02)
        with link:
            link.call("session.create", {"name": "sheet", **rigs.sheet(64)})
        for path in [folder / "run", folder / "kept"]:
            assert mode(path) == 0o700, path
        for path in [where, Path(f"{where}.lock"), Path(f"{where}.token")]:
            assert mode(path) == 0o600, path
        for path in (folder / "kept").rglob("*"):
            assert mode(path) == (0o700 if path.is_dir() else 0o600), path
    finally:
        process.terminate()
        assert process.wait(30) == 0
    assert not Path(f"{where}.token").exists() and not where.exists()


def test_a_folder_that_is_a_symlink_is_refused(folder) -> None:
    (folder / "real").mkdir(mode=0o700)
    (folder / "run").symlink_to("real")
    said = refused(folder, "--socket", f"{folder}/run/skind.sock")
    assert "symlink" in said and list((folder / "real").iterdir()) == []


@pytest.mark.parametrize("what", ["", ".lock"])
def test_a_name_that_is_a_symlink_is_refused_and_what_it_names_stays(folder, what) -> None:
    (folder / "precious").write_text("as it was")
    (folder / f"skind.sock{what}").symlink_to("precious")
    said = refused(folder, "--socket", f"{folder}/skind.sock")
    assert f"skind.sock{what}" in said
    assert (folder / "precious").read_text() == "as it was"
    assert mode(folder / "precious") == 0o644


def test_a_token_that_is_a_symlink_is_replaced_and_what_it_names_stays(start, folder) -> None:
    (folder / "precious").write_text("as it was")
    (folder / "skind.sock.token").symlink_to("precious")
    start("--tcp", "0")
    assert (folder / "precious").read_text() == "as it was"
    assert not (folder / "skind.sock.token").is_symlink()


def test_a_folder_open_to_others_is_refused(folder) -> None:
    (folder / "run").mkdir()
    (folder / "run").chmod(0o755)
    assert "chmod 700" in refused(folder, "--socket", f"{folder}/run/skind.sock")


def test_what_skinctl_makes_does_not_depend_on_the_umask(folder) -> None:
    where = folder / "run" / "skind.sock"
    before = os.umask(0o777)
    try:
        subprocess.run([BIN / "skinctl", "start", "--socket", where, "--state", folder / "kept"],
                       check=True, capture_output=True, timeout=60)
        subprocess.run([BIN / "skinctl", "stop", "--socket", where], check=True,
                       capture_output=True, timeout=60)
    finally:
        os.umask(before)
    assert mode(folder / "run") == 0o700
    assert {path.name: oct(mode(path)) for path in (folder / "run").iterdir()} == {
        f"skind.{name}": "0o600" for name in ("log", "sock.lock", "sock.start.lock")}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_another_user_is_refused_with_a_sentence(daemon, folder) -> None:
    folder.chmod(0o711)  # as if the folder had been opened by mistake
    daemon.socket.chmod(0o666)
    script = ("import os, socket, sys\n"
              "os.setuid(65534)\n"
              "peer = socket.socket(socket.AF_UNIX)\n"
              "peer.connect(sys.argv[1])\n"
              "print(peer.makefile().read())\n")
    said = subprocess.run([sys.executable, "-c", script, daemon.socket], capture_output=True,
                          text=True, timeout=30, check=True).stdout
    assert "65534" in json.loads(said)["error"]["message"]
    with daemon.link() as link:
        link.call("ping")


def test_rubbish_does_not_fill_the_log(daemon) -> None:
    def rubbish() -> None:
        with socket.socket(socket.AF_UNIX) as peer:
            peer.settimeout(20)
            peer.connect(str(daemon.socket))
            peer.sendall(b"GET / HTTP/1.1\r\n\r\n")
            with contextlib.suppress(ConnectionResetError):
                while peer.recv(4096):
                    pass

    for _ in range(1100):
        rubbish()
    assert 1000 <= daemon.log.read_text().count("no frame") < 1100
    time.sleep(1.1)
    rubbish()
    assert "warnings were left out" in daemon.log.read_text()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_socket_of_another_user_is_told_nothing(folder) -> None:
    """In /tmp somebody else may have made it first."""
    folder.chmod(0o777)
    where = folder / "skind.sock"
    script = ("import os, socket, sys\n"
              "os.setuid(65534)\n"
              "listener = socket.socket(socket.AF_UNIX)\n"
              "listener.bind(sys.argv[1])\n"
              "listener.listen()\n"
              "os.chmod(sys.argv[1], 0o666)\n"
              "print('ready', flush=True)\n"
              "for _ in range(2):\n"
              "    print(listener.accept()[0].recv(1000), flush=True)\n")
    other = subprocess.Popen([sys.executable, "-c", script, where], stdout=subprocess.PIPE,
                             text=True)
    try:
        assert other.stdout.readline() == "ready\n"
        done = subprocess.run([BIN / "skinctl", "list", "--socket", where], capture_output=True,
                              text=True, timeout=60)
        assert done.returncode == 1 and "user 65534" in done.stderr
        with pytest.raises(Refused, match="user 65534"):
            dial(str(where))
        assert [other.stdout.readline() for _ in range(2)] == ["b''\n"] * 2
    finally:
        other.kill()
        other.wait()


# ---- TCP -------------------------------------------------------------------------------------

@pytest.fixture
def tcp(start) -> Daemon:
    return start("--tcp", "0")


def token_of(daemon: Daemon) -> tuple[str, int]:
    token, port = Path(f"{daemon.socket}.token").read_text().splitlines()
    assert re.fullmatch("[0-9a-f]{64}", token)
    return token, int(port)


def by_port(port: int, lines: bool = False) -> Link:
    connection = socket.create_connection(("127.0.0.1", port), 20)
    return Link(connection, Exchange(lines=lines, watch=schemas.watch()), 20)


@pytest.mark.parametrize("lines", [False, True])
def test_the_right_token_opens_everything(tcp, lines) -> None:
    token, port = token_of(tcp)
    with by_port(port, lines) as link:
        link.call("hello", {**HELLO, "token": token})
        link.call("session.create", {"name": "sheet", **rigs.sheet(400)})
        weights = np.asarray(link.call("weights.get", {"session": "sheet"})["weights"], np.float32)
    with tcp.link() as other:
        assert np.array_equal(other.call("weights.get", {"session": "sheet"})["weights"], weights)


def changed(token: str, place: int) -> str:
    digit = "0" if token[place] != "0" else "1"
    return token[:place] + digit + token[place + 1:]


@pytest.mark.parametrize("wrong", ["missing", "first", "last", "upper"])
def test_a_wrong_token_is_refused_and_hung_up_on(tcp, wrong) -> None:
    token, port = token_of(tcp)
    shown = {"missing": {}, "first": {"token": changed(token, 0)},
             "last": {"token": changed(token, 63)}, "upper": {"token": token.upper()}}[wrong]
    if shown.get("token") == token:
        pytest.skip("a token without letters")
    with by_port(port) as link:
        with pytest.raises(SkindError) as refusal:
            link.call("hello", {**HELLO, **shown})
        assert refusal.value.name == "bad_token"
        with pytest.raises(ConnectionError):
            link.call("hello", {**HELLO, "token": token})


def test_nothing_is_answered_before_the_token(tcp) -> None:
    _, port = token_of(tcp)
    with by_port(port) as link:
        with pytest.raises(SkindError) as refusal:
            link.call("stats")
        assert refusal.value.name == "hello_first"


def test_only_this_machine_and_a_new_token_each_time(start, folder) -> None:
    first = start("--tcp", "0")
    token, port = token_of(first)
    listening = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
    assert re.findall(rf"(\w+):{port:04X} \w+:0000 0A", listening) == ["0100007F"]
    first.stop()
    assert token_of(start("--tcp", str(port)))[0] != token


def test_a_port_that_is_taken_is_a_reason_not_to_start(tcp, folder) -> None:
    _, port = token_of(tcp)
    said = refused(folder, "--socket", f"{folder}/other.sock", "--tcp", str(port))
    assert str(port) in said and not (folder / "other.sock.token").exists()


def test_without_being_asked_there_is_no_port(daemon) -> None:
    assert not Path(f"{daemon.socket}.token").exists()


# ---- before hello ----------------------------------------------------------------------------

def hello_of(bytes_: int, frame: bool) -> bytes:
    """A hello of exactly so many bytes, header or newline included."""
    def text(padding: int) -> bytes:
        return json.dumps({"jsonrpc": "2.0", "id": 1, "method": "hello",
                           "params": HELLO}).encode() + b" " * padding
    room = bytes_ - (16 if frame else 1) - len(text(0))
    whole = text(room)
    return struct.pack("<4sIQ", b"SKD1", len(whole), 0) + whole if frame else whole + b"\n"


def first_answer(daemon: Daemon, message: bytes) -> bytes:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(20)
        connection.connect(str(daemon.socket))
        connection.sendall(message)
        return connection.recv(1 << 16)


@pytest.mark.parametrize("frame", [True, False])
def test_a_message_before_hello_may_be_64_kib(daemon, frame) -> None:
    step = 8 if frame else 1  # a frame is padded to multiples of eight
    for bytes_ in (HELLO_BYTES - step, HELLO_BYTES):
        assert b'"capabilities"' in first_answer(daemon, hello_of(bytes_, frame)), bytes_
    assert b"too_large" in first_answer(daemon, hello_of(HELLO_BYTES + step, frame))
    with daemon.link(lines=not frame, checked=False) as link:  # and afterwards more
        with pytest.raises(SkindError) as refusal:
            link.call("session.info", {"session": "x" * (2 * HELLO_BYTES)})
        assert refusal.value.name == "bad_params"


# ---- descriptors -----------------------------------------------------------------------------

DESCRIPTORS = 128


def descriptors(daemon: Daemon) -> int:
    return len(os.listdir(f"/proc/{daemon.process.pid}/fd"))


def knock(daemon: Daemon) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(20)
    connection.connect(str(daemon.socket))
    return connection


@pytest.fixture
def narrow(folder):
    """A daemon that may have few descriptors, and a link that is inside."""
    if shutil.which("prlimit") is None:
        pytest.skip("no prlimit to set a limit with")
    daemon = Daemon(folder, before=("prlimit", f"--nofile={DESCRIPTORS}")).wait_ready()
    with daemon.link() as inside:
        inside.call("session.create", {"name": "sheet", **rigs.sheet(400)})
        yield daemon, inside
    assert daemon.stop() == 0, daemon.log.read_text()


def work(link: Link) -> None:
    """Needs files and memory of the daemon."""
    link.call("session.create", {"name": "another", **rigs.sheet(64)})
    link.call("session.delete", {"session": "another"})


def test_clients_leave_descriptors_for_files(narrow) -> None:
    daemon, inside = narrow
    crowd = [knock(daemon) for _ in range(DESCRIPTORS)]
    inside.call("ping")
    answers = []
    for connection in crowd:  # those that were refused were told why, and hung up on
        connection.setblocking(False)
        try:
            answers.append(json.loads(connection.recv(65536))["error"])
        except BlockingIOError:
            continue
    assert DESCRIPTORS // 4 < len(answers) < DESCRIPTORS
    assert all(error["data"] == {**error["data"], "name": "busy", "retryable": True}
               for error in answers)
    assert descriptors(daemon) <= DESCRIPTORS - 60
    work(inside)
    for connection in crowd:
        connection.close()
    with daemon.link() as link:
        link.call("ping")


def test_without_any_descriptor_those_inside_go_on(narrow) -> None:
    daemon, inside = narrow
    pid = daemon.process.pid
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (descriptors(daemon), DESCRIPTORS))
    before = cpu_seconds(pid)
    end = time.monotonic() + 1
    crowd = []
    while time.monotonic() < end:
        crowd.append(knock(daemon))
        inside.call("ping")
        time.sleep(0.02)
    assert cpu_seconds(pid) - before < 0.3
    for connection in crowd:  # hung up on, so that nobody waits for ever
        try:
            assert b"capabilities" not in connection.recv(65536)
        except ConnectionResetError:
            pass
        connection.close()
    with pytest.raises(SkindError):
        inside.call("session.export", {"session": "sheet", "path": "/nowhere/at.all"})
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (DESCRIPTORS, DESCRIPTORS))
    work(inside)
    with daemon.link() as link:
        link.call("ping")
