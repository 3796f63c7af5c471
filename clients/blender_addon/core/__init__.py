# SPDX-License-Identifier: GPL-3.0-or-later
"""What any Python tool needs to talk to skind: the wire, and a link over a Unix socket.

No bpy in here; NumPy is the only need.
"""

from .link import Exchange, Link, default_socket_path
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
    "Decoder",
    "Exchange",
    "Link",
    "Message",
    "SkindError",
    "WireError",
    "default_socket_path",
    "encode_notification",
    "encode_request",
    "unflatten",
]
