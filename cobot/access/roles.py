"""Roles, and who asks."""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from enum import IntEnum

from cobot.errors import AuthenticationError, PermissionDenied


class Role(IntEnum):
    """What somebody may do: each role may do all that those before it may."""

    NOBODY = 0  # has not shown who it is: what is open to everybody
    OBSERVER = 1  # looks: states, logs, health
    AGENT = 2  # plans, and runs what an operator or the settings' fence has approved: docs/mcp.md
    OPERATOR = 3  # moves the arm, resets it, streams to it, runs programs that are there
    PROGRAMMER = 4  # brings programs along, and changes what later motions do: tool, payload, limits
    ADMIN = 5  # the rest: the audit, reading the settings anew


@dataclass(frozen=True, slots=True)
class Identity:
    """Who asks.

    Attributes:
        name: of the token, "anonymous" without one.
        role: what it may do.
        address: where it comes from, as the connection has it; "" for the service itself.
        forwarded: a proxy has passed it on, so that the address is the proxy's.
    """

    name: str
    role: Role
    address: str = ""
    forwarded: bool = False


ANONYMOUS = "anonymous"
ROS = "ros2"
"""Who comes over DDS, which cannot tell one from another."""
SERVICE = Identity("cobot", Role.ADMIN)
"""The service itself, when nobody has asked."""
acting: ContextVar[Identity] = ContextVar("acting", default=SERVICE)
"""On whose behalf the present task works: for what lies too deep to be told."""


def require(identity: Identity, role: Role) -> None:
    """See that somebody has at least this role.

    Raises:
        AuthenticationError: it has not shown who it is.
        PermissionDenied: its role is a lower one.
    """
    if identity.role >= role:
        return
    needed = role.name.lower()
    if identity.role is Role.NOBODY:
        proxy = "through a proxy, " if identity.forwarded else ""
        raise AuthenticationError(
            f"{proxy}a valid token of the role {needed} is needed: Authorization: Bearer TOKEN; "
            "`cobot token create` makes one"
        )
    raise PermissionDenied(
        f"{identity.name} has the role {identity.role.name.lower()}, which this does not permit: "
        f"it needs {needed}"
    )
