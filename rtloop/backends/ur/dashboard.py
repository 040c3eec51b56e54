"""A client for a controller's dashboard server. Each request and each answer is one line of text."""

from __future__ import annotations

from rtloop.backends import BackendError
from rtloop.backends.ur.transport import ByteStream, UrTransport

PORT = 29999
REPLY_S = 3.0
MAX_LINE = 65_536


class Dashboard:
    """Sends one request at a time. No method waits: `poll` is called repeatedly until it returns the
    answer.
    """

    def __init__(self, transport: UrTransport, address: str) -> None:
        self._transport, self._address = transport, address
        self._stream: ByteStream | None = None
        self._buffer = b""
        self._greeted = False
        self._request = ""
        self._since_s = 0.0

    def ask(self, request: str) -> None:
        """Begin a request. If necessary, connect first."""
        self._request, self._since_s = request, self._transport.clock()
        try:
            if self._stream is None:
                self._buffer, self._greeted = b"", False
                self._stream = self._transport.connect(self._address, PORT)
            elif self._greeted:
                self._stream.send(f"{request}\n".encode())
        except OSError as exc:
            raise self._make_error(exc.strerror or str(exc)) from exc

    def poll(self) -> str | None:
        """Return the answer to the last request; None until it has arrived.

        Raises:
            BackendError: the dashboard server does not answer; the error gives the reason.
        """
        if self._stream is None:
            raise self._make_error("it is not connected")
        try:
            if not self._greeted and not self._stream.is_connected():
                self._wait_on()
                return None
            self._buffer += self._stream.receive()
            line, found, rest = self._buffer.partition(b"\n")
            if not found or len(self._buffer) > MAX_LINE:
                self._wait_on()
                return None
            self._buffer = rest
            if not self._greeted:
                self._greeted = True
                self._stream.send(f"{self._request}\n".encode())
                return None
            return line.decode(errors="replace").strip()
        except OSError as exc:
            raise self._make_error(exc.strerror or str(exc)) from exc

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None

    def _wait_on(self) -> None:
        if self._transport.clock() - self._since_s > REPLY_S:
            raise self._make_error(f"no answer to {self._request!r} within {REPLY_S:g} s")

    def _make_error(self, why: str) -> BackendError:
        if self._stream is not None:
            self._stream.abort()  # otherwise a request to release the brakes could still arrive later
        self.close()
        return BackendError(
            f"the dashboard server at {self._address}, port {PORT}: {why}. Switch it on (Settings, Security, "
            "Services), or set robot.backend.dashboard: false and switch the arm on at the teach pendant"
        )
