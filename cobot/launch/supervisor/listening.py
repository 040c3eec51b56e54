"""The service's socket: its address, and the clients that may use it."""

from __future__ import annotations

import errno
import logging
import socket
from contextlib import ExitStack

from cobot.access.authentication import authentication_required, is_loopback
from cobot.access.tokens import TokenFile
from cobot.config import WebSection
from cobot.errors import UnavailableError

log = logging.getLogger("cobot")


def listen(web: WebSection) -> socket.socket:
    """Open a listening socket according to the settings.

    Raises:
        UnavailableError: listening is impossible; the message names the setting to change.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(web.host, web.port, type=socket.SOCK_STREAM)[0]
        with ExitStack() as failed:
            listener = failed.enter_context(socket.socket(family, socket.SOCK_STREAM))
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen(512)
            failed.pop_all()
    except (OSError, ValueError) as exc:  # ValueError: not a valid host name
        raise UnavailableError(_no_listener(web.host, web.port, exc)) from exc
    return listener


def url_of(listener: socket.socket, secure: bool) -> str:
    """The URL of the service for clients on this computer."""
    host, port = listener.getsockname()[:2]
    local = host in ("127.0.0.1", "0.0.0.0", "::", "::1")
    scheme = "https" if secure else "http"
    return f"{scheme}://{'localhost' if local else f'[{host}]' if ':' in host else host}:{port}"


def access_to(web: WebSection, listener: socket.socket | None) -> str:
    """The clients that may use the service, described as text.

    Raises:
        ConfigError: the file of tokens cannot be read or is invalid.
    """
    if listener is None:
        return "none: there is no service"
    address = listener.getsockname()[0]
    tokens = TokenFile(web.tokens).read()
    if authentication_required(web, address):
        if not tokens:
            log.warning("no client can use the service yet: cobot token create NAME --role operator")
        open_stop = "; the stop needs none" if web.stop_without_token else ""
        return f"with a token, {len(tokens)} in {web.tokens}{open_stop}"
    if is_loopback(address):
        return "all users of this computer, without a token"
    log.warning(
        "web.authentication is none, and %s is reachable from other computers: "
        "every client that reaches the port can move the robot",
        address,
    )
    return "EVERY CLIENT THAT REACHES THE PORT, without a token"


def _no_listener(host: str, port: int, error: OSError | ValueError) -> str:
    """The reason why listening fails, and the setting that the user must change."""
    reason = getattr(error, "strerror", None) or str(error)
    message = f"cannot listen on {host} port {port}: {reason}"
    match getattr(error, "errno", None):
        case errno.EADDRINUSE:
            return f"web.port: {message}; set another port, or --port 0, which picks a free port"
        case errno.EACCES:
            return f"web.port: {message}; set a port from 1024 on, which needs no privilege"
    return f"web.host: {message}; set an address of this computer, 127.0.0.1 or 0.0.0.0"
