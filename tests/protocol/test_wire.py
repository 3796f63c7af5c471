"""The Python side of the wire against the C side, both ways, frames and lines."""

from __future__ import annotations

import json
import random
import struct

import numpy as np
import pytest
import schemas
from core.wire import (
    BUFFERS_MAX,
    DTYPES,
    JSON_BYTES_MAX,
    LINE_BYTES_MAX,
    Decoder,
    WireError,
    encode_notification,
    encode_request,
)
from probe import ask, ask_bytes, decode_all

FRAME_HEAD = struct.Struct("<4sIQ")


def random_array(rng: np.random.Generator, dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    """Random bits; for floats only finite ones."""
    target = DTYPES[dtype]
    count = int(np.prod(shape))
    bits = rng.integers(0, 256, count * target.itemsize, np.uint8)
    array = bits.view(target).copy()
    if target.kind == "f":
        array[~np.isfinite(array)] = target.type(0.1)
    return array.reshape(shape)


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def test_frames_of_any_arrays_come_back(probe_path):
    rng = np.random.default_rng(1)
    params = []
    for i in range(300):
        arrays = {}
        for j in range(rng.integers(0, 9)):
            dtype = rng.choice(list(DTYPES))
            shape = (int(rng.integers(0, 40)),)
            if rng.random() < 0.5 and shape[0] > 0:
                shape += (int(rng.integers(1, 9)),)
            arrays[f"a{j}"] = random_array(rng, dtype, shape)
        params.append({**arrays, "text": "é\"\\\n😀", "number": i / 8, "list": [1, [2, None]]})
    answers = ask(probe_path, (encode_request(f"id {i}", "any", p) for i, p in enumerate(params)),
                  "echo")
    assert len(answers) == len(params)
    for i, (sent, answer) in enumerate(zip(params, answers)):
        assert answer.id == f"id {i}"
        schemas.check("message", answer.raw, "answer")
        assert set(answer.result) == set(sent)
        for name, value in sent.items():
            if isinstance(value, np.ndarray):
                assert same_bits(answer.result[name], value)
            else:
                assert answer.result[name] == value


@pytest.mark.parametrize("lines", [False, True])
def test_strokes_are_read_as_sent(probe_path, lines):
    """What the C side decodes, from buffers and from plain JSON, is what was meant, bit by bit."""
    rng = np.random.default_rng(2)
    strokes = []
    for _ in range(60):
        n = int(rng.integers(0, 30))
        strokes.append({
            "session": "a", "pose": "walk 3", "stream": bool(rng.random() < 0.5),
            "stiffness": float(rng.random() * 10), "method": str(rng.choice(["exact", "thesis"])),
            "vertices": random_array(rng, "u32", (n,)),
            "positions": random_array(rng, "f32", (n, 3)),
            "locked_vertices": random_array(rng, "u32", (3,)),
            "locked_bones": ["hip", "Knöchel"],
        })
    answers = ask(probe_path, (encode_request(i, "stroke.apply", stroke, lines=lines)
                               for i, stroke in enumerate(strokes)))
    assert len(answers) == len(strokes)
    for i, (stroke, answer) in enumerate(zip(strokes, answers)):
        assert answer.error is None, answer.error
        assert answer.id == i
        assert isinstance(answer.result["vertices"], list if lines else np.ndarray)
        for name in ("vertices", "positions", "locked_vertices"):
            sent = stroke[name]
            back = np.asarray(answer.result[name], sent.dtype).reshape(sent.shape)
            assert same_bits(back, sent)
        for name in ("session", "pose", "stream", "method", "locked_bones"):
            assert answer.result[name] == stroke[name]
        assert answer.result["stiffness"] == pytest.approx(stroke["stiffness"], rel=1e-15)


@pytest.mark.parametrize("lines", [False, True])
def test_rigs_are_read_as_sent(probe_path, lines):
    rng = np.random.default_rng(3)
    vertices, bones, influences = 7, 3, 11
    rig = {
        "positions": random_array(rng, "f32", (vertices, 3)),
        "triangles": random_array(rng, "u32", (5, 3)),
        "bones": {"names": ["a", "b", "c"], "parents": np.array([-1, 0, 1], np.int32),
                  "binds": random_array(rng, "f64", (bones, 4, 4))},
        "influence_offsets": random_array(rng, "u32", (vertices + 1,)),
        "influence_joints": random_array(rng, "u16", (influences,)),
        "influence_weights": random_array(rng, "f32", (influences,)),
    }
    (answer,) = ask(probe_path, [encode_request(1, "session.create", rig, lines=lines)])
    assert answer.error is None, answer.error
    flat = {**rig, **rig["bones"]}
    for name in ("positions", "triangles", "parents", "binds", "influence_offsets",
                 "influence_joints", "influence_weights"):
        back = np.asarray(answer.result[name], flat[name].dtype).reshape(flat[name].shape)
        assert same_bits(back, flat[name]), name
    assert answer.result["names"] == ["a", "b", "c"]
    assert answer.result["fill"] == "neighbours"


def test_arrays_are_sent_from_where_they_are():
    positions = np.arange(30, dtype=np.float32).reshape(10, 3)
    head, piece = encode_request(1, "any", {"positions": positions})[:2]
    assert np.shares_memory(np.frombuffer(piece, np.uint8), positions)
    assert len(head) % 8 == 0
    # An array in another order or byte order is copied first, and means the same.
    pieces = encode_request(1, "any", {"positions": positions.T, "big": positions.astype(">f4")})
    (message,) = decode_all(b"".join(map(bytes, pieces)))
    assert np.array_equal(message.params["positions"], positions.T)
    assert same_bits(message.params["big"], positions)


def test_arrays_are_views_of_what_was_read():
    pieces = encode_request(1, "any", {"a": np.arange(5, dtype=np.uint16), "b": np.ones((2, 3))})
    (message,) = decode_all(b"".join(map(bytes, pieces)))
    a, b = message.params["a"], message.params["b"]
    assert not a.flags.owndata and not b.flags.owndata
    assert a.ctypes.data % 8 == 0 and b.ctypes.data % 8 == 0
    assert a.base is b.base or np.shares_memory(a.base, b.base)


def make_stream(lines: bool) -> bytes:
    requests = [
        encode_request(1, "ping", lines=lines),
        encode_request("two", "any", {"a": np.arange(7, dtype=np.uint8)}, lines=lines),
        encode_notification("cancel", {"id": 1}, lines=lines),
        encode_request(3, "any", {"x": np.ones((3, 2), np.float32), "y": np.zeros(0, np.uint32)},
                       lines=lines),
    ]
    return b"".join(bytes(piece) for request in requests for piece in request)


@pytest.mark.parametrize("lines", [False, True])
def test_streams_may_be_split_anywhere(lines):
    stream = make_stream(lines)
    whole = decode_all(stream)
    assert [message.id for message in whole] == [1, "two", None, 3]
    for cut in range(len(stream) + 1):
        decoder = Decoder()
        raws = []
        for part in (stream[:cut], stream[cut:]):
            while part:
                into = decoder.get_buffer()
                count = min(len(into), len(part))
                into[:count] = part[:count]
                raws += [message.raw for message in decoder.advance(count)]
                part = part[count:]
        assert raws == [message.raw for message in whole]
    for piece_bytes in (1, 2, 3, 17):
        assert [m.raw for m in decode_all(stream, piece_bytes)] == [m.raw for m in whole]


def test_c_and_python_cut_streams_alike(probe_path):
    """Blank lines and carriage returns, two messages in one write, and what is not finished."""
    stream = (b'{"jsonrpc":"2.0","id":1,"method":"any","params":{"a":1}}\r\n\n\r\n'
              b'{"jsonrpc":"2.0","id":2,"method":"any"}\n{"jsonrpc":"2.0"')
    assert [message.id for message in decode_all(stream)] == [1, 2]
    answers, status = ask_bytes(probe_path, stream, "echo")
    assert [answer.id for answer in answers] == [1, 2]
    assert answers[0].result == {"a": 1}
    assert status == 0


def frame(text: bytes, tail: bytes = b"") -> bytes:
    return FRAME_HEAD.pack(b"SKD1", len(text), len(tail)) + text + bytes(-len(text) % 8) + tail


def answer_with(buffers: object, tail: bytes = bytes(16)) -> bytes:
    message = {"jsonrpc": "2.0", "id": 1, "result": {"a": {"buffer": 0}}, "buffers": buffers}
    return frame(json.dumps(message).encode(), tail)


@pytest.mark.parametrize("stream", [
    b"x",
    b"SKD2",
    FRAME_HEAD.pack(b"SKD1", JSON_BYTES_MAX + 1, 0),
    FRAME_HEAD.pack(b"SKD1", 8, 512 << 20),
    FRAME_HEAD.pack(b"SKD1", 8, (1 << 64) - 1),
    frame(b""),
    frame(b"[]"),
    frame(b'{"jsonrpc":"2.0"}'),
    frame(b'{"jsonrpc":"1.0","id":1,"result":{}}'),
    frame(b'{"jsonrpc":"2.0","id":1,"result":{"a":NaN}}'),
    frame(b'{"jsonrpc":"2.0","id":1,"result":{"a":"\xff"}}'),
    frame(b"[" * 100000),
    answer_with([]),
    answer_with(7),
    answer_with([7]),
    answer_with([{"dtype": "f16", "shape": [1], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [5], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [4], "offset": 8}]),
    answer_with([{"dtype": "f32", "shape": [1], "offset": 4}]),
    answer_with([{"dtype": "f32", "shape": [-1], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [1.0], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [True], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [1] * 5, "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [1 << 62, 4], "offset": 0}]),
    answer_with([{"dtype": "f32", "shape": [1], "offset": 0}] * (BUFFERS_MAX + 1)),
    b"{]\n",
])
def test_broken_streams_are_refused(stream):
    with pytest.raises(WireError):
        decode_all(stream)


def test_what_does_not_travel_is_refused_here():
    with pytest.raises(TypeError):
        encode_request(1, "any", {"a": np.arange(3)})  # int64
    with pytest.raises(TypeError):
        encode_request(1, "any", {"a": np.zeros(3, bool)})
    with pytest.raises(TypeError):
        encode_request(1, "any", {"a": object()})
    with pytest.raises(ValueError):
        encode_request(1, "any", {"a": np.zeros((), np.float32)})
    with pytest.raises(ValueError):
        encode_request(1, "any", {"a": float("nan")})
    with pytest.raises(ValueError):
        encode_request(1, "any", {"a": np.array([np.inf], np.float32)}, lines=True)
    with pytest.raises(ValueError):
        encode_request(1, "any", {str(i): np.zeros(1) for i in range(BUFFERS_MAX + 1)})
    with pytest.raises(ValueError):
        encode_request(1, "any", {"a": "x" * JSON_BYTES_MAX})
    with pytest.raises(ValueError):
        encode_request(1, "any", {"a": "x" * LINE_BYTES_MAX}, lines=True)
    (head,) = encode_request(1, "any", {"a": np.float32(0.5), "b": np.int64(7)})
    assert b'"a":0.5,"b":7' in head


def test_limits_are_the_same_on_both_sides(probe_path):
    """One byte below, at and above the limit of a line, as the C side reads it."""
    rest = len(encode_request(1, "any", {"a": ""}, lines=True)[0])
    for extra in (-1, 0):
        (line,) = encode_request(1, "any", {"a": "x" * (LINE_BYTES_MAX - rest + extra)}, lines=True)
        (answer,) = ask(probe_path, [[line]], "echo")
        assert len(answer.result["a"]) == LINE_BYTES_MAX - rest + extra
    line = line.replace(b"xxxx", b"xxxxx", 1)
    (answer,), status = ask_bytes(probe_path, line, "echo")
    assert status == 1 and answer.id is None and answer.error.name == "too_large"


def test_broken_frames_are_answered_and_end_the_stream(probe_path):
    for stream, name in [(b"GET / HTTP/1.1\r\n\r\n", "bad_frame"),
                         (FRAME_HEAD.pack(b"SKD1", JSON_BYTES_MAX + 1, 0), "too_large"),
                         (FRAME_HEAD.pack(b"SKD1", 2, 1 << 40), "too_large")]:
        (answer,), status = ask_bytes(probe_path, stream)
        assert status == 1
        assert answer.id is None and answer.error.name == name
        assert answer.error.hint
        schemas.check("message", answer.raw, "failure")
    # Broken JSON costs only its message.
    ping = b"".join(map(bytes, encode_request(5, "ping")))
    answers, status = ask_bytes(probe_path, frame(b'{"id":4,') + ping)
    assert status == 0
    assert [answer.error and answer.error.name for answer in answers] == ["bad_json", None]


def test_spoilt_frames_never_stop_the_c_side(probe_path):
    """Frames with a few bytes changed behind the header: each still gets its answer."""
    rng = random.Random(4)
    good = [b"".join(map(bytes, request)) for request in (
        encode_request(1, "stroke.apply", {"session": "a", "pose": "p",
                                           "vertices": np.arange(4, dtype=np.uint32),
                                           "positions": np.ones((4, 3), np.float32)}),
        encode_request(2, "pose.set", {"session": "a", "pose": "p",
                                       "matrices": np.ones((2, 4, 4))}),
        encode_request("x", "hello", {"protocol": {"min": 1, "max": 1}}))]
    frames = []
    for _ in range(3000):
        data = bytearray(rng.choice(good))
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(16, len(data))] = rng.choice(b'{}[]",:0123456789.eE-x\\\x00\xff\n')
        frames.append(bytes(data))
    answers, status = ask_bytes(probe_path, b"".join(frames))
    assert status == 0
    refused = {answer.error.name for answer in answers if answer.error}
    # A spoilt id makes a notification of nothing else: all but `cancel` are answered.
    assert len(answers) == len(frames)
    assert {"bad_json", "bad_request", "bad_params"} <= refused
    assert any(answer.error is None for answer in answers)
    for answer in answers:
        if answer.error:
            schemas.check("message", answer.raw, "failure")
