"""Where a robot is found at the service: by its name, or, without one, the default robot.

What the plain paths are for the default robot, those below /robots/NAME are for any:

    /robot/pose         /robots/NAME/pose
    /trajectory/send    /robots/NAME/trajectory/send
    /stop               /robots/NAME/stop, of this robot alone
"""

from __future__ import annotations

from urllib.parse import quote, urlsplit

from cobot.errors import InputError

DEFAULT_URL = "http://localhost:8007"
CONTROL_TOKEN = "X-Control-Token"
"""The header that shows the token of a lease: its holder's motions carry it."""
VERSION = "/v1"
"""Version of the API, below which each path exists too. The paths without it are aliases."""
CLIENT_NAME = "X-Client-Name"
"""The header in which a client without a token names its user; percent-encoded UTF-8. It proves nothing."""
PREFER, STRICT_STATUS = "Prefer", "status=strict"
"""The header and its value by which a motion that did not arrive is answered with the status of its error."""
IDEMPOTENCY_KEY = "Idempotency-Key"
"""The header that marks a request which is sent again: it begins nothing a second time."""
ROBOTS = "/robots"
MCP = "/mcp/mcp"
"""Where agents reach the service."""
MANUAL = "/manual"
"""Where the service has its manual."""
_PLAIN = "/robot"


def check_url(url: str) -> None:
    """
    Raises:
        InputError: that is no address of a service, with what one looks like.
    """
    try:
        parts = urlsplit(url)
        problem = "" if parts.hostname and parts.scheme in ("http", "https") else "not http:// and a host"
        _ = parts.port
    except ValueError as exc:
        problem = str(exc)
    if problem:
        raise InputError(f"url {url!r}: {problem}; one looks like {DEFAULT_URL}")


def address(url: str, robot: str) -> str:
    """The address of one robot at the service at `url`."""
    return f"{url.rstrip('/')}{ROBOTS}/{quote(robot, safe='')}"


def path_below(plain: str) -> str:
    """What follows the name of a robot, of a plain path as in api_endpoints.yaml."""
    return plain.removeprefix(_PLAIN) if plain.startswith(f"{_PLAIN}/") else plain


def service_of(url: str) -> str:
    """The prefix of the service's paths, from an address of the service or of one of its robots."""
    return urlsplit(url).path.rstrip("/").partition(f"{ROBOTS}/")[0]


def path_at(url: str, plain: str) -> str:
    """The path to append to an address for a plain path; below a robot's address it is shorter."""
    return path_below(plain) if f"{ROBOTS}/" in urlsplit(url).path else plain
