"""Roles, and the identity of the client that has sent a request."""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from cobot.errors import AuthenticationError, PermissionDenied


class Role(IntEnum):
    """The permissions of a client. Each role includes those of all lower roles."""

    PUBLIC = 0  # role of clients without a valid token, and of requests that need no token
    OBSERVER = 1  # reads states, logs and health
    AGENT = 2  # plans, and runs motions that an operator or the configured fence approved: docs/mcp.md
    OPERATOR = 3  # moves the arm, resets it, streams to it, runs stored programs
    PROGRAMMER = 4  # uploads programs and changes what affects later motions: tool, payload, limits
    ADMIN = 5  # everything else: reads the audit, reloads the settings


RoleName = Literal["observer", "agent", "operator", "programmer", "admin"]
"""A role of a token, as text."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The client that sends a request.

    Attributes:
        name: name of the client's token. Without a token, the name that the client gives itself, in quotes,
            or "anonymous".
        role: role that the client's token grants.
        address: peer address of the client's connection; "" for the service itself.
        forwarded: whether a proxy forwarded the request. If so, the address is the proxy's.
        stored: whether the client's token is in the file. If not, the service has granted it to a program.
    """

    name: str
    role: Role
    address: str = ""
    forwarded: bool = False
    stored: bool = False


ANONYMOUS = "anonymous"
ROS = "ros2"
"""Name of all clients that use DDS, because DDS cannot distinguish them."""
FLEET = "fleet"
"""Name of the process that connects this cell to a fleet."""
SERVICE = Identity("cobot", Role.ADMIN)
"""The service itself, when it acts without a request."""
acting: ContextVar[Identity] = ContextVar("acting", default=SERVICE)
"""Identity that the current task works for. Functions that do not receive the identity as an argument read it
here.
"""


def require(identity: Identity, role: Role) -> None:
    """Check that an identity has at least this role.

    Raises:
        AuthenticationError: the client has not authenticated.
        PermissionDenied: the client's role is lower.
    """
    if identity.role >= role:
        return
    needed = role.name.lower()
    if identity.role is Role.PUBLIC:
        proxy = "through a proxy, " if identity.forwarded else ""
        raise AuthenticationError(
            f"{proxy}a valid token of the role {needed} is needed: Authorization: Bearer TOKEN; "
            "`cobot token create` creates one"
        )
    raise PermissionDenied(
        f"{identity.name} has the role {identity.role.name.lower()}, but this request needs the role {needed}"
    )
