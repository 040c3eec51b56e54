"""UDP between this computer and a robot controller."""

from __future__ import annotations

import select
import socket
from typing import Protocol

from rtloop.backends import BackendError
from rtloop.backends.fri.codec import MAX_BYTES

MOST_AT_ONCE = 256
"""Packets that are taken from the socket in one go."""


class Channel(Protocol):
    """Where packets come from and answers go."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """All that has piled up, the oldest first; waits for one, and gives [] after `timeout_s`."""
        ...

    def send(self, packet: bytes) -> None:
        """To whom the last packet came from."""
        ...

    def keep_to_sender(self) -> None:
        """From now on packets of others do not count."""
        ...

    def close(self) -> None: ...


class UdpChannel:
    """A `Channel`: the socket that a controller sends to."""

    def __init__(self, listen: str, port: int, address: str | None) -> None:
        """
        Raises:
            BackendError: the port is taken, or the address is not of this computer.
        """
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._address = address
        self._sender: tuple[str, int] | None = None
        try:
            self._socket.bind((listen, port))
        except OSError as exc:
            self._socket.close()
            raise BackendError(f"cannot listen on UDP {listen}:{port}: {exc.strerror}") from exc
        self._socket.setblocking(False)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def receive(self, timeout_s: float) -> list[bytes]:
        packets: list[bytes] = []
        if not self._poll.poll(max(timeout_s, 0.0) * 1e3):
            return packets
        for _ in range(MOST_AT_ONCE):
            try:
                packet, sender = self._socket.recvfrom(MAX_BYTES + 1)
            except OSError:  # no more, or what an answer to nobody has left behind
                break
            if self._address is None or sender[0] == self._address:
                packets.append(packet)
                self._sender = sender
        return packets

    def send(self, packet: bytes) -> None:
        if self._sender is None:
            return
        try:
            self._socket.sendto(packet, self._sender)
        except OSError as exc:
            raise BackendError(f"cannot answer {self._sender[0]}: {exc.strerror}") from exc

    def keep_to_sender(self) -> None:
        if self._sender is not None:
            self._address = self._sender[0]

    def close(self) -> None:
        self._socket.close()
