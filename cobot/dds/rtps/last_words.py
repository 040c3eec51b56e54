"""What a participant leaves to its successor, should it be killed: who it was.

Others believe in a participant until its lease of many seconds is over: until then its services seem to be
there, and never answer. So whoever is started after it takes leave for it, before anything else.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Sequence
from contextlib import suppress

from cobot.dds.rtps.announcements import goodbye
from cobot.dds.rtps.network import DISCOVERY_GROUP, Ports, first_addresses
from cobot.dds.rtps.types import Address, Guid

_LONGEST = 65536


class LastWords:
    """A record in a file that outlives the process; `descriptor` is of that file, open for both."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def leave(
        self, participant: Guid, domain_id: int, interfaces: Sequence[str], hosts: Sequence[str]
    ) -> None:
        """Note who this is, in place of the one before.

        interfaces: addresses of those on which it multicasts.
        hosts: addresses of computers whose first participants are told one by one.
        """
        note = [participant.hex(), domain_id, list(interfaces), list(hosts)]
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps(note).encode(), 0)

    def speak(self) -> None:
        """Take leave for the one before, if there was one."""
        note = os.pread(self._descriptor, _LONGEST, 0)
        if not note:
            return
        participant, domain_id, interfaces, hosts = json.loads(note)
        datagram = goodbye(Guid(bytes.fromhex(participant)))
        ports = Ports(domain_id)
        group: Address = DISCOVERY_GROUP, ports.discovery
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for interface in interfaces:
                with suppress(OSError):  # it may be gone too
                    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
                    sender.sendto(datagram, group)
            for address in first_addresses(hosts, ports):
                with suppress(OSError):
                    sender.sendto(datagram, address)
