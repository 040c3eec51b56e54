"""A record of a participant for its successor, in case the participant is killed.

Other participants keep a killed participant until its lease ends, after many seconds. Until then its services
appear to exist but never answer. So its successor first announces the end of the killed participant.
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

_MAX_BYTES = 65536


class ParticipantRecord:
    """A record in a file that outlives the process. `descriptor` refers to that file, open for reading and
    writing.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def write(
        self, participant: Guid, domain_id: int, interfaces: Sequence[str], hosts: Sequence[str]
    ) -> None:
        """Record this participant, replacing its predecessor's record.

        interfaces: addresses of the interfaces on which the participant sends multicast.
        hosts: addresses of computers whose first participants are notified by unicast.
        """
        note = [participant.hex(), domain_id, list(interfaces), list(hosts)]
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, json.dumps(note).encode(), 0)

    def announce_end(self) -> None:
        """Announce the end of the predecessor, if there was one."""
        note = os.pread(self._descriptor, _MAX_BYTES, 0)
        if not note:
            return
        participant, domain_id, interfaces, hosts = json.loads(note)
        datagram = goodbye(Guid(bytes.fromhex(participant)))
        ports = Ports(domain_id)
        group: Address = DISCOVERY_GROUP, ports.discovery
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for interface in interfaces:
                with suppress(OSError):  # the interface may no longer exist
                    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
                    sender.sendto(datagram, group)
            for address in first_addresses(hosts, ports):
                with suppress(OSError):
                    sender.sendto(datagram, address)
