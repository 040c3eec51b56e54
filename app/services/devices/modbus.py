"""Named signals of field devices, over Modbus TCP."""

from __future__ import annotations

from app.services.devices.modbus_device import ModbusDevice, Signal, SignalKind
from cobot.errors import ConflictError, DeviceError, InputError, LimitError, NotFoundError
from cobot.strict import shown

DEFAULT_PORT = 502
FREQUENCIES_HZ = (0.01, 100.0)
MAX_SIGNALS = 200
MAX_NAME = 200
UNITS = (0, 255)
ADDRESS = REGISTER = 65_535


class Modbus:
    """All signals by name. The connection to a device is open as long as it has signals."""

    def __init__(self) -> None:
        self._devices: dict[tuple[str, int], ModbusDevice] = {}
        self._signals: dict[str, Signal] = {}

    def add(self, device: str, unit: int, address: int, kind: int, name: str) -> None:
        """Add a signal and begin to read it.

        Args:
            device: HOST, "HOST,PORT" or "HOST:PORT".
            kind: see `SignalKind`.

        Raises:
            InputError: a value is invalid, or the name is taken.
            LimitError: there are too many signals.
        """
        host, port = _address(device)
        if not 1 <= len(name) <= MAX_NAME:
            raise InputError(f"a name must be 1 to {MAX_NAME} characters long, got {shown(name)}")
        if name in self._signals:
            raise ConflictError(f"the signal {shown(name)} already exists")
        if not UNITS[0] <= unit <= UNITS[1]:
            raise InputError(f"slave_number must be from {UNITS[0]} to {UNITS[1]}, got {unit}")
        if not 0 <= address <= ADDRESS:
            raise InputError(f"signal_address must be from 0 to {ADDRESS}, got {address}")
        if kind not in list(SignalKind):
            valid = ", ".join(f"{each} {each.name.lower()}" for each in SignalKind)
            raise InputError(f"signal_type is {kind}; valid values: {valid}")
        if len(self._signals) >= MAX_SIGNALS:
            raise LimitError(f"there are already {MAX_SIGNALS} signals, which is the maximum")
        signal = self._signals[name] = Signal(name, unit, address, SignalKind(kind))
        if (host, port) not in self._devices:
            self._devices[host, port] = ModbusDevice(host, port)
        self._devices[host, port].add(signal)

    def remove(self, name: str) -> None:
        """Delete a signal.

        Raises:
            NotFoundError: there is no such signal.
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
        """Return the signal with this name.

        Raises:
            NotFoundError: there is no such signal; the error lists the existing ones.
        """
        if name not in self._signals:
            there = ", ".join(self._signals) or "none"
            raise NotFoundError(f"there is no signal {shown(name)}; valid names: {shown(there)}")
        return self._signals[name]

    def signals(self) -> list[Signal]:
        """List the signals, in the order they were added."""
        return list(self._signals.values())

    def value(self, name: str) -> int:
        """Return the value that was last read from the device.

        Raises:
            NotFoundError: there is no such signal, or its device does not answer; the error gives the reason.
        """
        signal = self.signal(name)
        if signal.problem:
            raise DeviceError(f"{name}: {signal.problem}")
        return signal.value

    async def write(self, name: str, value: int) -> None:
        """Set an output. Returns when the device has confirmed it.

        Raises:
            InputError: the signal is an input, or the value is out of range.
            DeviceError: there is no such signal, or the device is not connected, does not answer, or rejects
                the value.
        """
        signal = self.signal(name)
        match signal.kind:
            case SignalKind.DIGITAL_OUTPUT:
                largest = 1
            case SignalKind.REGISTER_OUTPUT:
                largest = REGISTER
            case _:
                raise InputError(f"{name} is a {signal.kind.name.lower()}, which is read-only")
        if not 0 <= value <= largest:
            raise LimitError(f"{name} must be from 0 to {largest}, got {value}")
        await self._device(signal).write(signal, value)

    def set_frequency(self, name: str, frequency_hz: float) -> None:
        """Set how often a signal is read. The device may answer less often.

        Raises:
            LimitError: the frequency is out of bounds.
        """
        signal = self.signal(name)
        least, most = FREQUENCIES_HZ
        if not least <= frequency_hz <= most:
            raise LimitError(f"the frequency must be from {least} to {most:g} Hz, got {frequency_hz:g}")
        signal.period_s, signal.due_s = 1.0 / frequency_hz, 0.0
        self._device(signal).read_soon()

    def _device(self, signal: Signal) -> ModbusDevice:
        return next(device for device in self._devices.values() if signal in device.signals)


def _address(device: str) -> tuple[str, int]:
    host, _, port = device.replace(",", ":").strip().partition(":")
    number = port.strip() or str(DEFAULT_PORT)
    if not host.strip() or not (number.isascii() and number.isdecimal() and 1 <= int(number) <= 65535):
        raise InputError(f"device_info must be HOST, or HOST,PORT, got {shown(device)}")
    return host.strip(), int(number)
