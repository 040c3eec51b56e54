"""The network of a simulated FRI cabinet, which can also corrupt the measured values."""

from __future__ import annotations

import math
from dataclasses import replace

from rtloop.backends.fri.codec import decode_monitoring
from rtloop.backends.fri.encoding import encode_monitoring
from rtloop.backends.fri.messages import MonitoringMessage
from rtloop.backends.simulators.network import Network


class FriNetwork(Network):
    """A `Network` for FRI packets."""

    def __init__(self, seed: int = 0, loss: float = 0.0, reorder: float = 0.0, delay: int = 0) -> None:
        super().__init__(seed, loss, reorder, delay)
        self._known: MonitoringMessage | None = None

    def spoil_packet(self, packet: bytes) -> bytes:
        """Return the packet with its measured values changed as `spoil` requires."""
        message = decode_monitoring(packet) if self.spoil else None
        if not isinstance(message, MonitoringMessage):
            self._known = None
            return packet
        known = self._known = self._known or message
        position = known.measured_position
        return encode_monitoring(
            replace(
                message,
                measured_position=(math.nan,) * len(position) if self.spoil == "nan" else position,
                measured_torque=known.measured_torque,
                commanded_torque=known.commanded_torque,
                external_torque=known.external_torque,
            )
        )
