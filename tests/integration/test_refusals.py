"""Bad input: the right code, one sentence that says what to do, and nothing changed."""

from __future__ import annotations

import contextlib
import json
import socket
import struct

import numpy as np
import pytest
import rigs
from core import SkindError, WireError

GOOD = {"session": "sheet", "pose": "bent", "vertices": [1, 2],
        "positions": [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]}
NAN, INF = float("nan"), float("inf")


def f32(*rows) -> np.ndarray:
    return np.array(rows, np.float32)


def u32(*values) -> np.ndarray:
    return np.array(values, np.uint32)


def fallen() -> np.ndarray:
    """Offsets whose ends are right and whose middle leads far outside."""
    offsets = rigs.sheet(16)["influence_offsets"].copy()
    offsets[5] = 4_000_000_000
    return offsets


# what: (method, params, error)
REQUESTS = {
    "index out of range": ("stroke.apply", {**GOOD, "vertices": [1, 900]}, "bad_index"),
    "vertex named twice": ("stroke.apply", {**GOOD, "vertices": [1, 1]}, "bad_index"),
    "NaN position": ("stroke.apply", {**GOOD, "vertices": u32(1, 2),
                                      "positions": f32([0, NAN, 0], [0, 0, 0])}, "not_finite"),
    "infinite position": ("stroke.apply", {**GOOD, "vertices": u32(1, 2),
                                           "positions": f32([0, 0, 0], [0, 0, INF])}, "not_finite"),
    "counts that do not match": ("stroke.apply", {**GOOD, "vertices": [1, 2, 3]}, "count_mismatch"),
    "wrong dtype": ("stroke.apply", {**GOOD, "positions": np.zeros((2, 3), np.float64)},
                    "bad_params"),
    "negative index": ("stroke.apply", {**GOOD, "vertices": [-1, 2]}, "bad_params"),
    "unknown pose": ("stroke.apply", {**GOOD, "pose": "elsewhere"}, "no_pose"),
    "unknown session": ("stroke.apply", {**GOOD, "session": "elsewhere"}, "no_session"),
    "unknown bone": ("stroke.apply", {**GOOD, "locked_bones": ["tail"]}, "no_bone"),
    "unknown method word": ("stroke.apply", {**GOOD, "method": "magic"}, "bad_params"),
    "negative stiffness": ("stroke.apply", {**GOOD, "stiffness": -1}, "bad_params"),
    "no positions": ("stroke.apply", {k: v for k, v in GOOD.items() if k != "positions"},
                     "bad_params"),
    "locked vertex out of range": ("stroke.apply", {**GOOD, "locked_vertices": [4000]},
                                   "bad_index"),
    "vertex of evaluate": ("pose.evaluate", {"session": "sheet", "pose": "bent",
                                             "vertices": [900]}, "bad_index"),
    "vertex of weights": ("weights.get", {"session": "sheet", "vertices": [900]}, "bad_index"),
    "unknown clip": ("pose.set", {"session": "sheet", "pose": "p", "clip": "walk", "time": 0},
                     "no_clip"),
    "clip and bend": ("pose.set", {"session": "sheet", "pose": "p", "clip": "walk", "time": 0,
                                   "bend": 25}, "bad_params"),
    "a bend of 181 degrees": ("pose.set", {"session": "sheet", "pose": "p", "bend": 181},
                              "bad_params"),
    "rest is the rig's": ("pose.set", {"session": "sheet", "pose": "rest",
                                       "matrices": rigs.bent(0)}, "name_taken"),
    "too few matrices": ("pose.set", {"session": "sheet", "pose": "p",
                                      "matrices": rigs.bent(0)[:3]}, "count_mismatch"),
    "transposed matrices": ("pose.set", {"session": "sheet", "pose": "p",
                                         "matrices": np.ascontiguousarray(
                                             rigs.bent(0.1).reshape(-1, 4, 4).transpose(0, 2, 1)
                                         ).reshape(-1, 16)}, "bad_params"),
    "a file that is not there": ("session.create", {"file": "/nowhere/a.glb"}, "no_file"),
    "a file that is not glTF": ("session.create", {"file": __file__}, "not_gltf"),
    "a folder": ("session.create", {"file": "/tmp"}, "not_gltf"),
    "a relative path": ("session.create", {"file": "a.glb"}, "bad_params"),
    "a taken name": ("session.create", {"name": "sheet", **rigs.sheet(16)}, "name_taken"),
    "a name with a slash": ("session.create", {"name": "a/b", **rigs.sheet(16)}, "bad_params"),
    "neither file nor arrays": ("session.create", {"name": "x"}, "bad_params"),
    "5 influences": ("session.create", {"influences": 5, **rigs.sheet(16)}, "bad_params"),
    "a rig whose triangle points nowhere": (
        "session.create", {**rigs.sheet(16), "triangles": u32([0, 1, 16])}, "bad_index"),
    "a rig with NaN": ("session.create",
                       {**rigs.sheet(16), "positions": np.full((16, 3), NAN, np.float32)},
                       "not_finite"),
    "offsets that end elsewhere": (
        "session.create", {**rigs.sheet(16), "influence_offsets": np.zeros(17, np.uint32)},
        "count_mismatch"),
    "offsets that fall": ("session.create", {**rigs.sheet(16), "influence_offsets": fallen()},
                          "too_large"),
    "export of arrays": ("session.export", {"session": "sheet", "path": "/tmp/x.glb"},
                         "unsupported"),
    "unknown method": ("stroke.undo", {}, "unknown_method"),
    "close of nothing": ("session.close", {"session": "elsewhere"}, "no_session"),
}


