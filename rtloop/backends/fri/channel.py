"""UDP between this computer and a robot controller."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from typing import Protocol

from rtloop.backends import BackendError
from rtloop.backends.fri.codec import MAX_PACKET, decode_monitoring

MAX_AT_ONCE = 256
"""Packets that are taken from the socket in one go."""
RELEASE_S = 1.0
"""A controller that has been silent for so long may have been started anew, and send from another port."""


class Channel(Protocol):
    """Where packets come from and answers go.

    Attributes:
        strangers: packets of others than the controller, which do not count.
    """

    strangers: int

    def receive(self, timeout_s: float) -> list[bytes]:
        """All that has piled up, the oldest first; waits for one, and gives [] after `timeout_s`, or where
        only others have sent something.
        """
        ...

    def send(self, packet: bytes) -> None:
        """To the controller."""
        ...

    def close(self) -> None: ...


class UdpChannel:
    """A `Channel`: the socket that a controller sends to.

    The controller is whoever sends FRI first, from `address` if there is one. From then on nobody else is
    heard or answered.
    """

    def __init__(
        self, listen: str, port: int, address: str | None, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """
        Raises:
            BackendError: the port is taken, or the address is not of this computer.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._address, self._clock = address, clock
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
        # Not poll, whose whole milliseconds are longer than a period.
        if not select.select([self._socket], [], [], max(timeout_s, 0.0))[0]:
            return packets
        for _ in range(MAX_AT_ONCE):
            try:
                packet, sender = self._socket.recvfrom(MAX_PACKET + 1)
            except OSError:  # no more, or what an answer to nobody has left behind
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
        """Whether it is the controller's, or may be, as long as there is none."""
        now_s = self._clock()
        if sender != self._controller:
            if self._address not in (None, sender[0]):
                return False
            if self._controller is not None and now_s - self._heard_s < RELEASE_S:
                return False
            if isinstance(decode_monitoring(packet), str):
                return self._controller is None  # it is said that this has come
            self._controller, self._address = sender, sender[0]
        self._heard_s = now_s
        return True
