"""Talks to wire_probe: what is written at once, and what comes back."""

from __future__ import annotations

import subprocess
from typing import Iterable

from core.wire import Decoder, Message


def decode_all(data: bytes, piece_bytes: int = 1 << 30) -> list[Message]:
    """A whole stream through a Decoder, at most `piece_bytes` at a time."""
    decoder = Decoder()
    messages = []
    rest = memoryview(data)
    while len(rest):
        into = decoder.get_buffer()
        count = min(len(into), len(rest), piece_bytes)
        into[:count] = rest[:count]
        messages += decoder.advance(count)
        rest = rest[count:]
    return messages


def ask_bytes(path: str, data: bytes, *arguments: str) -> tuple[list[Message], int]:
    """Sends bytes as they are; returns the answers and the exit status."""
    done = subprocess.run([path, *arguments], input=data, stdout=subprocess.PIPE, timeout=60,
                          check=False)
    assert done.returncode in (0, 1), f"wire_probe ended with {done.returncode}"
    return decode_all(done.stdout), done.returncode


def ask(path: str, requests: Iterable[list], *arguments: str) -> list[Message]:
    """Sends encoded requests in one go; one answer each."""
    pieces = [bytes(piece) for request in requests for piece in request]
    messages, status = ask_bytes(path, b"".join(pieces), *arguments)
    assert status == 0
    return messages
