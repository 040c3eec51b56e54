"""HTTP connections with limits for header size, body size and time, which take turns to use the event loop.

Received data is passed to the parser in slices, one in each turn. So one connection delays the others by at
most one slice, however costly its data is. A request that is rejected here gets an answer in the form of
`app.api.errors`, and the connection is closed.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
from asyncio import BaseTransport, Transport
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import httptools
from uvicorn._types import ASGI3Application
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from app.api.dependencies import BEGUN_S
from app.listeners.crowd import Crowd, Doing, Visit
from app.listeners.flow import Flow
from app.listeners.refusals import CROWDED, RECEIVE_BYTES, refusal
from app.listeners.turns import Turns
from app.listeners.websocket import StreamProtocol, keep_nothing_unsent
from cobot.addresses import VERSION
from cobot.clock import SYSTEM
from cobot.config import ConnectionLimits
from cobot.errors import BusyError, NotSupportedError

SLICE_BYTES = 4096
"""Maximum number of bytes that the parser gets at once. They contain at most a thousand parts, which take
about a millisecond.
"""
ROBOT = rb"(?:" + VERSION.encode() + rb")?(?:/robots/[A-Za-z0-9_-]+)?"
STOP = re.compile(rb"POST " + ROBOT + rb"/stop[ ?]")
"""Pattern of a stop request. A stop request does not wait for a turn."""
HEALTH = re.compile(rb"GET " + ROBOT + rb"/health(?:/\w+)?[ ?]")
"""Pattern of a health request. Health and stop requests are also answered on a reserve place."""
EVENTS = re.compile(ROBOT + rb"/events(?:[?]|$)")
"""Pattern of requests with endless answers."""
ABSOLUTE = re.compile(rb"[a-z][a-z0-9+.-]*://([^/?#]*)(.*)", re.IGNORECASE | re.DOTALL)
"""Pattern of an absolute request target. Group 1 is the host, group 2 the rest."""


@dataclass(frozen=True, slots=True)
class Shared:
    """Objects that all connections of a service share."""

    crowd: Crowd
    turns: Turns
    limits: ConnectionLimits


def _nothing() -> None:
    """Do nothing. This is the callback for a client that has disconnected."""


class _Refused(Exception):
    """Raised to stop the parser once an error response has been sent."""


class HttpProtocol(HttpToolsProtocol):
    """A connection, until it closes or becomes a WebSocket."""

    def __init__(self, *, shared: Shared, visit: Visit, **uvicorn: Any) -> None:
        super().__init__(**uvicorn)
        self._crowd, self._turns, self._limits = shared.crowd, shared.turns, shared.limits
        self._visit = visit
        self._answering: RequestResponseCycle | None = None  # uvicorn stores only the newest request
        # function that starts the application once the body has arrived
        self._start: Callable[[], object] = _nothing
        self._unread = bytearray()  # received data that waits for a turn
        self._waits = False
        # Number of bytes since the last progress. An endless header, trailer or chunk extension is no
        # progress.
        self._silent = 0
        self._header_bytes = self._body_bytes = 0
        self._in_header, self._in_body, self._answered = True, False, False
        self._ends = False
        self._begun_s = 0.0  # time at which the wait for the body began

    def connection_made(self, transport: BaseTransport) -> None:
        transport = cast(Transport, transport)
        super().connection_made(transport)
        self.flow: Flow = Flow(transport, self._wait)
        self._visit.close, self._visit.expire = self._make_room, self._expire
        self._note()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        # even after a reset, because the timer would keep this object alive
        self._unset_keepalive_if_required()
        if self._answering is not None:
            self._answering.disconnected = True
            self._answering.message_event.set()
        self._unread.clear()
        self._crowd.leave(self._visit)
        # Break all reference cycles, so that this object is freed at once. It may hold a large header, and
        # collecting the cycles of a flood takes a tenth of a second.
        self.flow.process_held = self._visit.close = self._visit.expire = self._start = _nothing
        self.cycle = self._answering = None  # type: ignore[assignment]
        self.pipeline.clear()

    def data_received(self, data: bytes) -> None:
        self._unset_keepalive_if_required()
        if not (self._in_header or self._in_body):
            self._in_header = True
            self._note()
        # In the middle of a request, the same bytes are only data.
        first = self._in_header and not self._silent and not self._unread
        stop = first and STOP.match(data)
        if first and not self._has_place(data):
            return
        busy = self._unread or self.pipeline
        if busy or len(data) > SLICE_BYTES or not (stop or self._turns.mine()):
            self._unread += data
            self.flow.hold()
            self._wait()
        else:
            self._feed(data)

    def _has_place(self, data: bytes) -> bool:
        """Whether this connection's place permits its request. A reserve place permits only a stop and
        /health. The check does not wait for a turn.

        A waiting /stop or /health is also recorded, because it is evicted later than a connection without a
        request.
        """
        if STOP.match(data) or HEALTH.match(data):
            self._crowd.note_progress(
                self._visit, Doing.WAITING, self.loop.time() + self._limits.header_timeout_s
            )
        elif self._visit.reserved and b"\r\n" in data:
            self._refuse_crowded()
            return False
        return True

    def _refuse_crowded(self) -> None:
        self._refuse(
            503, "too many connections are open: only a stop and /health are answered", BusyError.code
        )

    def _make_room(self) -> None:
        """Close this connection to make room for a new one. If the client reads its answers, it gets an error
        response first.
        """
        if self.transport.get_write_buffer_size():
            self.transport.abort()
        else:
            self._answer_last(CROWDED)

    def _wait(self) -> None:
        """Wait for a turn, unless already waiting for one."""
        if not self._waits:
            self._waits = True
            self._turns.wait(self._advance)

    def _advance(self) -> None:
        self._waits = False
        if self.transport.is_closing():
            self._unread.clear()
        # otherwise the application reports when it can accept more
        elif not (self.flow.read_paused or self.pipeline):
            data = bytes(self._unread[:SLICE_BYTES])
            del self._unread[:SLICE_BYTES]
            self._feed(data)
            if self._unread:
                self._wait()
            elif self.flow.held:
                self.flow.release()

    def _feed(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        self._silent += len(data)
        try:
            self.parser.feed_data(data)
        except httptools.HttpParserUpgrade:
            if self._should_upgrade():
                self.handle_websocket_upgrade()
        except httptools.HttpParserError:
            if not self.transport.is_closing():
                self.send_400_response("Invalid HTTP request received.")
        else:
            if self._in_body and not self._answered:
                self._visit.deadline_s = self._body_deadline_s
            if self._silent > self._limits.header_bytes:
                self._refuse_header()

    def handle_websocket_upgrade(self) -> None:
        self._unread.clear()
        self.flow.release()
        self._crowd.note_progress(
            self._visit, Doing.SENDING, self.loop.time() + self._limits.header_timeout_s
        )
        self._visit.close = self._visit.expire = self.transport.abort
        # Called by uvicorn, which knows only these arguments.
        self.ws_protocol_class = functools.partial(  # type: ignore[assignment]
            StreamProtocol, crowd=self._crowd, turns=self._turns, visit=self._visit
        )
        super().handle_websocket_upgrade()
        # This object is no longer needed. A reference cycle would keep it alive, see connection_lost.
        self.parser = None  # type: ignore[assignment]
        self.flow.process_held = _nothing

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self._header_bytes = self._body_bytes = 0

    def on_url(self, url: bytes) -> None:
        super().on_url(url)
        self._count_header(len(url))

    def on_header(self, name: bytes, value: bytes) -> None:
        super().on_header(name, value)
        self._count_header(len(name) + len(value) + 4)

    def on_headers_complete(self) -> None:
        self._require_chunked()
        if self.parser.should_upgrade() and self._should_upgrade():
            self._require_handshake()
        self._take_host()
        if self._visit.reserved:
            line = self.parser.get_method() + b" " + self.url + b" "
            if not (STOP.match(line) or HEALTH.match(line)):
                self._refuse_crowded()
                raise _Refused
        if EVENTS.match(self.url):
            keep_nothing_unsent(self.transport)
        self._silent = 0
        self._in_header, self._in_body, self._answered = False, True, False
        self._begun_s = self.loop.time()
        cast(dict[str, Any], self.scope)[BEGUN_S] = SYSTEM.now_s()
        super().on_headers_complete()
        self._note()

    def _require_chunked(self) -> None:
        """Check that the Transfer-Encoding is `chunked`, the only supported one. With others, the encoded
        data would be mistaken for the content.

        RFC 9112, 6.1. The parser itself rejects Transfer-Encoding together with Content-Length, and `chunked`
        before another encoding.
        """
        codings = [value.strip().lower() for name, value in self.headers if name == b"transfer-encoding"]
        if codings and (codings != [b"chunked"] or self.parser.get_http_version() != "1.1"):
            detail = "Transfer-Encoding: only chunked is supported, once, in HTTP/1.1"
            self._refuse(501, detail, NotSupportedError.code)
            raise _Refused

    def _require_handshake(self) -> None:
        """Check that the request for a WebSocket is valid: HTTP/1.1 and no body (RFC 6455, 4.2.1).

        Earlier answers on this connection must be complete. Otherwise they would be sent between the
        WebSocket's frames.
        """
        if self.cycle is not None and not self.cycle.response_complete:
            self.transport.abort()
            raise _Refused
        sized = any(
            name == b"transfer-encoding" or (name == b"content-length" and value.strip(b"0 "))
            for name, value in self.headers
        )
        if sized or self.parser.get_http_version() != "1.1":
            self._refuse(400, "a WebSocket must be requested in HTTP/1.1, without a body", "input")
            raise _Refused

    def _take_host(self) -> None:
        """Use the host of an absolute request target, the form that clients send to proxies. This host
        overrides `Host`.

        RFC 9112, 3.2.2. A missing or duplicate `Host` is not repaired, and is rejected later.
        """
        absolute = ABSOLUTE.fullmatch(self.url)
        if absolute is not None:
            host, rest = absolute.groups()
            self.url = rest if rest.startswith(b"/") else b"/" + rest
            self.headers[:] = [(name, host if name == b"host" else value) for name, value in self.headers]

    def on_body(self, body: bytes) -> None:
        super().on_body(body)
        if self.flow.read_paused:  # the application must first read some of the large body
            self._begin()
        self._silent = 0
        self._body_bytes += len(body)

    def on_message_complete(self) -> None:
        super().on_message_complete()
        self._silent = 0
        self._in_body = self._answered = False
        self._begin()
        self._note()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self._in_body:  # discard the rest of the body for a while
            self._answered = True
            self._begun_s, self._body_bytes = self.loop.time(), 0
        if self._unread and not self.pipeline:
            self._wait()
        self._note()

    def timeout_keep_alive_handler(self) -> None:
        """Close an idle connection. Send an error response first, because a request may be on its way."""
        idle = (
            f"the connection was idle for {self._limits.idle_timeout_s:g} s (web.limits.idle_timeout_s): "
            f"send the request again"
        )
        if not self.transport.is_closing():
            self._refuse(503, idle, BusyError.code)

    def shutdown(self) -> None:
        """End the connection. Endless answers have already ended. Clients that do not read their answers are
        not waited for.
        """
        super().shutdown()
        self._ends = True
        if self.flow.write_paused:
            self._leave_unread()

    def pause_writing(self) -> None:
        super().pause_writing()
        if self._ends:
            self._leave_unread()

    def _leave_unread(self) -> None:
        if self.cycle is not None and not self.cycle.response_complete and EVENTS.match(self.url):
            self.transport.abort()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: ASGI3Application) -> None:
        """Start the application at once if the request is a stop, or if the client waits for permission to
        send the body. All other requests start the application when their body is complete, so that slow or
        incomplete bodies use almost no resources.
        """
        start = super()._start_asgi_task
        self._answering = cycle
        if cycle.scope["method"] == "POST" and STOP.match(f"POST {cycle.scope['path']} ".encode()):
            start(cycle, app)
            return
        self._start = lambda: self._turns.wait(lambda: cycle.disconnected or start(cycle, app))
        if not cycle.more_body or cycle.waiting_for_100_continue:
            self._begin()

    def _begin(self) -> None:
        start, self._start = self._start, _nothing
        start()

    @property
    def _body_deadline_s(self) -> float:
        limits = self._limits
        return self._begun_s + limits.body_timeout_s + self._body_bytes / limits.body_bytes_per_s

    def _note(self) -> None:
        """Report the activity of this connection to the crowd."""
        if self._in_body:
            self._crowd.note_progress(self._visit, Doing.SENDING, self._body_deadline_s)
        elif self.cycle is not None and not self.cycle.response_complete:
            self._crowd.note_progress(self._visit, Doing.SERVED)
        elif self._in_header:
            self._crowd.note_progress(
                self._visit, Doing.ASKING, self.loop.time() + self._limits.header_timeout_s
            )
        else:
            self._crowd.note_progress(self._visit, Doing.IDLE)  # uvicorn's version starts a timer

    def _expire(self) -> None:
        limits = self._limits
        if self.flow.read_paused or self._unread:  # the service is late, not the client
            self._visit.deadline_s = self.loop.time() + limits.body_timeout_s
        elif self._answered:
            self.transport.abort()
        elif self._in_body:
            slowest = (
                f"web.limits: {limits.body_timeout_s:g} s, then {limits.body_bytes_per_s} bytes per second"
            )
            self._refuse(408, f"the body arrived too slowly ({slowest})", "timeout")
        else:
            self._refuse(408, f"the header was not complete after {limits.header_timeout_s:g} s", "timeout")

    def _count_header(self, size: int) -> None:
        self._header_bytes += size
        if self._header_bytes > self._limits.header_bytes:
            self._refuse_header()
            raise _Refused

    def _refuse_header(self) -> None:
        limit = f"{self._limits.header_bytes} bytes (web.limits.header_bytes)"
        self._refuse(431, f"the header is larger than the limit of {limit}", "header")

    def _refuse(self, status: int, detail: str, code: str) -> None:
        """Send an error, unless an answer is already being sent, and close the connection."""
        self._answer_last(refusal(status, detail, code))

    def _answer_last(self, answer: bytes) -> None:
        answering = (
            self.cycle is not None and self.cycle.response_started and not self.cycle.response_complete
        )
        if answering or self.pipeline:
            self.transport.abort()
            return
        self.transport.write(answer)
        with contextlib.suppress(OSError):  # otherwise a client would get a reset instead of the answer
            os.read(self.transport.get_extra_info("socket").fileno(), RECEIVE_BYTES)
        self.transport.close()
