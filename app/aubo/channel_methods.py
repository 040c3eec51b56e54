"""Services that send to and read from a device, the same for sockets and serial ports."""

from __future__ import annotations

import inspect
import re
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from app.aubo.registry import camel_case, service
from app.services.devices.channels import TIMEOUT_S, Channel
from cobot.errors import DeviceError, InputError
from cobot.strict import shown

if TYPE_CHECKING:
    from app.robot_services import Services

INTEGER = struct.Struct(">i")
BYTE = 255
MAX_NUMBERS = 1000


async def send_string(channel: Channel, value: str) -> None:
    """Send text as UTF-8, without a line feed.

    Args:
        value: the text.
    """
    await channel.send(value.encode())


async def send_line(channel: Channel, value: str) -> None:
    """Send text as UTF-8, followed by a line feed.

    Args:
        value: the text.
    """
    await channel.send(value.encode() + b"\n")


async def send_int(channel: Channel, value: int) -> None:
    """Send an integer as four bytes, most significant byte first.

    Args:
        value: the integer.
    """
    await channel.send(INTEGER.pack(value))


async def send_byte(channel: Channel, value: int) -> None:
    """Send one byte.

    Args:
        value: the byte, from 0 to 255.
    """
    await channel.send(_bytes([value]))


async def send_all_string(channel: Channel, value: list[int]) -> None:
    """Send bytes. Zeros are allowed.

    Args:
        value: the bytes, from 0 to 255 each.
    """
    await channel.send(_bytes(value))


async def read_string(
    channel: Channel, prefix: str = "", suffix: str = "", timeout: float = TIMEOUT_S
) -> str:
    """Read text: the part between a prefix and a suffix. If there is no suffix, all text that has arrived is
    returned.

    Args:
        prefix: start of the text; everything before it is dropped. Empty for none.
        suffix: end of the text; empty: read the available text, once there is any.
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        the text; bytes that are not UTF-8 become U+FFFD.
    """
    return _text(await channel.read_between(prefix.encode(), suffix.encode(), timeout))


async def read_line(channel: Channel, timeout: float = TIMEOUT_S) -> str:
    """Read a line.

    Args:
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        the line without its line feed and without a carriage return before the line feed.
    """
    return _text(await channel.read_line(timeout))


async def read_byte(channel: Channel, timeout: float = TIMEOUT_S) -> int:
    """Read one byte.

    Args:
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        the byte, from 0 to 255.
    """
    return (await channel.read_exactly(1, timeout))[0]


async def read_byte_list(channel: Channel, number: int, timeout: float = TIMEOUT_S) -> list[int]:
    """Read a number of bytes. If not all arrive in time, those that have arrived stay for the next call.

    Args:
        number: number of bytes, from 1 to 65536.
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        the bytes, from 0 to 255 each.
    """
    return list(await channel.read_exactly(number, timeout))


async def read_binary_integer(channel: Channel, number: int, timeout: float = TIMEOUT_S) -> list[int]:
    """Read a given number of four-byte integers, most significant byte first.

    Args:
        number: number of integers, from 1 to 1000.
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        the integers.
    """
    _require_count(number)
    data = await channel.read_exactly(number * INTEGER.size, timeout)
    return [value for (value,) in INTEGER.iter_unpack(data)]


async def read_ascii_float(channel: Channel, number: int, timeout: float = TIMEOUT_S) -> list[float]:
    """Read a number of values that arrive as text in parentheses, such as "(1.5, -2, 3e2)".

    Args:
        number: number of values, from 1 to 1000.
        timeout: timeout, s, up to 60; 0 for 2 s.

    Returns:
        the numbers.
    """
    _require_count(number)
    text = _text(await channel.read_between(b"(", b")", timeout))
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as exc:
        raise DeviceError(f"{channel.name}: {shown(text)} is not a list of numbers") from exc
    if len(values) != number:
        raise DeviceError(f"{channel.name}: expected {number} numbers, received {len(values)}")
    return values


EVERY_CHANNEL = (
    send_string,
    send_line,
    send_int,
    send_byte,
    send_all_string,
    read_string,
    read_line,
    read_byte,
    read_byte_list,
)
"""Services of both sockets and serial ports."""


def register(
    robot_class: str,
    prefix: str,
    default: str,
    channel: Callable[[Services, str], Channel],
    functions: tuple[Callable[..., Any], ...],
) -> None:
    """Register the given functions as services of a class. Each service has an additional field, which names
    the open device.

    Args:
        prefix: prefix of the methods' names and of that field's name, such as "socket".
        default: default value of the field.
        channel: function that finds the device.
    """
    field = f"{prefix}_name"
    for function in functions:
        service(robot_class, name=camel_case(f"{prefix}_{function.__name__}"))(
            _for_robot(function, field, default, channel)
        )


def _for_robot(
    function: Callable[..., Any], field: str, default: str, channel: Callable[[Services, str], Channel]
) -> Callable[..., Any]:
    async def call(robot: Services, **fields: Any) -> Any:
        return await function(channel(robot, fields.pop(field)), **fields)

    own = inspect.signature(function)
    kind = inspect.Parameter.KEYWORD_ONLY
    robot = inspect.Parameter("robot", inspect.Parameter.POSITIONAL_ONLY)
    fields = [parameter.replace(kind=kind) for parameter in list(own.parameters.values())[1:]]
    name = inspect.Parameter(field, kind, default=default, annotation="str")
    call.__signature__ = own.replace(parameters=[robot, *fields, name])  # type: ignore[attr-defined]
    doc = inspect.getdoc(function) or ""
    described = f"    {field}: name of the open device; empty for {default}.\n"
    call.__doc__ = re.sub(r"(Args:\n(?:    .*\n?)*)", rf"\1{described}", doc + "\n")
    return call


def _bytes(values: list[int]) -> bytes:
    for value in values:
        if not 0 <= value <= BYTE:
            raise InputError(f"a byte must be from 0 to {BYTE}, got {value}")
    return bytes(values)


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def _require_count(number: int) -> None:
    if not 1 <= number <= MAX_NUMBERS:
        raise InputError(f"number must be from 1 to {MAX_NUMBERS}, got {number}")
