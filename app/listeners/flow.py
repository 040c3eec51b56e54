"""Flow control for one connection: determines when it reads, and when the application may write."""

from __future__ import annotations

import asyncio
from asyncio import Transport
from collections.abc import Callable

from uvicorn.protocols.http.flow_control import FlowControl


class Flow(FlowControl):
    """Flow control for a connection. The connection resumes reading when the application wants more data and
    all received data has been processed.
    """

    def __init__(self, transport: Transport, process_held: Callable[[], None]) -> None:
        self._paused = False
        super().__init__(transport)
        self.held = False
        self.process_held = process_held

    @property
    def write_paused(self) -> bool:
        """Whether the application must `drain` before it may write more."""
        return self._paused or self._transport.is_closing()

    @write_paused.setter
    def write_paused(self, paused: bool) -> None:
        self._paused = paused

    async def drain(self) -> None:
        """Wait until more can be written. If the connection has just closed, wait until the application has
        been informed.
        """
        await super().drain()
        if self._transport.is_closing():
            await asyncio.sleep(0)

    def hold(self) -> None:
        self.held = True
        self._transport.pause_reading()

    def release(self) -> None:
        self.held = False
        if not self.read_paused and not self._transport.is_closing():
            self._transport.resume_reading()

    def resume_reading(self) -> None:
        if not self.read_paused:
            return
        self.read_paused = False
        if self.held:
            self.process_held()
        elif not self._transport.is_closing():
            self._transport.resume_reading()
