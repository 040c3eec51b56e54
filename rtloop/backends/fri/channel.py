"""The socket that an FRI controller sends to."""

from __future__ import annotations

import time
from collections.abc import Callable

from rtloop.backends.channel import UdpChannel
from rtloop.backends.fri.codec import MAX_PACKET, decode_monitoring


def fri_channel(
    listen: str, port: int, address: str | None, *, clock: Callable[[], float] = time.monotonic
) -> UdpChannel:
    """Open the UDP channel to an FRI controller. A packet is valid if it is a monitoring message.

    Raises:
        BackendError: the port is taken, or the address does not belong to this computer.
    """
    return UdpChannel(
        listen,
        port,
        address,
        is_valid=lambda packet: not isinstance(decode_monitoring(packet), str),
        max_packet=MAX_PACKET,
        clock=clock,
    )
