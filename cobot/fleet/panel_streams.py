"""Answers and WebSockets of a cell's service, which a hub reads piece by piece."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from cobot.errors import BusyError, NotFoundError, UnavailableError
from cobot.fleet.panel_messages import IDLE_S, MAX_PIECE_BYTES, PIECE_BYTES

MAX_STREAMS = 64
"""Maximum number of streams of a cell."""


class PanelStream:
    """Content on its way from a sender to the hub. The sender waits while the hub does not read.

    Attributes:
        status, headers: status and headers of an HTTP answer. The status is 0 until they have arrived, and
            always 0 for a WebSocket.
        send: function that sends a message from the hub; None for an HTTP answer.
        read_s: time of the last read.
    """

    def __init__(self) -> None:
        self.name = secrets.token_hex(16)
        self.status = 0
        self.headers: dict[str, str] = {}
        self.send: Callable[[str | bytes], Awaitable[None]] | None = None
        self.read_s = time.monotonic()
        self.task: asyncio.Task[None] | None = None
        self._frames: deque[tuple[bool, bytes]] = deque()
        self._size = 0
        self._error = ""
        self._ended = False
        self._changed = asyncio.Condition()

    async def put(self, content: bytes, *, is_text: bool = False) -> None:
        """Add content, once there is room for it."""
        async with self._changed:
            await self._changed.wait_for(lambda: self._size < PIECE_BYTES)
            self._frames.append((is_text, content))
            self._size += len(content)
            self._changed.notify_all()

    async def begin(self, status: int, headers: dict[str, str]) -> None:
        async with self._changed:
            self.status, self.headers = status, headers
            self._changed.notify_all()

    async def end(self, error: str = "") -> None:
        async with self._changed:
            self._error, self._ended = error, True
            self._changed.notify_all()

    async def read(self, wait_s: float) -> tuple[list[tuple[bool, bytes]], bool]:
        """The next content, and whether it is the last.

        Args:
            wait_s: maximum time to wait for content.

        Raises:
            UnavailableError: the content has ended because of an error.
        """
        async with self._changed:
            self.read_s = time.monotonic()
            try:
                async with asyncio.timeout(wait_s):
                    await self._changed.wait_for(lambda: self._frames or self._ended or self.status)
                    if not self._frames and not self._ended:  # only the status has arrived: content follows
                        await self._changed.wait_for(lambda: self._frames or self._ended)
            except TimeoutError:
                pass
            found: list[tuple[bool, bytes]] = []
            size = 0
            while self._frames and (not found or size + len(self._frames[0][1]) <= PIECE_BYTES):
                found.append(self._frames.popleft())
                size += len(found[-1][1])
            self._size -= size
            self._changed.notify_all()
            self.read_s = time.monotonic()
            if self._error and not found:
                raise UnavailableError(self._error)
            return found, self._ended and not self._frames and not self._error


class PanelStreams:
    """The open streams of a cell. All methods run in one event loop."""

    def __init__(self) -> None:
        self._streams: dict[str, PanelStream] = {}

    def open(self, work: Callable[[PanelStream], Coroutine[Any, Any, None]]) -> PanelStream:
        """Open a stream that `work` fills.

        Raises:
            BusyError: too many streams are open.
        """
        if len(self._streams) >= MAX_STREAMS:
            raise BusyError(
                f"{MAX_STREAMS} panel requests are in progress in this cell; close a panel, or try again"
            )
        stream = PanelStream()
        self._streams[stream.name] = stream
        stream.task = asyncio.create_task(self._fill(stream, work))
        return stream

    def get(self, name: str) -> PanelStream:
        """Find an open stream.

        Raises:
            NotFoundError: the stream has been closed.
        """
        if name not in self._streams:
            raise NotFoundError(
                "the cell has closed this stream, because it was not read in time; load the page again"
            )
        return self._streams[name]

    def close(self, name: str) -> None:
        stream = self._streams.pop(name, None)
        if stream is not None and stream.task is not None:
            stream.task.cancel()

    def close_unread(self, longest_s: float = IDLE_S) -> None:
        """Close the streams that were not read for longer than `longest_s`, because their hub is no longer
        connected.
        """
        now_s = time.monotonic()
        for name in [name for name, each in self._streams.items() if now_s - each.read_s > longest_s]:
            self.close(name)

    @staticmethod
    async def _fill(stream: PanelStream, work: Callable[[PanelStream], Coroutine[Any, Any, None]]) -> None:
        try:
            await work(stream)
            await stream.end()
        except Exception as exc:  # noqa: BLE001 - whatever ends it, the reader must learn that it has ended
            await stream.end(str(exc) or type(exc).__name__)


def require_piece(content: bytes) -> bytes:
    """Check the size of a WebSocket message.

    Raises:
        UnavailableError: the message is too large for the hub.
    """
    if len(content) > MAX_PIECE_BYTES:
        raise UnavailableError(
            f"a message has {len(content)} bytes, but a hub forwards at most {MAX_PIECE_BYTES}"
        )
    return content
