"""Connections of clients to the hub."""

from __future__ import annotations

from asyncio import Transport

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class HubConnection(HttpToolsProtocol):
    """A connection that is closed if no request comes on it, as one after an answer is. Otherwise clients
    without a token could use up all connections that the operating system permits to the hub.
    """

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.timeout_keep_alive_task = self.loop.call_later(
            self.timeout_keep_alive, self.timeout_keep_alive_handler
        )
