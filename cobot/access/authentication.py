"""Decides whether clients need tokens, and finds the holder of a token."""

from __future__ import annotations

import asyncio
import contextlib
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
from cobot.config import FleetSection, RosSection, WebSection
from cobot.errors import ConfigError

LOOK_AGAIN_S = 0.5
"""Longest delay until a revoked token is rejected, in seconds. A new token is valid immediately."""
ROS_TOKEN_VARIABLE = "COBOT_ROS_TOKEN"
"""Environment variable with the token of the DDS process. It is set for the service and for the DDS
process.
"""
FLEET_TOKEN_VARIABLE = "COBOT_FLEET_TOKEN"
"""Environment variable with the token of the fleet process. It is set for the service and for the fleet
process.
"""
RIGHTS_OF_ROS = {"observe": Role.OBSERVER, "move": Role.OPERATOR, "all": Role.ADMIN}

log = logging.getLogger("cobot.service")


def is_loopback(address: str) -> bool:
    """Whether an address is reachable only from this computer."""
    found = parsed(address)
    return found is not None and found.is_loopback


def parsed(address: str) -> IPv4Address | IPv6Address | None:
    """The parsed address; None if the text is a host name. A mapped address (::ffff:127.0.0.1) becomes
    127.0.0.1.
    """
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return None
    mapped = found.ipv4_mapped if isinstance(found, IPv6Address) else None
    return mapped or found


def authentication_required(web: WebSection, address: str) -> bool:
    """Whether a service that listens on this address requires tokens."""
    if web.authentication == "auto":
        return not is_loopback(address)
    return web.authentication == "required"


def rights_of_ros(ros: RosSection, web: WebSection) -> Role:
    """The role of DDS participants, which cannot present a token."""
    return RIGHTS_OF_ROS[_access_of_ros(ros, web)]


def rights_of_fleet(fleet: FleetSection) -> Role:
    """The role of the process that connects this cell to a fleet. Reloading settings needs the role admin."""
    if fleet.certificates is None:
        return Role.OBSERVER
    return Role.PROGRAMMER if fleet.accept.settings == "none" else Role.ADMIN


def fleet_tokens(fleet: FleetSection, token: str) -> dict[str, Role]:
    """The tokens of the process that connects this cell to a fleet: its own token, and one token for each
    role in which people use the panel through the hub.
    """
    found = {token: rights_of_fleet(fleet)}
    if fleet.certificates is not None and fleet.accept.panel != "none":
        most = Role.OBSERVER if fleet.accept.panel_commands == "none" else Role.PROGRAMMER
        found |= {panel_token(token, role): role for role in Role if Role.OBSERVER <= role <= most}
    return found


def panel_token(fleet_token: str, role: Role) -> str:
    """The token that the fleet process uses for requests from people with this role."""
    return hmac.digest(fleet_token.encode(), f"panel {role.name}".encode(), "sha256").hex()


def ros_access(ros: RosSection, web: WebSection) -> str:
    """A sentence that describes for users what DDS participants may do."""
    if not ros.enabled:
        return "no ROS 2"
    access = _access_of_ros(ros, web)
    where = "on this computer" if ros.localhost_only else "on these networks"
    if access == "observe":
        may = "observes only"
    else:
        may = f"{'may move the robot' if access == 'move' else 'may do everything'} without a token"
    return f"over ROS 2 every participant {where} {may} (ros.access: {ros.access})"


def _access_of_ros(ros: RosSection, web: WebSection) -> str:
    """The value of `ros.access`, with `auto` resolved: if every client needs a token, DDS participants may
    not move the robot.
    """
    if ros.access != "auto":
        return ros.access
    return "move" if ros.localhost_only and web.authentication != "required" else "observe"


@dataclass(frozen=True, slots=True)
class Holder:
    """The holder of a token and the role that the token grants.

    Attributes:
        stored: whether the token is in the file. If not, the service has granted it to a program.
    """

    name: str
    role: Role
    stored: bool = False


class Authenticator:
    """Checks tokens against the token file and against the tokens that the service itself has granted.

    While the file is invalid, none of its tokens is accepted, and the log gives the reason. The service still
    starts and runs, because clients must be able to stop the robot.
    """

    def __init__(self, file: TokenFile, clock: Clock = SYSTEM) -> None:
        self._file = file
        self._clock = clock
        self._given: dict[str, tuple[bytes, Holder, int]] = {}
        self._kept: list[tuple[bytes, Holder, int]] = []
        self._used_ns: dict[bytes, int] = {}
        self._seen: object = None
        self._look_again_s = 0.0
        self._changed = asyncio.Event()
        self._refresh()

    @property
    def file(self) -> TokenFile:
        """The token file. After a change, call `notice_change`."""
        return self._file

    def last_used_ns(self, sha256_hex: str) -> int | None:
        """Unix time of the last use of the token with the given hash, ns; None if the token has not been used
        since the service started.
        """
        return self._used_ns.get(bytes.fromhex(sha256_hex))

    def has_token(self, name: str) -> bool:
        """Whether the file contains an unexpired token with this name."""
        self._refresh()
        now_ns = self._clock.wall_ns()
        return any(holder.name == name and not 0 < ends_ns <= now_ns for _, holder, ends_ns in self._kept)

    def notice_change(self) -> None:
        """Apply a change of the file immediately, for requests and for open connections."""
        self._look_again_s = self._clock.now_s()
        self._refresh()
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def await_change(self) -> None:
        """Wait for a possible change of the file, for at most `LOOK_AGAIN_S`."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), LOOK_AGAIN_S)

    def find(self, token: str) -> Holder | None:
        """The holder of a token; None if the token is invalid or has expired.

        The duration of this call does not depend on the stored tokens, because each hash is compared, in
        constant time. The file is checked for changes only if the token is unknown, because the token may be
        new.
        """
        self._refresh()
        digest = sha256(token.encode("utf-8", "surrogatepass")).digest()
        found = self._holder(digest)
        if found is None and self._signature() != self._seen:
            self._look_again_s = self._clock.now_s()
            self._refresh()
            found = self._holder(digest)
        return found

    def _holder(self, digest: bytes) -> Holder | None:
        found: Holder | None = None
        ends_ns = 0
        for known, holder, expires_ns in (*self._kept, *self._given.values()):
            if hmac.compare_digest(known, digest):
                found, ends_ns = holder, expires_ns
        now_ns = self._clock.wall_ns()
        if found is None or (ends_ns and now_ns >= ends_ns):
            return None
        if found.stored:
            self._used_ns[digest] = now_ns
        return found

    def grant(self, name: str, role: Role, token: str | None = None) -> str:
        """Create a token that is valid until it is withdrawn. The token is not stored on disk."""
        token = token or secrets.token_urlsafe(32)
        self._given[token] = sha256(token.encode()).digest(), Holder(name, role), 0
        return token

    def withdraw(self, token: str) -> None:
        """Revoke a granted token. Revoking it twice has no effect."""
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
                Holder(each.name, each.rights, stored=True),
                int(each.expires.timestamp() * 1e9) if each.expires else 0,
            )
            for each in tokens
        ]
        known = {digest for digest, _, _ in self._kept}
        self._used_ns = {digest: used for digest, used in self._used_ns.items() if digest in known}

    def _signature(self) -> object:
        """Properties of the file that change whenever it is replaced. The file is never changed in place."""
        try:
            status = os.stat(self._file.path)
        except OSError as exc:
            return exc.errno
        return status.st_ino, status.st_mtime_ns, status.st_size, status.st_mode, status.st_uid
