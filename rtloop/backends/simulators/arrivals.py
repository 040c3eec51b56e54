"""Arrival times of UDP packets."""

from __future__ import annotations

import socket
import struct
import sys
import time

_STAMP = 35
"""Linux's socket option SO_TIMESTAMPNS. It provides the time when a packet arrived, regardless of when this
process reads it.
"""
_TIMESPEC = struct.Struct("qq")


def request_arrival_times(receiver: socket.socket) -> None:
    """Make the kernel record the arrival time of each packet."""
    if sys.platform == "linux":
        receiver.setsockopt(socket.SOL_SOCKET, _STAMP, 1)


def receive(receiver: socket.socket, max_packet: int) -> tuple[bytes, tuple[str, int], float]:
    """Return the next packet, its sender, and its arrival time on the monotonic clock, s.

    Raises:
        OSError: there is no packet, or an earlier packet was sent to a closed port.
    """
    room = socket.CMSG_SPACE(_TIMESPEC.size) if sys.platform == "linux" else 0
    packet, more, _, sender = receiver.recvmsg(max_packet, room)
    arrived_s = time.monotonic()
    for _, kind, content in more:
        if kind == _STAMP:
            seconds, nanoseconds = _TIMESPEC.unpack_from(content)
            arrived_s -= max(0.0, 1e-9 * (time.time_ns() - 1_000_000_000 * seconds - nanoseconds))
    return packet, sender, arrived_s
