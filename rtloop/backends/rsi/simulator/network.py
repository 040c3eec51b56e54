"""A network with faults between a simulated controller and its client."""

from __future__ import annotations

import math
from dataclasses import replace

from rtloop.backends.rsi.telegrams import RobState, TelegramLayout, decode_rob, encode_rob
from rtloop.backends.simulators.network import Network


class RsiNetwork(Network):
    """A `Network` that can corrupt the measured positions."""

    def __init__(
        self, layout: TelegramLayout, seed: int = 0, loss: float = 0.0, reorder: float = 0.0, delay: int = 0
    ) -> None:
        super().__init__(seed, loss, reorder, delay)
        self._layout = layout
        self._first: RobState | None = None

    def spoil_packet(self, packet: bytes) -> bytes:
        state = decode_rob(packet, self._layout) if self.spoil else None
        if not isinstance(state, RobState):
            self._first = None
            return packet
        first = self._first = self._first or state
        position = first.position
        if self.spoil == "nan":
            position = (math.nan,) * len(position)
        return encode_rob(self._layout, replace(state, position=position, pose=first.pose))