@pytest.fixture
def link(daemon):
    with daemon.link(checked=False) as link:
        link.call("session.create", {"name": "sheet", **rigs.sheet(900)})
        link.call("pose.set", {"session": "sheet", "pose": "bent", "matrices": rigs.bent(0.3)})
        yield link


def test_each_bad_request_is_refused_and_changes_nothing(link) -> None:
    before = link.call("weights.get", {"session": "sheet"})
    info = link.call("session.info", {"session": "sheet"})
    for what, (method, params, name) in REQUESTS.items():
        with pytest.raises(SkindError) as refusal:
            link.call(method, params)
        error = refusal.value
        assert error.name == name, f"{what}: {error.name}: {error}"
        assert len(str(error)) > 15 and "\n" not in str(error), what
    after = link.call("weights.get", {"session": "sheet"})
    np.testing.assert_array_equal(after["weights"], before["weights"])
    assert link.call("session.info", {"session": "sheet"}) == info
    assert [row["session"] for row in link.call("session.list")["sessions"]] == ["sheet"]


def test_too_many_influences_is_the_users_choice(link) -> None:
    rig = rigs.sheet(16)
    rig["influence_offsets"] = (np.arange(17) * 6).astype(np.uint32)
    rig["influence_joints"] = np.tile(np.arange(6), 16).astype(np.uint16)
    rig["influence_weights"] = np.tile([.3, .25, .2, .15, .06, .04], 16).astype(np.float32)
    with pytest.raises(SkindError) as refusal:
        link.call("session.create", {"name": "six", **rig})
    assert refusal.value.name == "too_many_influences" and "16 of 16" in str(refusal.value)
    report = link.call("session.create", {"name": "six", "reduce": "largest", **rig})["slots"]
    assert report["reduced"] == 16
    assert report["largest_cut"] == pytest.approx(0.1, abs=1e-6)
    assert report["moved"]["poses"] > 0 and report["moved"]["max"] > report["moved"]["mean"] > 0
    eight = link.call("session.create", {"name": "eight", "influences": 8, **rig})
    assert eight["slots"]["reduced"] == 0


def test_a_stroke_on_a_closed_session(daemon, link) -> None:
    link.call("session.attach", {"session": "sheet"})
    with daemon.link() as other:
        other.call("session.close", {"session": "sheet"})
    with pytest.raises(SkindError) as refusal:
        link.call("stroke.apply", GOOD)
    assert refusal.value.name == "no_session"
    assert [note.method for note in link.notifications] == ["session.closed"]


def raw(daemon) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(20)
    connection.connect(str(daemon.socket))
    return connection


