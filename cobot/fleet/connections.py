"""Connections from clients to the hub."""

from __future__ import annotations

from asyncio import Transport

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class HubConnection(HttpToolsProtocol):
    """Closes a connection if no request arrives in time, even before its first request.

    Otherwise clients without a token could use up all the connections that the operating system permits to
    the hub.
    """

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.timeout_keep_alive_task = self.loop.call_later(
            self.timeout_keep_alive, self.timeout_keep_alive_handler
        )
