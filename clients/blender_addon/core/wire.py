# SPDX-License-Identifier: GPL-3.0-or-later
"""The wire of skind: messages to bytes, and bytes to messages. See protocol/PROTOCOL.md.

No sockets, no threads, no state beyond a Decoder's. Arrays go out as memoryviews of the caller's
own memory and come in as NumPy views of the frame that was read; neither way copies them.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any, Union

import numpy as np

MAGIC = b"SKD1"
HEADER = struct.Struct("<4sIQ")
FRAME_BYTES_MAX = 512 << 20
JSON_BYTES_MAX = 4 << 20
LINE_BYTES_MAX = 1 << 20  # of what is sent; answers in lines may be longer
BUFFERS_MAX = 16
PROTOCOL = {"min": 1, "max": 1}
GONE = ("lost", "shutting_down")  # errors of a daemon that goes; what was asked is asked again

DTYPES = {name: np.dtype(code) for name, code in
          {"u8": "u1", "u16": "<u2", "u32": "<u4", "i32": "<i4", "f32": "<f4", "f64": "<f8"}.items()}
NAMES = {dtype: name for name, dtype in DTYPES.items()}

Piece = Union[bytes, memoryview]


class WireError(Exception):
    """The stream cannot be followed any more: what came is no frame, or breaks its own promises."""


class SkindError(Exception):
    """The daemon refused a request. `name` and `code` are those of errors.def."""

    def __init__(self, code: int, name: str, message: str, hint: str = "", retryable: bool = False):
        super().__init__(f"{message} ({hint})" if hint else message)
        self.code = code
        self.name = name
        self.message = message
        self.hint = hint
        self.retryable = retryable

    @classmethod
    def from_json(cls, error: dict) -> "SkindError":
        data = error.get("data") or {}
        return cls(error.get("code", 0), data.get("name", "internal"), error.get("message", ""),
                   data.get("hint", ""), bool(data.get("retryable", False)))


# ---- out ----


def _plain(value: Any) -> Any:
    """For json: NumPy's scalars."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} does not go into JSON")


def _dump(message: dict) -> bytes:
    # NaN and infinity are no JSON; the daemon would refuse the whole message.
    text = json.dumps(message, ensure_ascii=False, allow_nan=False, separators=(",", ":"),
                      default=_plain)
    return text.encode("utf-8")


