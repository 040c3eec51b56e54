"""Connections of clients to the hub."""

from __future__ import annotations

from asyncio import Transport

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class HubConnection(HttpToolsProtocol):
    """Closes a connection on which no request arrives in time, also before its first request. Otherwise
    clients without a token could use up all connections that the operating system permits to the hub.
    """

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.timeout_keep_alive_task = self.loop.call_later(
            self.timeout_keep_alive, self.timeout_keep_alive_handler
        )
