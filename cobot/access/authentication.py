"""Whether tokens are needed, and whose a token is."""

from __future__ import annotations

import hmac
import logging
import os
import secrets
from dataclasses import dataclass
from hashlib import sha256
from ipaddress import IPv4Address, IPv6Address, ip_address

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile, Tokens
from cobot.clock import SYSTEM, Clock
from cobot.config import RosSection, WebSection
from cobot.errors import ConfigError

LOOK_AGAIN_S = 0.5
"""A token that was made or revoked is known after so long, s."""
ROS_TOKEN_VARIABLE = "COBOT_ROS_TOKEN"
"""The variable by which the service knows the DDS process; both have it in their environment."""
RIGHTS_OF_ROS = {"observe": Role.OBSERVER, "move": Role.OPERATOR, "all": Role.ADMIN}

log = logging.getLogger("cobot.service")


def is_loopback(address: str) -> bool:
    """Whether it is reached from this computer alone."""
    found = parsed(address)
    return found is not None and found.is_loopback


def parsed(address: str) -> IPv4Address | IPv6Address | None:
    """What is no name; ::ffff:127.0.0.1, as a socket for both families has it, is 127.0.0.1."""
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return None
    mapped = found.ipv4_mapped if isinstance(found, IPv6Address) else None
    return mapped or found


def authentication_required(web: WebSection, address: str) -> bool:
    """Whether tokens are needed by a service that listens on this address."""
    if web.authentication == "auto":
        return not is_loopback(address)
    return web.authentication == "required"


def rights_of_ros(ros: RosSection, web: WebSection) -> Role:
    """What DDS participants may do, none of which can show a token."""
    return RIGHTS_OF_ROS[_access_of_ros(ros, web)]


def ros_access(ros: RosSection, web: WebSection) -> str:
    """What DDS participants may do, for people."""
    if not ros.enabled:
        return "no ROS 2"
    access = _access_of_ros(ros, web)
    where = "on this computer" if ros.localhost_only else "on these networks"
    if access == "observe":
        may = "observes only"
    else:
        may = f"{'moves the robot' if access == 'move' else 'may do everything'} without a token"
    return f"over ROS 2 every participant {where} {may} (ros.access: {ros.access})"


def _access_of_ros(ros: RosSection, web: WebSection) -> str:
    """`ros.access`, with what auto means: moving needs a token where every client needs one."""
    if ros.access != "auto":
        return ros.access
    return "move" if ros.localhost_only and web.authentication != "required" else "observe"


@dataclass(frozen=True, slots=True)
class Holder:
    """Whose a token is, and what it permits."""

    name: str
    role: Role


class Authenticator:
    """Knows the tokens of the file, as it is now, and those that the service itself has given out.

    While the file is spoilt, none of its tokens is valid, and the log says why. The service goes on, and
    starts: it has to be there for a stop.
    """

    def __init__(self, file: TokenFile, clock: Clock = SYSTEM) -> None:
        self._file = file
        self._clock = clock
        self._given: dict[str, tuple[bytes, Holder, int]] = {}
        self._kept: list[tuple[bytes, Holder, int]] = []
        self._seen: object = None
        self._look_again_s = 0.0
        self._refresh()

    def find(self, token: str) -> Holder | None:
        """Whose it is; None for nobody's.

        Takes the same time whichever token it is, and whether it is one: it compares hashes, all of them,
        each in constant time.
        """
        self._refresh()
        digest = sha256(token.encode("utf-8", "surrogatepass")).digest()
        found: Holder | None = None
        ends_ns = 0
        for known, holder, expires_ns in (*self._kept, *self._given.values()):
            if hmac.compare_digest(known, digest):
                found, ends_ns = holder, expires_ns
        return None if ends_ns and self._clock.wall_ns() >= ends_ns else found

    def grant(self, name: str, role: Role, token: str | None = None) -> str:
        """Give out a token that is valid until it is withdrawn, and kept nowhere."""
        token = token or secrets.token_urlsafe(32)
        self._given[token] = sha256(token.encode()).digest(), Holder(name, role), 0
        return token

    def withdraw(self, token: str) -> None:
        """Take it back; nothing happens if that was done already."""
        self._given.pop(token, None)

    def _refresh(self) -> None:
        now_s = self._clock.now_s()
        if now_s < self._look_again_s:
            return
        self._look_again_s = now_s + LOOK_AGAIN_S
        seen = self._signature()
        if seen == self._seen:
            return
        try:
            self._take(self._file.read())
        except ConfigError as exc:
            log.error("no token is valid: %s", exc)
            self._kept = []
        self._seen = seen

    def _take(self, tokens: Tokens) -> None:
        self._kept = [
            (
                bytes.fromhex(each.sha256),
                Holder(each.name, each.rights),
                int(each.expires.timestamp() * 1e9) if each.expires else 0,
            )
            for each in tokens
        ]

    def _signature(self) -> object:
        """What changes when the file does: it is replaced, not written to."""
        try:
            status = os.stat(self._file.path)
        except OSError as exc:
            return exc.errno
        return status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode, status.st_uid
