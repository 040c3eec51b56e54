"""A network that loses, delays and reorders packets. Its times are in periods, and the same seed causes the
same faults.
"""

from __future__ import annotations

from collections import deque
from random import Random

MAX_DELAY = 100
"""Maximum delay of answers, in periods."""


class Network:
    """A network between a controller and its client, in both directions.

    Attributes:
        loss, reorder: share of the packets that are lost, and share of those that arrive one period after
            their successor.
        delay: delay of each answer, in periods.
        drop: number of the next packets to the client that are lost.
        lost: number of lost packets in both directions.
        spoil: corruption of the measured values on their way to the client: "frozen": the values do not
            change; "nan": they are not numbers; "": none.
    """

    def __init__(self, seed: int = 0, loss: float = 0.0, reorder: float = 0.0, delay: int = 0) -> None:
        self.loss, self.reorder, self.delay = loss, reorder, delay
        self.drop = self.lost = 0
        self.spoil = ""
        self._random = Random(seed)
        self._out: deque[tuple[int, bytes]] = deque()
        self._back: deque[tuple[int, bytes]] = deque()
        self._period = 0

    def to_client(self, packet: bytes) -> list[bytes]:
        """Begin a period and send a packet to the client. Returns the packets that reach the client in this
        period, which can include earlier ones.
        """
        self._period += 1
        if packet:
            if self.drop > 0:
                self.drop -= 1
                self.lost += 1
            else:
                self._send(self._out, packet, 0)
        return self._take_due(self._out)

    def spoil_packet(self, packet: bytes) -> bytes:
        """Return the packet as it arrives at the client. Each protocol corrupts it in its own way."""
        return packet

    def from_client(self, packet: bytes) -> list[bytes]:
        """Send a packet from the client. Return the packets that arrive at the controller."""
        self._send(self._back, packet, self.delay)
        return self._take_due(self._back)

    def arrived(self) -> list[bytes]:
        """Return the earlier packets that arrive at the controller at the beginning of a period."""
        return self._take_due(self._back)

    def _send(self, way: deque[tuple[int, bytes]], packet: bytes, delay: int) -> None:
        if self.loss and self._random.random() < self.loss:
            self.lost += 1
            return
        later = 1 if self.reorder and self._random.random() < self.reorder else 0
        way.append((self._period + delay + later, packet))

    def _take_due(self, way: deque[tuple[int, bytes]]) -> list[bytes]:
        """Remove and return the packets that are due. Overtaken packets come last."""
        due = [entry for entry in way if entry[0] <= self._period]
        if due:
            left = [entry for entry in way if entry[0] > self._period]
            way.clear()
            way.extend(left)
        due.reverse()
        return [packet for _, packet in due]
