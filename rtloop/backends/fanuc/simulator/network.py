"""A network between a simulated controller and its client that loses, delays and reorders packets."""

from __future__ import annotations

import math
from dataclasses import replace

from rtloop.backends.fanuc.codec import decode_received, encode_status
from rtloop.backends.fanuc.messages import StatusPacket
from rtloop.backends.simulators.network import Network


class FanucNetwork(Network):
    """A `Network` for the packets of Stream Motion."""

    _first: StatusPacket | None = None

    def spoil_packet(self, packet: bytes) -> bytes:
        found = decode_received(packet) if self.spoil else None
        if not isinstance(found, StatusPacket):
            self._first = None
            return packet
        first = self._first = self._first or found
        joints = (math.nan,) * len(first.joints) if self.spoil == "nan" else first.joints
        return encode_status(replace(found, joints=joints, currents=first.currents))
