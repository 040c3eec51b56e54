"""Responses that are sent before a connection is closed, in a way that the client can read them."""

from __future__ import annotations

import contextlib
import json
import socket

from uvicorn.protocols.http.httptools_impl import STATUS_LINE

from cobot.errors import BusyError, HeaderError

RECEIVE_BYTES = 65536
"""What the kernel keeps of a connection until it is read, which it is whole."""


def refusal(status: int, detail: str, code: str) -> bytes:
    """An answer in the form of `app.api.errors`, the last one of its connection."""
    body = json.dumps({"detail": detail, "code": code}).encode()
    kind = b"content-type: application/json\r\nconnection: close\r\n"
    return STATUS_LINE[status] + kind + b"content-length: %d\r\n\r\n" % len(body) + body


CROWDED = refusal(503, "too many connections are open, and this had to make room: try again", BusyError.code)


PLAIN = refusal(
    400, "this port speaks TLS: write https:// instead of http:// in the address", HeaderError.code
)
"""For a client that speaks HTTP without TLS where TLS is required."""


def turn_away(connection: socket.socket, answer: bytes = CROWDED) -> None:
    """Answer a connection that has no protocol yet, and read what it has sent.

    If data is unread when the connection is closed, the kernel sends a reset and the client loses the answer.
    """
    with contextlib.suppress(OSError):  # nothing has come, or it has gone
        connection.send(answer, socket.MSG_DONTWAIT)
        connection.recv(RECEIVE_BYTES, socket.MSG_DONTWAIT)
