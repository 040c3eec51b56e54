"""RegisterControl: signals of Modbus TCP devices."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo.registry import service
from cobot.errors import NotSupportedError

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "RegisterControl"


@service(CLASS)
async def modbus_add_signal(
    robot: Services,
    device_info: str,
    slave_number: int,
    signal_address: int,
    signal_type: int,
    signal_name: str,
    sequential_mode: bool = False,
) -> None:
    """Define a named signal of a Modbus TCP device, and read it ten times a second from now on.

    If the device does not answer, cobot connects again after 0.2 s, then at intervals of up to 5 s.

    Args:
        device_info: HOST, or HOST,PORT; the default port is 502. Serial Modbus (RTU) is not supported.
        slave_number: number of the Modbus unit, from 0 to 255.
        signal_address: address of the value, from 0 to 65535.
        signal_type: 0 digital input, 1 digital output, 2 register input, 3 register output.
        signal_name: name of the signal in the other calls.
        sequential_mode: ignored; requests to a device are always sent one at a time.
    """
    if device_info.lstrip().lower().startswith(("rtu", "/dev")):
        raise NotSupportedError(
            f"device_info: {device_info!r}: only Modbus TCP is supported: give HOST or HOST,PORT"
        )
    robot.equipment.modbus.add(device_info, slave_number, signal_address, signal_type, signal_name)


@service(CLASS)
def modbus_delete_signal(robot: Services, signal_name: str) -> None:
    """Delete a signal, and stop reading it.

    Args:
        signal_name: name of the signal.
    """
    robot.equipment.modbus.remove(signal_name)


@service(CLASS)
def modbus_delete_all_signals(robot: Services) -> None:
    """Delete all signals."""
    robot.equipment.modbus.remove_all()


@service(CLASS)
def modbus_get_signal_status(robot: Services, signal_name: str) -> int:
    """The value of a signal when it was last read. Fails if the last reading failed.

    Args:
        signal_name: name of the signal.

    Returns:
        0 or 1, or the register's value from 0 to 65535.
    """
    return robot.equipment.modbus.value(signal_name)


@service(CLASS)
def modbus_get_signal_names(robot: Services) -> list[str]:
    """The names of all signals.

    Returns:
        the names, in the order they were added. All lists of signals have this order.
    """
    return [signal.name for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_types(robot: Services) -> list[int]:
    """The types of all signals.

    Returns:
        the types as numbers, see modbusAddSignal.
    """
    return [int(signal.kind) for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_values(robot: Services) -> list[int]:
    """The values of all signals. modbusGetSignalErrors reports whether they are current.

    Returns:
        the values that were last read.
    """
    return [signal.value for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_errors(robot: Services) -> list[int]:
    """Whether the values of the signals are current.

    Returns:
        0 for current values, 1 for others.
    """
    return [int(signal.problem != "") for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_error(robot: Services, signal_name: str) -> str:
    """The reason why the value of a signal is not current.

    Args:
        signal_name: name of the signal.

    Returns:
        the reason; empty if the value is current.
    """
    return robot.equipment.modbus.signal(signal_name).problem


@service(CLASS)
async def modbus_set_output_signal(robot: Services, signal_name: str, value: int) -> None:
    """Set a digital or register output. Returns when the device has confirmed it.

    Args:
        signal_name: name of the signal.
        value: 0 or 1 for a digital output, 0 to 65535 for a register.
    """
    await robot.equipment.modbus.write(signal_name, value)


@service(CLASS)
def modbus_set_signal_update_frequency(robot: Services, signal_name: str, update_frequency: float) -> None:
    """Set how often a signal is read. A slow device is read as often as it answers.

    Args:
        signal_name: name of the signal.
        update_frequency: frequency, Hz, from 0.01 to 100.
    """
    robot.equipment.modbus.set_frequency(signal_name, update_frequency)
