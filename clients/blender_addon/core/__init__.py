# SPDX-License-Identifier: GPL-3.0-or-later
"""What any Python tool needs to talk to skind: the wire, a link for scripts, a channel for loops.

No bpy in here; NumPy is the only need.
"""

from .channel import Channel
from .exchange import Exchange
from .launch import Launcher
from .link import Link, default_socket_path
from .wire import (
    Decoder,
    Message,
    SkindError,
    WireError,
    encode_notification,
    encode_request,
    unflatten,
)

__all__ = [
    "Channel",
    "Decoder",
    "Exchange",
    "Launcher",
    "Link",
    "Message",
    "SkindError",
    "WireError",
    "default_socket_path",
    "encode_notification",
    "encode_request",
    "unflatten",
]
