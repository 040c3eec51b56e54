"""Modbus TCP: named signals of field devices, read again and again."""

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

from app.vendor.codes import Code, ServiceError
from cobot.errors import ConflictError, InputError, LimitError
from cobot.strict import shown

DEFAULT_PORT = 502
TIMEOUT_S = 1.0
FREQUENCY_HZ = 10.0
FREQUENCIES_HZ = (0.01, 100.0)
BACKOFF_S = (0.2, 5.0)
"""Between two attempts to connect: the first, and the longest; it doubles."""
MAX_SIGNALS = 200
MAX_NAME = 200
UNITS = (0, 255)
ADDRESS = REGISTER = 65_535

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
            ServiceError: the device is not there, does not answer, or refuses.
        """
        if not self._client.connected:
            raise ServiceError(Code.DEVICE, f"{self} is not connected: {signal.problem}")
        async with self._turn:
            problem = await self._request(signal, value)
        if problem:
            raise ServiceError(Code.DEVICE, f"{signal.name} at {self}: {problem}")
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


class Modbus:
    """All signals, by name; a device is connected to while it has signals."""

    def __init__(self) -> None:
        self._devices: dict[tuple[str, int], Device] = {}
        self._signals: dict[str, Signal] = {}

    def add(self, device: str, unit: int, address: int, kind: int, name: str) -> None:
        """Add a signal and begin to read it.

        Args:
            device: HOST, "HOST,PORT" or "HOST:PORT".
            kind: see `Kind`.

        Raises:
            InputError: wrong values, or a name that is taken.
            LimitError: too many signals.
        """
        host, port = _address(device)
        if not 1 <= len(name) <= MAX_NAME:
            raise InputError(f"a name has from 1 to {MAX_NAME} characters, got {shown(name)}")
        if name in self._signals:
            raise ConflictError(f"there is a signal {shown(name)} already")
        if not UNITS[0] <= unit <= UNITS[1]:
            raise InputError(f"slave_number must be from {UNITS[0]} to {UNITS[1]}, got {unit}")
        if not 0 <= address <= ADDRESS:
            raise InputError(f"signal_address must be from 0 to {ADDRESS}, got {address}")
        if kind not in list(Kind):
            valid = ", ".join(f"{each} {each.name.lower()}" for each in Kind)
            raise InputError(f"there is no signal_type {kind}; valid are: {valid}")
        if len(self._signals) >= MAX_SIGNALS:
            raise LimitError(f"there are {MAX_SIGNALS} signals already")
        signal = self._signals[name] = Signal(name, unit, address, Kind(kind))
        if (host, port) not in self._devices:
            self._devices[host, port] = Device(host, port)
        self._devices[host, port].add(signal)

    def remove(self, name: str) -> None:
        """Forget a signal.

        Raises:
            ServiceError: there is none.
        """
        signal = self.signal(name)
        device = self._device(signal)
        device.signals.remove(signal)
        del self._signals[name]
        if not device.signals:
            device.close()
            del self._devices[device.host, device.port]

    def remove_all(self) -> None:
        for device in self._devices.values():
            device.close()
        self._devices.clear()
        self._signals.clear()

    def signal(self, name: str) -> Signal:
        """One of them.

        Raises:
            ServiceError: there is none; lists those that are.
        """
        if name not in self._signals:
            there = ", ".join(self._signals) or "none"
            raise ServiceError(Code.NOT_FOUND, f"there is no signal {shown(name)}; there are: {shown(there)}")
        return self._signals[name]

    def signals(self) -> list[Signal]:
        """In the order in which they were added."""
        return list(self._signals.values())

    def value(self, name: str) -> int:
        """What the device has, as read last.

        Raises:
            ServiceError: there is no such signal, or its device does not answer, with why.
        """
        signal = self.signal(name)
        if signal.problem:
            raise ServiceError(Code.DEVICE, f"{name}: {signal.problem}")
        return signal.value

    async def write(self, name: str, value: int) -> None:
        """Set an output; returns when the device has confirmed it.

        Raises:
            InputError: an input, or a value that does not fit.
            ServiceError: no such signal; the device is not there, does not answer, or refuses.
        """
        signal = self.signal(name)
        match signal.kind:
            case Kind.DIGITAL_OUTPUT:
                largest = 1
            case Kind.REGISTER_OUTPUT:
                largest = REGISTER
            case _:
                raise InputError(f"{name} is a {signal.kind.name.lower()}, which nobody can set")
        if not 0 <= value <= largest:
            raise LimitError(f"{name} takes from 0 to {largest}, got {value}")
        await self._device(signal).write(signal, value)

    def set_frequency(self, name: str, frequency_hz: float) -> None:
        """How often a signal is read; as often as the device answers, at the most.

        Raises:
            LimitError: out of bounds.
        """
        signal = self.signal(name)
        least, most = FREQUENCIES_HZ
        if not least <= frequency_hz <= most:
            raise LimitError(f"the frequency is from {least} to {most:g} Hz, got {frequency_hz:g}")
        signal.period_s, signal.due_s = 1.0 / frequency_hz, 0.0
        self._device(signal).hurry()

    def _device(self, signal: Signal) -> Device:
        return next(device for device in self._devices.values() if signal in device.signals)


def _address(device: str) -> tuple[str, int]:
    host, _, port = device.replace(",", ":").strip().partition(":")
    number = port.strip() or str(DEFAULT_PORT)
    if not host.strip() or not (number.isascii() and number.isdecimal() and 1 <= int(number) <= 65535):
        raise InputError(f"device_info must be HOST, or HOST,PORT, got {shown(device)}")
    return host.strip(), int(number)
