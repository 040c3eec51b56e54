"""One Modbus TCP device: its connection, and its signals, which it is asked for again and again."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from dataclasses import dataclass
from enum import IntEnum

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from cobot.errors import DeviceError

TIMEOUT_S = 1.0
FREQUENCY_HZ = 10.0
BACKOFF_S = (0.2, 5.0)
"""The first pause between two attempts to connect and the longest one, s; each is twice the one before."""

log = logging.getLogger("cobot.modbus")
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
"""It writes each frame of a device that errs, ten times a second; the signals' problems say enough."""


class Kind(IntEnum):
    """Of a signal; the numbers are the manual's."""

    DIGITAL_INPUT = 0  # discrete input
    DIGITAL_OUTPUT = 1  # coil
    REGISTER_INPUT = 2
    REGISTER_OUTPUT = 3  # holding register


@dataclass(slots=True)
class Signal:
    """One value of a device.

    Attributes:
        value: as read last.
        problem: why the value is not what the device has now; "" when it is.
        due_s: when it is read next, in the event loop's time.
    """

    name: str
    unit: int
    address: int
    kind: Kind
    period_s: float = 1.0 / FREQUENCY_HZ
    value: int = 0
    problem: str = "it has not been read yet"
    due_s: float = 0.0


class Device:
    """A connection and the task that reads its signals one after the other, one request at a time."""

    def __init__(self, host: str, port: int) -> None:
        self.host = host
        self.port = port
        self.signals: list[Signal] = []
        self._client = AsyncModbusTcpClient(host, port=port, timeout=TIMEOUT_S, retries=0, reconnect_delay=0)
        self._turn = asyncio.Lock()
        self._more = asyncio.Event()
        self._task = asyncio.create_task(self._run(), name=f"modbus {self}")

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"

    def add(self, signal: Signal) -> None:
        self.signals.append(signal)
        self.hurry()

    def hurry(self) -> None:
        """Something has changed: look what is due."""
        self._more.set()

    def close(self) -> None:
        self._task.cancel()
        self._client.close()

    async def write(self, signal: Signal, value: int) -> None:
        """Set an output.

        Raises:
            DeviceError: the device is not there, does not answer, or refuses.
        """
        if not self._client.connected:
            raise DeviceError(f"{self} is not connected: {signal.problem}")
        async with self._turn:
            problem = await self._request(signal, value)
        if problem:
            raise DeviceError(f"{signal.name} at {self}: {problem}")
        signal.due_s = 0.0
        self.hurry()

    async def _run(self) -> None:
        delay_s, longest_s = BACKOFF_S
        while True:
            if not self._client.connected:
                if not await self._connected():
                    await asyncio.sleep(delay_s)
                    delay_s = min(2.0 * delay_s, longest_s)
                    continue
                log.info("modbus %s: connected", self)
            delay_s = BACKOFF_S[0]
            await self._read_due()

    async def _connected(self) -> bool:
        problem = "refused or not reachable"
        try:
            if await self._client.connect():
                return True
        except (OSError, ModbusException, UnicodeError) as exc:  # a host name of strange letters
            problem = str(exc)
        for signal in self.signals:
            signal.problem = f"{self} is not connected: {problem}"
        return False

    async def _read_due(self) -> None:
        """Read what is due, then wait until something is."""
        loop = asyncio.get_running_loop()
        for signal in sorted(self.signals, key=lambda each: each.due_s):
            if signal.due_s > loop.time():
                break
            async with self._turn:
                signal.problem = await self._request(signal)
            signal.due_s = loop.time() + signal.period_s
            if not self._client.connected:
                return
        next_s = min((signal.due_s for signal in self.signals), default=loop.time() + 1.0)
        self._more.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._more.wait(), max(0.0, next_s - loop.time()))

    async def _request(self, signal: Signal, value: int | None = None) -> str:
        """Read a signal, or write it; what went wrong, or ""."""
        client, where, unit = self._client, signal.address, signal.unit
        try:
            match signal.kind, value:
                case Kind.DIGITAL_INPUT, None:
                    answer = await client.read_discrete_inputs(where, device_id=unit)
                case Kind.DIGITAL_OUTPUT, None:
                    answer = await client.read_coils(where, device_id=unit)
                case Kind.REGISTER_INPUT, None:
                    answer = await client.read_input_registers(where, device_id=unit)
                case Kind.REGISTER_OUTPUT, None:
                    answer = await client.read_holding_registers(where, device_id=unit)
                case Kind.DIGITAL_OUTPUT, int():
                    answer = await client.write_coil(where, bool(value), device_id=unit)
                case _, int():
                    answer = await client.write_register(where, value, device_id=unit)
        except ModbusException:
            self._client.close()  # an answer that comes late after all must not be taken for the next one's
            return f"unit {unit} has not answered within {TIMEOUT_S:g} s"
        except OSError as exc:
            self._client.close()
            return str(exc)
        return _outcome(signal, answer, value)


def _outcome(signal: Signal, answer: ModbusPDU, written: int | None) -> str:
    if answer.isError():
        code = answer.exception_code
        known = ExcCodes(code).name.lower().replace("_", " ") if code in list(ExcCodes) else "unknown"
        return f"unit {signal.unit} refuses address {signal.address}: {known} (exception {code})"
    if written is not None:
        return ""
    values = answer.bits if signal.kind in (Kind.DIGITAL_INPUT, Kind.DIGITAL_OUTPUT) else answer.registers
    if not values:  # pymodbus takes the answer to another question too
        return f"unit {signal.unit} has answered something else than was asked"
    signal.value = int(values[0])
    return ""
