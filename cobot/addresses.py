"""Addresses of robots in the service. A path without a robot's name means the default robot.

Plain paths are for the default robot. The same paths below /robots/NAME are for any robot:

    /robot/pose         /robots/NAME/pose
    /trajectory/send    /robots/NAME/trajectory/send
    /stop               /robots/NAME/stop, which stops only this robot
"""

from __future__ import annotations

from urllib.parse import quote, urlsplit

from cobot.errors import InputError

DEFAULT_URL = "http://localhost:8007"
CONTROL_TOKEN = "X-Control-Token"
"""Header with the token of a lease. The client that holds the lease sends it with its motions."""
VERSION = "/v1"
"""Prefix with the version of the API. The paths without it are aliases."""
CLIENT_NAME = "X-Client-Name"
"""Header in which a client without a token names its user, as percent-encoded UTF-8. It is not
authentication.
"""
PREFER, STRICT_STATUS = "Prefer", "status=strict"
"""Header and value for requesting a strict status: if a motion does not reach its goal, the answer has the
status of the error.
"""
IDEMPOTENCY_KEY = "Idempotency-Key"
"""Header that identifies a request. If the same request is sent again, it is not executed a second time."""
ROBOTS = "/robots"
NAME = "[A-Za-z0-9_-]{1,48}"
"""Pattern for the names of robots, cells, zones and fleets, which are parts of URLs."""
NAME_RULE = "1 to 48 letters, digits, - and _"
"""`NAME` in words, for messages."""
MCP = "/mcp/mcp"
"""Path of the MCP server for agents."""
MANUAL = "/manual"
"""Path of the manual."""
_PLAIN = "/robot"


def check_url(url: str) -> None:
    """Check that a URL is a service address.

    Raises:
        InputError: the URL is invalid; the message contains an example.
    """
    try:
        parts = urlsplit(url)
        problem = "" if parts.hostname and parts.scheme in ("http", "https") else "not http:// and a host"
        _ = parts.port
    except ValueError as exc:
        problem = str(exc)
    if problem:
        raise InputError(f"url {url!r}: {problem}; a valid one is {DEFAULT_URL}")


def address(url: str, robot: str) -> str:
    """The address of one robot in the service at `url`."""
    return f"{url.rstrip('/')}{ROBOTS}/{quote(robot, safe='')}"


def path_below(plain: str) -> str:
    """The path below /robots/NAME for a plain path, as in api_endpoints.yaml."""
    return plain.removeprefix(_PLAIN) if plain.startswith(f"{_PLAIN}/") else plain


def service_of(url: str) -> str:
    """The path prefix of the service, taken from the URL of the service or of one of its robots."""
    return urlsplit(url).path.rstrip("/").partition(f"{ROBOTS}/")[0]


def path_at(url: str, plain: str) -> str:
    """The path to append to `url` to reach `plain`; see `path_below` for URLs that name a robot."""
    return path_below(plain) if f"{ROBOTS}/" in urlsplit(url).path else plain
