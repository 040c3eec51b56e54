"""Socket: the service's TCP connections to devices."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo import channel_methods as methods
from app.aubo.registry import service
from app.services.devices.channels import TIMEOUT_S, Channel
from cobot.errors import DeviceError, InputError
from cobot.strict import shown

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "Socket"
NAME = "socket_0"


@service(CLASS)
async def socket_open(
    robot: Services, address: str, port: int, socket_name: str = NAME, timeout: float = TIMEOUT_S
) -> None:
    """Connect to a TCP server.

    Args:
        address: host name or IP address of the server.
        port: TCP port, from 1 to 65535.
        socket_name: name of the connection in the other calls; empty for socket_0.
        timeout: timeout, s, up to 60; 0 for 2 s.
    """
    await robot.equipment.sockets.open(socket_name, address, port, timeout)


@service(CLASS)
def socket_close(robot: Services, socket_name: str = NAME) -> None:
    """End a connection.

    Args:
        socket_name: name of the open connection; empty for socket_0.
    """
    robot.equipment.sockets.close(socket_name)


async def get_var(channel: Channel, name: str, timeout: float = TIMEOUT_S) -> int:
    """Ask the server for a variable: sends "GET name" and reads the line "name value".

    Args:
        name: variable name.
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        its value.
    """
    await channel.send(f"GET {_word(name)}\n".encode())
    line = (await channel.read_line(timeout)).decode("utf-8", "replace")
    found, _, value = line.partition(" ")
    try:
        if found == name and -(2**31) <= int(value) < 2**31:
            return int(value)
    except ValueError:
        pass  # the message below reports this
    raise DeviceError(f"{channel.name}: received {shown(line)} as the answer to GET {name}")


async def set_var(channel: Channel, name: str, value: int) -> None:
    """Set a variable of the server: sends "SET name value".

    Args:
        name: variable name.
        value: new value, an integer.
    """
    await channel.send(f"SET {_word(name)} {value}\n".encode())


def _word(name: str) -> str:
    if not name or name.split() != [name]:
        raise InputError(f"name must be one word, got {shown(name)}")
    return name


methods.register(
    CLASS,
    "socket",
    NAME,
    lambda robot, name: robot.equipment.sockets.get(name),
    (
        *methods.EVERY_CHANNEL,
        methods.read_binary_integer,
        methods.read_ascii_float,
        get_var,
        set_var,
    ),
)
