"""TCP connections to devices."""

from __future__ import annotations

import asyncio

from app.services.devices.channels import BUFFER_BYTES, TIMEOUT_S, Channel, Channels, checked_timeout
from cobot.errors import DeviceError, DeviceTimeout, InputError


class Sockets(Channels):
    """Open connections by name. The service is the client."""

    def __init__(self) -> None:
        super().__init__("socket")

    async def open(self, name: str, host: str, port: int, timeout_s: float = TIMEOUT_S) -> None:
        """Connect to a TCP server.

        Raises:
            InputError, ConflictError: the port or the name is invalid, or the name is taken.
            DeviceError: the server does not answer; the error gives the system's reason.
        """
        if not 1 <= port <= 65535:
            raise InputError(f"port must be from 1 to 65535, got {port}")
        checked_timeout(timeout_s)
        self.require_place(name)
        where = f"{host}:{port}"
        try:
            reader, writer = await asyncio.wait_for(
                asyncio.open_connection(host, port, limit=BUFFER_BYTES), timeout_s
            )
        except TimeoutError as exc:
            raise DeviceTimeout(f"{where} has not answered within {timeout_s:g} s") from exc
        except (OSError, UnicodeError) as exc:  # a host name with invalid letters
            raise DeviceError(f"{where}: {exc}") from exc

        async def write(data: bytes) -> None:
            # wait until the data of earlier calls has been sent; otherwise it would accumulate
            await writer.drain()
            writer.write(data)
            await writer.drain()

        writer.transport.set_write_buffer_limits(high=BUFFER_BYTES)
        self.add(name, Channel(f"socket {name} ({where})", reader, write, writer.close))
