"""The hosts and pages from which requests are accepted. This prevents foreign web pages from moving the arm.

Browsers allow any page to send requests to any host, and state in headers where each request comes from.
Clients other than browsers do not send these headers, and are accepted.

- `Host` is the name or address under which the client reached the service. A page can make its own host name
  resolve to this service (DNS rebinding), and then has the same origin as the service. But its `Host` is that
  name, which is not a name of this service. IP addresses cannot be rebound, so the addresses of this computer
  on which requests arrive are accepted.
- `Origin` is sent with every request that can change something, and with every WebSocket.
- `Sec-Fetch-Site` is sent with all other requests if the browser considers the connection secure.

Sources: the Fetch standard, the WebSocket standard, W3C Fetch Metadata Request Headers.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Iterable, Mapping
from functools import lru_cache

from starlette.types import Scope

from cobot.access.authentication import is_loopback, parsed
from cobot.config import WebSection
from cobot.errors import HeaderError, MisdirectedError, PermissionDenied
from cobot.strict import shown

_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([a-z0-9._-]+))(:[0-9]{1,5})?", re.IGNORECASE)
USUAL_PORTS = {"http": ":80", "https": ":443"}
LOCAL = "localhost"


class Origins:
    """Decides which hosts and origins are accepted.

    Args:
        hosts: names and addresses of this service, in addition to those of this computer and those listed.
        address: the address that the service listens on.
        web: `allowed_hosts` has additional names, `allowed_origins` the origins of other pages that may use
            the service.
    """

    def __init__(self, hosts: Iterable[str], address: str, web: WebSection) -> None:
        self._own = {LOCAL, *(host.lower() for host in hosts)}
        if not is_loopback(address):
            name = socket.gethostname().lower()
            self._own |= {name, f"{name}.local"}
        # Headers that a browser sends repeatedly are checked once.
        self._host_known = lru_cache(256)(self._is_ours)
        self._same_known = lru_cache(256)(_same)
        self.take_over(web)

    def take_over(self, web: WebSection) -> None:
        """Use the allowed origins and hosts of new settings, beginning with the next request."""
        self.listed = frozenset(origin.encode() for origin in web.allowed_origins)
        self._names = self._own.union(host.lower() for host in web.allowed_hosts)
        self._host_known.cache_clear()

    def check(self, scope: Scope, headers: Mapping[bytes, bytes]) -> None:
        """Check that the origin of a request is allowed.

        Args:
            headers: the request's headers that `app.api.middleware.access` has selected.

        Raises:
            HeaderError: the request has no header Host.
            MisdirectedError: the request is for another host.
            PermissionDenied: a foreign web page sent the request.
        """
        host, origin = headers.get(b"host"), headers.get(b"origin")
        if host is None:
            raise HeaderError(
                "the header Host is missing: send it with the name or address of this service, as in "
                "Host: localhost:8007"
            )
        server = scope.get("server")
        if not self._host_known(host, server[0] if server else ""):
            raise MisdirectedError(
                f"{shown(host.decode('latin-1'))} is not a name of this service: use its address, or list "
                f"the name in web.allowed_hosts"
            )
        if origin is not None:
            if origin in self.listed:
                return
            if not self._same_known(origin, host, scope["scheme"] in ("https", "wss")):
                raise PermissionDenied(
                    f"a page of {origin.decode('latin-1')[:200]} may not move the robot; allowed: pages "
                    f"of this service and of the origins in web.allowed_origins"
                )
        site = headers.get(b"sec-fetch-site")
        if site is not None and site not in (b"none", b"same-origin") and not _followed_link(scope, headers):
            raise PermissionDenied(
                "a page of another site may not use this service, unless web.allowed_origins lists its origin"
            )

    def _is_ours(self, header: bytes, server: str) -> bool:
        found = _HOST.fullmatch(header.decode("latin-1"))
        if found is None:
            return False
        name = (found[1] or found[2]).lower().removesuffix(".")
        if name in self._names:
            return True
        address = parsed(name)
        return address is not None and (address.is_loopback or address == parsed(server))


def _same(origin: bytes, host: bytes, secure: bool) -> bool:
    """Whether an origin is this host, with the scheme that is served here.

    Headers from a proxy are ignored. If a proxy adds TLS, `allowed_origins` must list the origin of the
    pages.
    """
    scheme, _, netloc = origin.decode("latin-1").lower().partition("://")
    if scheme != ("https" if secure else "http"):
        return False
    usual = USUAL_PORTS[scheme]
    return netloc.removesuffix(usual) == host.decode("latin-1").lower().removesuffix(usual)


def _followed_link(scope: Scope, headers: Mapping[bytes, bytes]) -> bool:
    """Whether a browser is following a link to one of cobot's pages. Opening a page changes nothing, so any
    page may link to it.
    """
    return (
        scope["type"] == "http"
        and scope["method"] == "GET"
        and headers.get(b"sec-fetch-mode") == b"navigate"
        and headers.get(b"sec-fetch-dest") == b"document"
    )
