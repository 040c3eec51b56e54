"""One Modbus TCP device: its connection, and its signals, which are read repeatedly."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from dataclasses import dataclass
from enum import IntEnum

from app.services.devices.modbus_tcp import TIMEOUT_S, ModbusConnection
from cobot.errors import DeviceError
from cobot.modbus import ModbusFunction

FREQUENCY_HZ = 10.0
BACKOFF_S = (0.2, 5.0)
"""The first and the longest pause between two attempts to connect, s. Each pause is twice the previous
one.
"""

log = logging.getLogger("cobot.modbus")


class SignalKind(IntEnum):
    """Kind of a signal. The manual defines the numbers."""

    DIGITAL_INPUT = 0  # discrete input
    DIGITAL_OUTPUT = 1  # coil
    REGISTER_INPUT = 2
    REGISTER_OUTPUT = 3  # holding register


READS = {
    SignalKind.DIGITAL_INPUT: ModbusFunction.READ_DISCRETE_INPUTS,
    SignalKind.DIGITAL_OUTPUT: ModbusFunction.READ_COILS,
    SignalKind.REGISTER_INPUT: ModbusFunction.READ_INPUT_REGISTERS,
    SignalKind.REGISTER_OUTPUT: ModbusFunction.READ_HOLDING_REGISTERS,
}
WRITES = {
    SignalKind.DIGITAL_OUTPUT: ModbusFunction.WRITE_COIL,
    SignalKind.REGISTER_OUTPUT: ModbusFunction.WRITE_REGISTER,
}


@dataclass(slots=True)
class Signal:
    """One value in a device.

    Attributes:
        value: the last value that was read.
        problem: reason why the value is not current; "" if it is current.
        due_s: time of the next reading, on the event loop's clock.
    """

    name: str
    unit: int
    address: int
    kind: SignalKind
    period_s: float = 1.0 / FREQUENCY_HZ
    value: int = 0
    problem: str = "the signal has not been read yet"
    due_s: float = 0.0


class ModbusDevice:
    """A connection to a device, and the task that reads the device's signals, one request at a time."""

    def __init__(self, host: str, port: int) -> None:
        self.host = host
        self.port = port
        self.signals: list[Signal] = []
        self._client = ModbusConnection(host, port)
        self._turn = asyncio.Lock()
        self._more = asyncio.Event()
        self._task = asyncio.create_task(self._run(), name=f"modbus {self}")

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"

    def add(self, signal: Signal) -> None:
        self.signals.append(signal)
        self.read_soon()

    def read_soon(self) -> None:
        """Wake the reading task, because a signal was added or its frequency has changed."""
        self._more.set()

    def close(self) -> None:
        self._task.cancel()
        self._client.close()

    async def write(self, signal: Signal, value: int) -> None:
        """Set an output.

        Raises:
            DeviceError: the device is not connected, does not answer, or rejects the value.
        """
        if not self._client.connected:
            raise DeviceError(f"{self} is not connected: {signal.problem}")
        async with self._turn:
            try:
                await self._client.write(signal.unit, WRITES[signal.kind], signal.address, value)
            except DeviceError as exc:
                raise DeviceError(f"{signal.name} at {self}: {exc}") from exc
        signal.due_s = 0.0
        self.read_soon()

    async def _run(self) -> None:
        delay_s, longest_s = BACKOFF_S
        told = False
        while True:
            if not self._client.connected:
                if not await self._connect():
                    told = False
                    await asyncio.sleep(delay_s)
                    delay_s = min(2.0 * delay_s, longest_s)
                    continue
                if not told:  # logged only once, because a device may close its connections repeatedly
                    log.info("modbus %s: connected", self)
                told = True
            delay_s = BACKOFF_S[0]
            await self._read_due()

    async def _connect(self) -> bool:
        try:
            await self._client.connect()
            return True
        except TimeoutError:
            problem = f"no answer within {TIMEOUT_S:g} s"
        except (OSError, ValueError) as exc:  # a host name with invalid letters
            problem = str(exc)
        for signal in self.signals:
            signal.problem = f"{self} is not connected: {problem}"
        return False

    async def _read_due(self) -> None:
        """Read the signals that are due, then wait until the next one is."""
        loop = asyncio.get_running_loop()
        for signal in sorted(self.signals, key=lambda each: each.due_s):
            if signal.due_s > loop.time():
                break
            async with self._turn:
                signal.problem = await self._read(signal)
            signal.due_s = loop.time() + signal.period_s
            if not self._client.connected:
                return
        next_s = min((signal.due_s for signal in self.signals), default=loop.time() + 1.0)
        self._more.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._more.wait(), max(0.0, next_s - loop.time()))

    async def _read(self, signal: Signal) -> str:
        """Read a signal. Return the problem; "" after success."""
        try:
            signal.value = await self._client.read(signal.unit, READS[signal.kind], signal.address)
        except DeviceError as exc:
            return str(exc)
        return ""
