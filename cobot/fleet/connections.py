"""Connections from clients to the hub.

Clients without a token can connect, too. A client that is slow or silent must not keep a connection forever:
the operating system permits only a limited number of them. uvicorn itself waits without a limit for the
handshake of TLS, the rest of a header, a body and a client that does not read, and keeps every header and
every request that a client sends in advance.
"""

from __future__ import annotations

import asyncio
import socket
from asyncio import TimerHandle, Transport

import uvicorn
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

MAX_HEADER_BYTES = 64 * 2**10
MAX_WAITING_REQUESTS = 16
"""Maximum number of complete requests that wait for the response to an earlier one."""
BODY_S, BODY_BYTES_PER_S = 60.0, 1000.0
"""A body must be complete after the first time plus the time that it takes at the second rate."""
UNREAD_S = 60.0
"""Time in which a client must read some of a response that does not fit into the buffers."""


class HubServer(uvicorn.Server):
    """Limits the time that clients may take for the handshake of TLS and for its end."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=[])
        tls_s = self.config.timeout_keep_alive if self.config.ssl else None
        for each in sockets or ():
            listening = await asyncio.get_running_loop().create_server(
                self._connection,
                sock=each,
                ssl=self.config.ssl,
                backlog=self.config.backlog,
                ssl_handshake_timeout=tls_s,
                ssl_shutdown_timeout=tls_s,
            )
            self.servers.append(listening)

    def _connection(self) -> HubConnection:
        return HubConnection(self.config, self.server_state, self.lifespan.state)


class HubConnection(HttpToolsProtocol):
    """Closes a connection if a request (also the first one) is not complete in time, or if the client does
    not read the response.
    """

    _in_header = False
    """Whether the connection is between the first byte of a request and the end of its header."""
    _header_timer: TimerHandle | None = None
    """Set if the connection was idle, and the client has sent something that is not yet a request."""
    _body_timer: TimerHandle | None = None
    _unread_timer: TimerHandle | None = None
    _body_begun_s = 0.0
    _received = _body_bytes = 0
    """Bytes of the current request: all, without the piece with its beginning, and those of its body."""

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.timeout_keep_alive_task = self._timer()

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self._header_timer, self._body_timer, self._unread_timer):
            if timer is not None:
                timer.cancel()
        self._unset_keepalive_if_required()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self.timeout_keep_alive_task is not None:
            self._header_timer = self._timer()
        before = self.scope
        super().data_received(data)
        if self.scope is not before:  # the piece has the beginning of a request
            self._received = 0
            return
        self._received += len(data)
        if self._received - 10 * self._body_bytes > MAX_HEADER_BYTES and not self.transport.is_closing():
            self._answer_last(431, f"the header has more than {MAX_HEADER_BYTES} bytes")

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self._in_header, self._body_bytes = True, 0

    def on_headers_complete(self) -> None:
        self._in_header = False
        self._end_header()
        self._unset_keepalive_if_required()
        before = self.cycle
        super().on_headers_complete()
        if self.cycle is before:  # a WebSocket, which has a protocol of its own
            return
        if len(self.pipeline) > MAX_WAITING_REQUESTS:
            raise ValueError("too many requests")  # the parser makes this a status 400
        self._body_begun_s = self.loop.time()
        if self._body_timer is None:
            self._body_timer = self.loop.call_later(BODY_S, self._require_body)

    def on_body(self, body: bytes) -> None:
        self._body_bytes += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        super().on_message_complete()
        self._received = 0  # what follows belongs to the next request
        if self._header_timer is not None:  # the body of a request that was answered before it was complete
            self._end_header()
            self.timeout_keep_alive_task = self._timer()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self.transport.is_closing():
            return
        if self.pipeline:
            self.flow.pause_reading()  # a client must not send more requests than are answered
        elif self._in_header and self.timeout_keep_alive_task is not None:
            self._unset_keepalive_if_required()
            self._header_timer = self._timer()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._unread_timer = self.loop.call_later(UNREAD_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._unread_timer is not None:
            self._unread_timer.cancel()
            self._unread_timer = None

    def timeout_keep_alive_handler(self) -> None:
        """Close the connection. If the client has sent part of a request, it gets an error response first."""
        if (self.cycle is None or self._in_header) and not self.transport.is_closing():
            self._answer_last(408, f"no complete request for {self.timeout_keep_alive} s: send it again")
        super().timeout_keep_alive_handler()

    def _require_body(self) -> None:
        """Close the connection if a request is being answered, but its body has not arrived completely."""
        self._body_timer = None
        if not self.cycle.more_body or self.cycle.response_complete or self.transport.is_closing():
            return
        left_s = self._body_begun_s + BODY_S + self._body_bytes / BODY_BYTES_PER_S - self.loop.time()
        if self.flow.read_paused:  # the application is slow, and not the client
            left_s = max(left_s, BODY_S)
        if left_s > 0.0:
            self._body_timer = self.loop.call_later(left_s, self._require_body)
        elif self.cycle.response_started:
            self.transport.close()
        else:
            self._answer_last(408, f"the body is slower than {BODY_BYTES_PER_S:g} bytes a second")

    def _answer_last(self, status: int, why: str) -> None:
        text = f"{why}\n".encode()
        self.transport.write(
            STATUS_LINE[status]
            + b"content-type: text/plain; charset=utf-8\r\nconnection: close\r\n"
            + b"content-length: %d\r\n\r\n%b" % (len(text), text)
        )
        self.transport.close()

    def _timer(self) -> TimerHandle:
        return self.loop.call_later(self.timeout_keep_alive, self.timeout_keep_alive_handler)

    def _end_header(self) -> None:
        if self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None
