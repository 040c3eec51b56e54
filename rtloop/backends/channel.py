"""UDP communication between this computer and a robot controller."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from typing import Protocol

from rtloop.backends import BackendError

MAX_AT_ONCE = 256
"""Maximum number of packets that are read from the socket at once."""
RELEASE_S = 1.0
"""Time without packets after which packets from another port of the controller are accepted, because it may
have restarted, s.
"""


class PacketChannel(Protocol):
    """Interface for receiving a controller's packets and sending the answers.

    Attributes:
        strangers: number of packets that were ignored because they did not come from the controller's
            address.
    """

    strangers: int

    def receive(self, timeout_s: float) -> list[bytes]:
        """Wait for a packet, and return all packets that have arrived, oldest first. Return [] after
        `timeout_s`, or if all packets came from other addresses.
        """
        ...

    def send(self, packet: bytes) -> None:
        """Send a packet to the controller."""
        ...

    def close(self) -> None: ...


class UdpChannel:
    """A `PacketChannel` over the UDP socket that a controller sends to.

    The first sender of a valid packet is taken to be the controller. If `address` is given, the sender must
    have this address. From then on, packets from other addresses are ignored.
    """

    def __init__(
        self,
        listen: str,
        port: int,
        address: str | None,
        *,
        is_valid: Callable[[bytes], bool],
        max_packet: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the socket.

        Args:
            is_valid: function that returns whether a packet may come from a controller.
            max_packet: maximum size of a packet, in bytes. Longer packets are cut off after one more byte, so
                that they can be detected.

        Raises:
            BackendError: the port is taken, or the address does not belong to this computer.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._address, self._clock = address, clock
        self._is_valid, self._max_packet = is_valid, max_packet
        self._controller: tuple[str, int] | None = None
        self._heard_s = 0.0
        self.strangers = 0
        try:
            self._socket.bind((listen, port))
        except OSError as exc:
            self._socket.close()
            raise BackendError(f"cannot listen on UDP {listen}:{port}: {exc.strerror}") from exc
        self._socket.setblocking(False)

    def receive(self, timeout_s: float) -> list[bytes]:
        packets: list[bytes] = []
        # Not poll, whose timeout is in whole milliseconds, which may be longer than a period.
        if not select.select([self._socket], [], [], max(timeout_s, 0.0))[0]:
            return packets
        for _ in range(MAX_AT_ONCE):
            try:
                packet, sender = self._socket.recvfrom(self._max_packet + 1)
            except OSError:  # no more packets, or an error because an earlier answer went to a closed port
                break
            if self._counts(packet, sender):
                packets.append(packet)
            else:
                self.strangers += 1
        return packets

    def send(self, packet: bytes) -> None:
        if self._controller is None:
            return
        try:
            self._socket.sendto(packet, self._controller)
        except OSError as exc:
            raise BackendError(f"cannot answer {self._controller[0]}: {exc.strerror}") from exc

    def close(self) -> None:
        self._socket.close()

    def _counts(self, packet: bytes, sender: tuple[str, int]) -> bool:
        """Whether a packet is from the controller. Any sender is accepted while the controller is unknown."""
        now_s = self._clock()
        if sender != self._controller:
            if self._address not in (None, sender[0]):
                return False
            if self._controller is not None and now_s - self._heard_s < RELEASE_S:
                return False
            if not self._is_valid(packet):
                return self._controller is None  # the packet can be shown in a report
            self._controller, self._address = sender, sender[0]
        self._heard_s = now_s
        return True