def read_all(connection: socket.socket) -> bytes:
    """Until the daemon closes, which it does; a reset says that it left something unread."""
    data = b""
    try:
        while chunk := connection.recv(65536):
            data += chunk
    except ConnectionResetError:
        pass
    return data


@pytest.mark.parametrize("head, name", [
    (b"GET / HTTP/1.1\r\n\r\n" + b" " * 16, b"bad_frame"),
    (b"SKD1" + struct.pack("<IQ", 10, 2**40), b"too_large"),
    (b"SKD1" + struct.pack("<IQ", 2**31, 0), b"too_large"),
    (b"SKD1" + struct.pack("<IQ", 0, 2**64 - 1), b"too_large"),
    (b'{"jsonrpc": "' + b"x" * (1 << 20), b"too_large"),
], ids=["magic", "tail", "json", "overflow", "line"])
def test_a_stream_that_cannot_be_followed_is_closed_with_a_reason(daemon, head, name) -> None:
    with raw(daemon) as connection:
        with contextlib.suppress(BrokenPipeError):  # the daemon need not wait for the end
            connection.sendall(head)
        assert name in read_all(connection)
    with daemon.link() as link:
        link.call("ping")


def test_broken_json_costs_only_that_message(daemon) -> None:
    with raw(daemon) as connection:
        stream = connection.makefile("rwb")
        deep = b"[" * 40 + b"]" * 40
        for line, name in [(b'{"jsonrpc": "2.0", "id": 1, "method": ', "bad_json"),
                           (b'{"jsonrpc":"2.0","id":2,"method":"ping","params":' + deep + b"}",
                            "bad_json"),
                           (b'{"id":3,"method":"ping"}', "bad_request"),
                           (b'{"jsonrpc":"2.0","id":4,"method":"ping"}', "hello_first"),
                           (b'{"jsonrpc":"2.0","id":5,"method":"hello",'
                            b'"params":{"protocol":{"min":7,"max":9}}}', "version")]:
            stream.write(line + b"\n")
            stream.flush()
            answer = json.loads(stream.readline())
            assert answer["error"]["data"]["name"] == name, answer
        stream.write(b'{"jsonrpc":"2.0","id":6,"method":"hello",'
                     b'"params":{"protocol":{"min":1,"max":3}}}\n')
        stream.flush()
        assert json.loads(stream.readline())["result"]["protocol"] == 1


def test_a_connection_may_end_its_own_side_and_still_hear(daemon) -> None:
    with raw(daemon) as connection:
        connection.sendall(b'{"jsonrpc":"2.0","id":1,"method":"hello",'
                           b'"params":{"protocol":{"min":1,"max":1}}}\n'
                           b'{"jsonrpc":"2.0","id":2,"method":"session.list"}\n')
        connection.shutdown(socket.SHUT_WR)
        lines = read_all(connection).splitlines()
    assert [json.loads(line)["id"] for line in lines] == [1, 2]


def test_many_requests_without_reading_do_not_hurt(daemon) -> None:
    """A peer that asks and never reads is slowed down; the others are not."""
    with raw(daemon) as greedy:
        greedy.setblocking(False)
        line = b'{"jsonrpc":"2.0","id":1,"method":"hello","params":{"protocol":{"min":1,"max":1}}}\n'
        sent = 0
        try:
            for _ in range(200_000):
                sent += greedy.send(line)
        except BlockingIOError:
            pass
        assert sent > 0
        with daemon.link() as link:
            link.call("ping")


def test_a_large_json_stroke_is_parsed_off_the_loop_and_in_order(link) -> None:
    vertices = list(range(900))
    positions = [[0.001 * i, 0.5, 0.25] for i in vertices]
    stroke = {**GOOD, "vertices": vertices, "positions": positions}
    ids = [link.send("stroke.apply", stroke), link.send("history.undo", {"session": "sheet"})]
    assert [link.wait(id)["revision"] for id in ids] == [1, 2]


def test_wire_errors_are_not_mistaken_for_answers(daemon) -> None:
    with daemon.link(checked=False) as link:
        with pytest.raises((SkindError, WireError, ConnectionError)):
            link.socket.setblocking(True)
            link.socket.sendall(b"\0" * 64)
            link.socket.setblocking(False)
            link.call("ping")
