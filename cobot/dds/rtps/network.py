"""Network interfaces, ports, and the choice between the addresses of a peer (IPv4)."""

from __future__ import annotations

import fcntl
import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv4Interface

from cobot.dds.rtps.errors import NetworkError
from cobot.dds.rtps.types import Address

LOOPBACK = "127.0.0.1"
DISCOVERY_GROUP = "239.255.0.1"
_MAX_DOMAIN = 232
MAX_PARTICIPANTS = 120
_PORTS_WITHOUT_MULTICAST = 10

# linux/sockios.h
_SIOCGIFADDR = 0x8915
_SIOCGIFNETMASK = 0x891B


@dataclass(frozen=True, slots=True)
class Ports:
    """UDP ports of a domain (RTPS 2.2, 9.6.1.1)."""

    domain_id: int

    def __post_init__(self) -> None:
        if not 0 <= self.domain_id <= _MAX_DOMAIN:
            raise NetworkError(f"domain {self.domain_id} is not within 0..{_MAX_DOMAIN}")

    @property
    def discovery(self) -> int:
        return 7400 + 250 * self.domain_id

    def metatraffic(self, participant: int) -> int:
        return self.discovery + 10 + 2 * participant

    def user(self, participant: int) -> int:
        return self.discovery + 11 + 2 * participant


def _interface(name: str, probe: socket.socket) -> IPv4Interface | None:
    """The first IPv4 address and network of an interface; None if it has no IPv4 address."""
    request = struct.pack("256s", name.encode()[:15])
    try:
        address = fcntl.ioctl(probe, _SIOCGIFADDR, request)[20:24]
        mask = fcntl.ioctl(probe, _SIOCGIFNETMASK, request)[20:24]
    except OSError:
        return None
    return IPv4Interface(f"{socket.inet_ntoa(address)}/{socket.inet_ntoa(mask)}")


def local_interfaces(wanted: Sequence[str] | None) -> list[IPv4Interface]:
    """The interfaces to announce: those that `wanted` lists by name or address. If `wanted` is None, these
    are all interfaces except loopback, or only loopback if there is no other interface.

    Errors: NetworkError if an interface does not exist, or if there is no interface.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        found = {name: _interface(name, probe) for _, name in socket.if_nameindex()}
    present = {name: interface for name, interface in found.items() if interface is not None}
    if wanted is None:
        chosen = [i for i in present.values() if not i.ip.is_loopback] or list(present.values())
    else:
        by_word = {str(i.ip): i for i in present.values()} | present
        missing = [word for word in wanted if word not in by_word]
        if missing:
            raise NetworkError(
                f"no interface {missing[0]!r} with an IPv4 address; valid names: {sorted(by_word)}"
            )
        chosen = [by_word[word] for word in wanted]
    if not chosen:
        raise NetworkError("no interface has an IPv4 address")
    return chosen


def first_addresses(hosts: Sequence[str], ports: Ports) -> list[Address]:
    """Addresses for finding the first participants on hosts that multicast does not reach."""
    numbers = range(_PORTS_WITHOUT_MULTICAST)
    return [(host, ports.metatraffic(number)) for host in hosts for number in numbers]


def reachable(offered: list[Address], heard_from: str, ours: Sequence[IPv4Interface]) -> Address | None:
    """The address at which to answer a peer.

    The rules, in this order: the address from which the peer has sent, an address in a network of this
    computer, the first address. If the peer does not offer the address from which it has sent (same host,
    NAT), only the last two rules apply.
    """

    def rank(address: Address) -> int:
        if address[0] == heard_from:
            return 0
        host = IPv4Interface(address[0]).ip
        if any(host in interface.network for interface in ours):
            return 1
        return 3 if host.is_loopback else 2

    return min(offered, key=rank, default=None)