def _inline(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {name: _inline(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_inline(item) for item in value]
    return value


class _Tail:
    """Collects the arrays of one message behind each other, each at a multiple of 8 bytes."""

    def __init__(self) -> None:
        self.buffers: list[dict] = []
        self.pieces: list[Piece] = []
        self.bytes = 0

    def add(self, array: np.ndarray) -> dict:
        dtype = array.dtype.newbyteorder("<") if array.dtype.itemsize > 1 else array.dtype
        if dtype not in NAMES:
            raise TypeError(f"arrays of {array.dtype} do not travel; use one of {', '.join(DTYPES)}")
        if not 1 <= array.ndim <= 4:
            raise ValueError(f"an array of {array.ndim} dimensions does not travel; use 1 to 4")
        if len(self.buffers) == BUFFERS_MAX:
            raise ValueError(f"a message has at most {BUFFERS_MAX} arrays")
        array = np.ascontiguousarray(array, dtype)
        self.buffers.append({"dtype": NAMES[dtype], "shape": list(array.shape),
                             "offset": self.bytes})
        if array.nbytes:
            padding = -array.nbytes % 8
            self.pieces.append(memoryview(array.reshape(-1).view(np.uint8)))
            if padding:
                self.pieces.append(bytes(padding))
            self.bytes += array.nbytes + padding
        return {"buffer": len(self.buffers) - 1}

    def lift(self, value: Any) -> Any:
        """The value with each array in it replaced by a reference into the tail."""
        if isinstance(value, np.ndarray):
            return self.add(value)
        if isinstance(value, dict):
            return {name: self.lift(item) for name, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.lift(item) for item in value]
        return value


def _encode(message: dict, params: dict | None, lines: bool) -> list[Piece]:
    if lines:
        line = _dump({**message, "params": _inline(params or {})}) + b"\n"
        if len(line) > LINE_BYTES_MAX:
            raise ValueError(f"a line of {len(line)} bytes; the limit is {LINE_BYTES_MAX}")
        return [line]
    tail = _Tail()
    message = {**message, "params": tail.lift(params or {})}
    if tail.buffers:
        message["buffers"] = tail.buffers
    text = _dump(message)
    padding = -len(text) % 8
    total = HEADER.size + len(text) + padding + tail.bytes
    if len(text) > JSON_BYTES_MAX or total > FRAME_BYTES_MAX:
        raise ValueError(f"a frame of {total} bytes, {len(text)} of them JSON; the limits are "
                         f"{FRAME_BYTES_MAX} and {JSON_BYTES_MAX}")
    return [HEADER.pack(MAGIC, len(text), tail.bytes) + text + bytes(padding), *tail.pieces]


def encode_request(id: int | str, method: str, params: dict | None = None, *,
                   lines: bool = False) -> list[Piece]:
    """A request as pieces to be written one after the other.

    NumPy arrays may stand anywhere in params and travel with the dtype that they have. Do not
    change them before the pieces are written: they are sent from where they are.
    """
    return _encode({"jsonrpc": "2.0", "id": id, "method": method}, params, lines)


def encode_notification(method: str, params: dict | None = None, *,
                        lines: bool = False) -> list[Piece]:
    """The same without an id; `cancel` is the only one that the daemon knows."""
    return _encode({"jsonrpc": "2.0", "method": method}, params, lines)


# ---- in ----


@dataclass
class Message:
    """A message from the daemon. In params and result each {"buffer": i} is a NumPy array."""

    raw: dict  # as it came; what the schemas are held against
    id: int | str | None = None
    method: str | None = None  # of a notification
    params: dict = field(default_factory=dict)
    result: dict | None = None
    error: SkindError | None = None


def unflatten(value: Any, arrays: list[np.ndarray]) -> Any:
    """The value with each {"buffer": i} in it replaced by arrays[i]."""
    if isinstance(value, dict):
        if len(value) == 1 and "buffer" in value:
            index = value["buffer"]
            if not isinstance(index, int) or not 0 <= index < len(arrays):
                raise WireError(f"there is no buffer {index!r}")
            return arrays[index]
        return {name: unflatten(item, arrays) for name, item in value.items()}
    if isinstance(value, list):
        return [unflatten(item, arrays) for item in value]
    return value


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _view(buffer: Any, tail: np.ndarray) -> np.ndarray:
    """One entry of `buffers` as a view of the tail."""
    try:
        dtype, shape, offset = DTYPES[buffer["dtype"]], buffer["shape"], buffer["offset"]
    except (KeyError, TypeError):
        raise WireError(f"no description of a buffer: {buffer!r}") from None
    if (not isinstance(shape, list) or not 1 <= len(shape) <= 4
            or not all(map(_is_whole, shape)) or not _is_whole(offset) or offset % 8):
        raise WireError(f"no description of a buffer: {buffer!r}")
    count = 1
    for extent in shape:
        count *= extent
    if offset + count * dtype.itemsize > len(tail):
        raise WireError(f"a buffer beyond its tail of {len(tail)} bytes: {buffer!r}")
    return tail[offset:offset + count * dtype.itemsize].view(dtype).reshape(shape)


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _parse(text: bytes, tail: np.ndarray | None) -> Message:
    """A message; tail None: a line, whose arrays are lists and need not be walked."""
    try:
        raw = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise WireError(f"broken JSON: {error}") from None
    if not isinstance(raw, dict) or raw.get("jsonrpc") != "2.0":
        raise WireError("a message that is no JSON-RPC 2.0")
    buffers = raw.get("buffers", [])
    if not isinstance(buffers, list) or len(buffers) > BUFFERS_MAX:
        raise WireError("a message with too many buffers")
    message = Message(raw, raw.get("id"), raw.get("method"))
    if isinstance(raw.get("error"), dict):
        message.error = SkindError.from_json(raw["error"])
        return message
    params, result = raw.get("params"), raw.get("result")
    if tail is not None:
        arrays = [_view(buffer, tail) for buffer in buffers]
        params, result = unflatten(params, arrays), unflatten(result, arrays)
    message.params = params if isinstance(params, dict) else {}
    message.result = result if isinstance(result, dict) else None
    if message.method is None and message.result is None:
        raise WireError("a message without method, result or error")
    return message


_CHUNK_BYTES = 1 << 16


class Decoder:
    """Cuts a stream into messages, frames or lines by its first byte.

        into = decoder.get_buffer()
        for message in decoder.advance(socket.recv_into(into)):
            ...

    A frame is read straight into the memory that its arrays then view. That memory is not
    cleared before (which a bytearray would be), so an announced size costs only addresses.
    """

    def __init__(self) -> None:
        self.lines: bool | None = None  # None: not known yet
        self._head = bytearray(HEADER.size)
        self._block: np.ndarray | None = None
        self._used = 0
        self._json_bytes = 0
        self._chunk = bytearray()
        self._line = bytearray()

    def get_buffer(self) -> memoryview:
        """Where the next bytes go; at least one fits."""
        if self.lines:
            return memoryview(self._chunk)
        whole = self._head if self._block is None else self._block
        return memoryview(whole)[self._used:]

    def advance(self, count: int) -> list[Message]:
        """`count` bytes of the buffer hold data now; returns the messages that are whole."""
        if count == 0:
            return []
        if self.lines is None:
            self.lines = self._head[0] == ord("{")
            if self.lines:
                self._chunk = bytearray(self._head[:count]).ljust(_CHUNK_BYTES, b"\0")
        if self.lines:
            return self._advance_lines(count)
        self._used += count
        if self._block is None:
            self._advance_head()
        if self._block is None or self._used < len(self._block):
            return []
        return [self._take_frame()]

    def _advance_head(self) -> None:
        known = min(self._used, len(MAGIC))
        if self._head[:known] != MAGIC[:known]:
            raise WireError(f"these bytes are no frame: {bytes(self._head[:self._used])!r}")
        if self._used < HEADER.size:
            return
        _, self._json_bytes, tail_bytes = HEADER.unpack(self._head)
        total = HEADER.size + self._json_bytes + -self._json_bytes % 8 + tail_bytes
        if self._json_bytes > JSON_BYTES_MAX or total > FRAME_BYTES_MAX:
            raise WireError(f"a frame announces {total} bytes, {self._json_bytes} of them JSON")
        self._block = np.empty(total, np.uint8)
        self._block[:HEADER.size] = self._head

    def _take_frame(self) -> Message:
        block, self._block, self._used = self._block, None, 0
        end = HEADER.size + self._json_bytes
        tail = block[end + -self._json_bytes % 8:]
        return _parse(block[HEADER.size:end].tobytes(), tail)

    def _advance_lines(self, count: int) -> list[Message]:
        part = self._chunk[:count]
        self._line += part
        if b"\n" not in part:
            return []
        *lines, rest = self._line.split(b"\n")
        self._line = bytearray(rest)
        return [_parse(bytes(line), None) for line in lines if line.strip()]
