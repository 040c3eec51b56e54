"""WebSocket connections that take turns to use the event loop, and buffer almost nothing for slow clients."""

from __future__ import annotations

import socket
from asyncio import BaseTransport, Transport
from typing import Any, cast

from uvicorn._types import ASGIReceiveEvent, ASGISendEvent
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.http11 import Request

from app.listeners.crowd import Crowd, Doing, Visit
from app.listeners.turns import Turns
from app.rosbridge import router as rosbridge
from cobot.addresses import VERSION

UNSENT_BYTES = 4096
SLICE_BYTES = 1024
"""Maximum number of bytes that the parser gets at once. They contain at most 170 frames, which take about two
milliseconds.
"""
MAX_FRAGMENTS = 1024
"""Maximum number of frames in one message."""
TOO_BIG = 1009


def keep_nothing_unsent(transport: Transport) -> None:
    """Keep as little unsent data as possible. Messages are created only when they can be sent, so a slow
    client gets the newest data.
    """
    # Not 0, because with TLS even an empty buffer would be above the limit.
    transport.set_write_buffer_limits(high=1, low=0)
    connection = transport.get_extra_info("socket")
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)


class StreamProtocol(WebSocketsSansIOProtocol):
    """A WebSocket connection. Received data is queued until it is this connection's turn. A slow client gets
    only the newest data.
    """

    def __init__(self, *, crowd: Crowd, turns: Turns, visit: Visit, **uvicorn: Any) -> None:
        super().__init__(**uvicorn)
        self._crowd, self._turns, self._visit = crowd, turns, visit
        self._unread = bytearray()
        self._waits = False
        self._pong = b""

    def handle_connect(self, event: Request) -> None:
        if event.path.partition("?")[0].removeprefix(VERSION) == rosbridge.PATH:
            self.conn.max_message_size = rosbridge.MAX_FRAME_BYTES
        super().handle_connect(event)

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        keep_nothing_unsent(cast(Transport, transport))

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.conn.parser.close()  # otherwise a reference cycle in the parser keeps the last frame
        self._unread.clear()
        self._crowd.leave(self._visit)
        self._visit.close = self._visit.expire = lambda: None

    def data_received(self, data: bytes) -> None:
        # frames that arrive before the answer to the handshake wait too
        unanswered = self.handshake_initiated and not self.handshake_complete
        if unanswered or self._unread or len(data) > SLICE_BYTES or not self._turns.mine():
            self._unread += data
            self.transport.pause_reading()
            if not unanswered:
                self._wait()
        else:
            super().data_received(data)

    async def receive(self) -> ASGIReceiveEvent:
        message = await self.queue.get()
        if self.read_paused and self.queue.empty():
            self.read_paused = False
            if self._unread:
                self._wait()
            elif not self.transport.is_closing():
                self.transport.resume_reading()
        await self._turns.turn()
        return message

    async def send(self, message: ASGISendEvent) -> None:
        """Send an event. Raises ClientDisconnected once either side has closed the connection."""
        try:
            await super().send(message)
        except RuntimeError:
            if self.close_sent:
                raise ClientDisconnected from None
            raise
        if message["type"] == "websocket.accept" and not self.handshake_complete:  # the client has left
            raise ClientDisconnected
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True  # a rejection is also an answer to the handshake
        if message["type"] == "websocket.accept":
            self._crowd.note_progress(self._visit, Doing.STREAMING)
            if self._unread:
                self._wait()

    def resume_writing(self) -> None:
        super().resume_writing()
        if self._pong:
            self.transport.write(self._pong)
            self._pong = b""

    def handle_ping(self) -> None:
        """Answer a ping. If the client does not read, only the newest ping is answered, as RFC 6455 (5.5.3)
        permits.
        """
        pong = b"".join(self.conn.data_to_send())
        if self.writable.is_set():
            self.transport.write(pong)
        elif pong:
            self._pong = pong

    def handle_text(self, event: Frame) -> None:
        super().handle_text(event)
        event.data = b""  # the parser keeps the frame until the next one arrives

    def handle_cont(self, event: Frame) -> None:
        if len(self.frames) >= MAX_FRAGMENTS:
            self.conn.fail(TOO_BIG, f"a message may have {MAX_FRAGMENTS} fragments")
            self.handle_parser_exception()
        else:
            super().handle_cont(event)
            event.data = b""

    def _wait(self) -> None:
        """Wait for a turn, unless already waiting for one."""
        if not self._waits:
            self._waits = True
            self._turns.wait(self._advance)

    def _advance(self) -> None:
        self._waits = False
        if self.transport.is_closing():
            self._unread.clear()
        elif not self.read_paused:  # otherwise the application must read earlier messages first
            data = bytes(self._unread[:SLICE_BYTES])
            del self._unread[:SLICE_BYTES]
            super().data_received(data)
            if self._unread:
                self._wait()
            elif not self.read_paused and not self.transport.is_closing():
                self.transport.resume_reading()
