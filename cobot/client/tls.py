"""The certificates that a client trusts, and TLS connections that two threads can share."""

from __future__ import annotations

import os
import selectors
import ssl
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from cobot.errors import InputError

CERTIFICATE_VARIABLE = "COBOT_CERTIFICATE"
TOKEN_VARIABLE = "COBOT_TOKEN"
Verify = bool | str | Path | ssl.SSLContext
END = "-----END CERTIFICATE-----"
Result = TypeVar("Result")


class SharedSocket(ssl.SSLSocket):
    """A TLS connection in which one thread may read while a second thread writes, as the clients of
    `websockets` do.

    OpenSSL forbids this for one connection, and Python before 3.13 does not prevent it. A request that is
    written while a session ticket is read gets lost, about once in 300 connections. So a lock lets only one
    thread at a time use the connection, and no thread waits for data while it holds the lock.
    """

    def __new__(cls, *args: Any, **named: Any) -> SharedSocket:
        made = super().__new__(cls, *args, **named)
        made._turn = threading.Lock()
        made._timeout_s = None
        return made

    _turn: threading.Lock
    _timeout_s: float | None

    def settimeout(self, value: float | None) -> None:
        self._timeout_s = value
        super().settimeout(0.0)

    def setblocking(self, flag: bool) -> None:
        self.settimeout(None if flag else 0.0)

    def gettimeout(self) -> float | None:
        return self._timeout_s

    def do_handshake(self, block: bool = False) -> None:
        self._in_turn(super().do_handshake)

    def read(self, len: int = 1024, buffer: Any = None) -> Any:  # noqa: A002 - as its base calls it
        plain = super().read
        return self._in_turn(lambda: plain(len, buffer))

    def send(self, data: Any, flags: int = 0) -> int:
        plain = super().send
        return self._in_turn(lambda: plain(data, flags))

    def shutdown(self, how: int) -> None:
        """Shut down the connection without freeing memory that a reader still uses. The reader reads the end
        of the stream.
        """
        super(ssl.SSLSocket, self).shutdown(how)

    def _in_turn(self, operation: Callable[[], Result]) -> Result:
        end_s = None if self._timeout_s is None else time.monotonic() + self._timeout_s
        while True:
            try:
                with self._turn:
                    return operation()
            except (ssl.SSLWantReadError, ssl.SSLWantWriteError) as exc:
                if self._timeout_s == 0.0:
                    raise
                reads = isinstance(exc, ssl.SSLWantReadError)
                event = selectors.EVENT_READ if reads else selectors.EVENT_WRITE
            with selectors.DefaultSelector() as selector:
                selector.register(self, event)
                left_s = None if end_s is None else end_s - time.monotonic()
                if not selector.select(left_s):
                    raise TimeoutError(f"no answer for {self._timeout_s:g} s")


def advice(error: Exception) -> str:
    """Advice about a certificate that is not trusted, for the end of an error; "" for other errors."""
    if "CERTIFICATE_VERIFY_FAILED" not in str(error):
        return ""
    how = f"{CERTIFICATE_VARIABLE}=FILE or verify=FILE"
    return f"; to trust the service's own certificate, give its file: {how}"


def token_from_environment() -> str | None:
    """The access token in `COBOT_TOKEN`."""
    return os.environ.get(TOKEN_VARIABLE) or None


def token_header(token: str | None) -> dict[str, str]:
    """The HTTP header that contains the access token; empty if no token is given.

    Raises:
        InputError: the token contains characters that are not allowed in a token or in a header.
    """
    if not token:
        return {}
    if not (token.isascii() and token.isprintable()):
        raise InputError(
            f"the access token (token, --token or {TOKEN_VARIABLE}) has characters other than printable "
            "ASCII; copy it again"
        )
    return {"Authorization": f"Bearer {token}"}


def tls_context(verify: Verify) -> ssl.SSLContext:
    """The TLS context for a connection to a service.

    Args:
        verify: with True, trust the certificates that the computer trusts, or the file that
            `COBOT_CERTIFICATE` names. With a file path, trust only the service's own certificate (the first
            PEM block in the file), for any host name. With False, trust any certificate. This protects from
            eavesdropping but not from an interceptor.

    Raises:
        InputError: the file is not a certificate.
    """
    context = verify if isinstance(verify, ssl.SSLContext) else _context(verify)
    if context.sslsocket_class is ssl.SSLSocket:
        context.sslsocket_class = SharedSocket
    return context


def _context(verify: bool | str | Path) -> ssl.SSLContext:
    if verify is True:
        verify = os.environ.get(CERTIFICATE_VARIABLE) or True
    if verify is True:
        return ssl.create_default_context()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    if verify is False:
        context.verify_mode = ssl.CERT_NONE
        return context
    try:
        first, end, _ = Path(verify).read_text(encoding="ascii").partition(END)
        # Trust only the first certificate. With a whole chain, everything that its issuers have signed would
        # be trusted.
        context.load_verify_locations(cadata=first + end)
    except (OSError, ValueError) as exc:  # an SSLError is an OSError
        raise InputError(f"certificate {verify}: {exc}") from exc
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    return context
