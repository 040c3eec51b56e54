"""Responses that are sent before a connection is closed, so that the client can still read them."""

from __future__ import annotations

import contextlib
import json
import socket

from uvicorn.protocols.http.httptools_impl import STATUS_LINE

from cobot.errors import BusyError, HeaderError

RECEIVE_BYTES = 65536
"""Maximum number of received bytes that are read before closing. The kernel's buffer holds at most this
many.
"""


def refusal(status: int, detail: str, code: str) -> bytes:
    """Create an error answer in the form of `app.api.errors`, after which the connection is closed."""
    body = json.dumps({"detail": detail, "code": code}).encode()
    kind = b"content-type: application/json\r\nconnection: close\r\n"
    return STATUS_LINE[status] + kind + b"content-length: %d\r\n\r\n" % len(body) + body


CROWDED = refusal(503, "too many connections are open, so this one is closed: try again", BusyError.code)


PLAIN = refusal(
    400, "this port speaks TLS: write https:// instead of http:// in the address", HeaderError.code
)
"""The answer to a client that speaks HTTP without TLS if TLS is required."""


def turn_away(connection: socket.socket, answer: bytes = CROWDED) -> None:
    """Answer a connection that has no protocol yet, and read the data that it has sent.

    If data is unread when the connection is closed, the kernel sends a reset and the client loses the answer.
    """
    with contextlib.suppress(OSError):  # no data, or the client has disconnected
        connection.send(answer, socket.MSG_DONTWAIT)
        connection.recv(RECEIVE_BYTES, socket.MSG_DONTWAIT)
