"""Serial: serial ports of the computer that the service runs on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo import channel_methods as methods
from app.aubo.registry import service

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "Serial"
NAME = "serial_0"


@service(CLASS)
async def serial_open(
    robot: Services,
    device: str,
    baud: int = 115_200,
    stop_bits: float = 1.0,
    even: int = 0,
    serial_name: str = NAME,
) -> None:
    """Open a serial port with eight data bits. Until it is closed, no other client can open it.

    Args:
        device: path of the device, such as /dev/ttyUSB0.
        baud: bit rate, bit/s; 0 for 115200.
        stop_bits: number of stop bits, 1, 1.5 or 2; 0 for 1.
        even: parity: 0 none, 1 odd, 2 even.
        serial_name: name of the port in the other calls; empty for serial_0.
    """
    await robot.equipment.serial_ports.open(serial_name, device, baud, stop_bits, even)


@service(CLASS)
def serial_close(robot: Services, serial_name: str = NAME) -> None:
    """Close a serial port.

    Args:
        serial_name: name of the open port; empty for serial_0.
    """
    robot.equipment.serial_ports.close(serial_name)


methods.register(
    CLASS,
    "serial",
    NAME,
    lambda robot, name: robot.equipment.serial_ports.get(name),
    methods.EVERY_CHANNEL,
)
