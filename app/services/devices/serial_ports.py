"""Serial ports."""

from __future__ import annotations

import asyncio
import os
import stat
from pathlib import Path
from typing import Any

import serial

from app.services.devices.channels import BUFFER_BYTES, TIMEOUT_S, Channel, Channels
from cobot.errors import DeviceError, DeviceTimeout, InputError

DEVICES = Path("/dev")
DRIVERS = Path("/proc/tty/drivers")
MAJORS = frozenset({4, 136, 166, 188, 204})
"""Major device numbers of ttyS, pts, ttyACM, ttyUSB and ttyAMA, for kernels that do not list their
drivers.
"""
CONSOLES = 64
"""Number of consoles under major number 4. The minor device numbers of serial ports begin after them."""
PARITIES = (serial.PARITY_NONE, serial.PARITY_ODD, serial.PARITY_EVEN)
STOP_BITS = (1.0, 1.5, 2.0)
OPEN_TIMEOUT_S = 5.0


class SerialPorts(Channels):
    """Open serial ports by name."""

    def __init__(self) -> None:
        super().__init__("serial port")

    async def open(self, name: str, device: str, baud: int, stop_bits: float, parity: int) -> None:
        """Open a port with eight data bits.

        Args:
            device: path, such as /dev/ttyUSB0.
            stop_bits: 1, 1.5 or 2.
            parity: 0 for none, 1 for odd, 2 for even.

        Raises:
            InputError, ConflictError: a value is invalid, or the name is taken.
            DeviceError: the device is not a serial port or cannot be opened; the error gives the system's
                reason.
        """
        if stop_bits not in STOP_BITS:
            raise InputError(f"stop_bits must be 1, 1.5 or 2, got {stop_bits:g}")
        if not 0 <= parity < len(PARITIES):
            raise InputError(f"even must be 0 (none), 1 (odd) or 2 (even), got {parity}")
        self.require_place(name)
        path = _device(device)
        try:
            port = await asyncio.wait_for(
                asyncio.to_thread(
                    serial.Serial,
                    str(path),
                    baud,
                    parity=PARITIES[parity],
                    stopbits=stop_bits,
                    timeout=0,
                    write_timeout=TIMEOUT_S,
                    exclusive=True,
                ),
                OPEN_TIMEOUT_S,
            )
        except TimeoutError as exc:
            raise DeviceTimeout(f"{device} cannot be opened") from exc
        except (OSError, ValueError) as exc:  # pyserial's errors are OSErrors
            raise DeviceError(f"{device}: {exc}") from exc
        self.add(name, _Port(port).channel(f"serial port {name} ({device})"))


class _Port(asyncio.ReadTransport):
    """Passes the bytes that a port receives to a StreamReader, but no more than the reader can hold."""

    def __init__(self, port: Any) -> None:
        super().__init__()
        self._port = port
        self._loop = asyncio.get_running_loop()
        self._reader = asyncio.StreamReader(BUFFER_BYTES, self._loop)
        self._reader.set_transport(self)
        self._open = True
        self.resume_reading()

    def channel(self, name: str) -> Channel:
        return Channel(name, self._reader, self._write, self.close)

    def pause_reading(self) -> None:
        self._loop.remove_reader(self._port.fileno())

    def resume_reading(self) -> None:
        if self._open:
            self._loop.add_reader(self._port.fileno(), self._receive)

    def close(self) -> None:
        if self._open:
            self._end()

    def _end(self) -> None:
        self._open = False
        self.pause_reading()
        self._reader.feed_eof()
        self._port.close()

    def _receive(self) -> None:
        try:
            data = os.read(self._port.fileno(), 4096)
        except OSError:  # the device was unplugged, or the program at the other end has ended
            data = b""
        if data:
            self._reader.feed_data(data)
        else:
            self._end()

    async def _write(self, data: bytes) -> None:
        if not self._open:
            raise OSError("the connection has ended")
        await asyncio.to_thread(self._port.write, data)


def _device(device: str) -> Path:
    """Return the file of a serial port, after checking it. The check does not open the file, because opening
    a FIFO waits for its other end, and opening some devices has side effects.
    """
    try:
        path = Path(device).resolve()
        about = path.stat() if path.is_relative_to(DEVICES) else None
    except (OSError, ValueError, RuntimeError) as exc:
        raise InputError(f"device: {device!r}: {exc}") from exc
    if about is None or not stat.S_ISCHR(about.st_mode):
        raise InputError(f"device: {device!r} is not a character device below {DEVICES}")
    if not _is_serial(os.major(about.st_rdev), os.minor(about.st_rdev)):
        raise DeviceError(f"{device}: is not a serial port")
    return path


def _is_serial(major: int, minor: int) -> bool:
    """Whether a device number belongs to a serial port or a pseudo terminal, according to the kernel."""
    try:
        lines = DRIVERS.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return major in MAJORS and not (major == 4 and minor < CONSOLES)
    for line in lines:  # NAME /dev/PREFIX MAJOR MINOR[-MINOR] TYPE
        fields = line.split()
        if len(fields) == 5 and fields[4] in ("serial", "pty:slave") and fields[2] == str(major):
            first, _, last = fields[3].partition("-")
            if int(first) <= minor <= int(last or first):
                return True
    return False
