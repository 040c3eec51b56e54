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
    """Give a value of a Modbus TCP device a name, and read it ten times a second from now on.

    A device that is not there, or goes away, is tried again: after 0.2 s, then at up to 5 s.

    Args:
        device_info: HOST, or HOST,PORT; the port is 502 without one. Serial Modbus (RTU) is not supported.
        slave_number: the unit, from 0 to 255.
        signal_address: from 0 to 65535.
        signal_type: 0 digital input, 1 digital output, 2 register input, 3 register output.
        signal_name: what the other calls name it by.
        sequential_mode: requests to a device always go one after the other, so this changes nothing.
    """
    if device_info.lstrip().lower().startswith(("rtu", "/dev")):
        raise NotSupportedError(f"device_info: {device_info!r}: only Modbus TCP is there, as HOST,PORT")
    robot.equipment.modbus.add(device_info, slave_number, signal_address, signal_type, signal_name)


@service(CLASS)
def modbus_delete_signal(robot: Services, signal_name: str) -> None:
    """Read a signal no more, and forget it.

    Args:
        signal_name: its name.
    """
    robot.equipment.modbus.remove(signal_name)


@service(CLASS)
def modbus_delete_all_signals(robot: Services) -> None:
    """Forget all signals."""
    robot.equipment.modbus.remove_all()


@service(CLASS)
def modbus_get_signal_status(robot: Services, signal_name: str) -> int:
    """What a signal was when it was read last. Fails when its device did not answer then.

    Args:
        signal_name: its name.

    Returns:
        0 or 1, or the register's value from 0 to 65535.
    """
    return robot.equipment.modbus.value(signal_name)


@service(CLASS)
def modbus_get_signal_names(robot: Services) -> list[str]:
    """The names of all signals.

    Returns:
        in the order in which they were added, as all lists of signals.
    """
    return [signal.name for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_types(robot: Services) -> list[int]:
    """The types of all signals.

    Returns:
        see modbusAddSignal.
    """
    return [int(signal.kind) for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_values(robot: Services) -> list[int]:
    """The values of all signals; whether they hold, modbusGetSignalErrors says.

    Returns:
        as they were read last.
    """
    return [signal.value for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_errors(robot: Services) -> list[int]:
    """Whether the signals' values hold.

    Returns:
        0 for those that do, 1 for the others.
    """
    return [int(signal.problem != "") for signal in robot.equipment.modbus.signals()]


@service(CLASS)
def modbus_get_signal_error(robot: Services, signal_name: str) -> str:
    """Why the value of a signal is not what its device has now.

    Args:
        signal_name: its name.

    Returns:
        empty when it is.
    """
    return robot.equipment.modbus.signal(signal_name).problem


@service(CLASS)
async def modbus_set_output_signal(robot: Services, signal_name: str, value: int) -> None:
    """Set a digital or register output; answers when the device has confirmed it.

    Args:
        signal_name: its name.
        value: 0 or 1, or from 0 to 65535.
    """
    await robot.equipment.modbus.write(signal_name, value)


@service(CLASS)
def modbus_set_signal_update_frequency(robot: Services, signal_name: str, update_frequency: float) -> None:
    """How often a signal is read; a slow device is read as often as it answers.

    Args:
        signal_name: its name.
        update_frequency: Hz, from 0.01 to 100.
    """
    robot.equipment.modbus.set_frequency(signal_name, update_frequency)
