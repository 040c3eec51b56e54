"""Connections from clients to the hub."""

from __future__ import annotations

from asyncio import TimerHandle, Transport

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol


class HubConnection(HttpToolsProtocol):
    """Closes a connection if the header of a request is not complete in time, even before its first request.

    Otherwise clients without a token could use up all the connections that the operating system permits to
    the hub. uvicorn itself waits without a limit for the rest of a header.
    """

    _header_timer: TimerHandle | None = None
    """Set between the first bytes of a request and the end of its header."""

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.timeout_keep_alive_task = self._timer()

    def connection_lost(self, exc: Exception | None) -> None:
        self._end_header()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self.timeout_keep_alive_task is not None:
            self._header_timer = self._timer()
        super().data_received(data)

    def on_headers_complete(self) -> None:
        self._end_header()
        super().on_headers_complete()

    def timeout_keep_alive_handler(self) -> None:
        """Close the connection. A client that still owes a request gets an error response first."""
        owes = self.cycle is None or self._header_timer is not None
        if owes and not self.transport.is_closing():
            text = f"no complete request for {self.timeout_keep_alive} s: send it again\n".encode()
            self.transport.write(
                STATUS_LINE[408]
                + b"content-type: text/plain; charset=utf-8\r\nconnection: close\r\n"
                + b"content-length: %d\r\n\r\n%b" % (len(text), text)
            )
        super().timeout_keep_alive_handler()

    def _timer(self) -> TimerHandle:
        return self.loop.call_later(self.timeout_keep_alive, self.timeout_keep_alive_handler)

    def _end_header(self) -> None:
        if self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None
