"""Coils, inputs and registers of a Modbus device. A driver uses them instead of the robot's inputs and
outputs.
"""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from cobot.grippers.modbus import Master, TcpMaster
from cobot.grippers.protocol import GripperError, IoPort
from cobot.modbus import ModbusFunction

KINDS = {
    "coil": ModbusFunction.READ_COILS,
    "input": ModbusFunction.READ_DISCRETE_INPUTS,
    "register": ModbusFunction.READ_HOLDING_REGISTERS,
    "input register": ModbusFunction.READ_INPUT_REGISTERS,
}
"""Kinds of points, and the function that reads each kind."""
WRITABLE = ("coil", "register")
BITS = ("coil", "input")
MAX_WORD = 65535
_NAME = re.compile(rf"({'|'.join(KINDS)}) ([0-9]{{1,5}})")


class ModbusOptions(BaseModel):
    """The Modbus device whose coils, inputs and registers operate a gripper."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    device: Annotated[
        str,
        Field(
            min_length=1, max_length=200, description="HOST:PORT, or with protocol rtu also a serial port."
        ),
    ]
    protocol: Annotated[
        Literal["tcp", "rtu"],
        Field(description="tcp: Modbus TCP. rtu: Modbus RTU, on a serial port or over TCP."),
    ] = "tcp"
    unit: Annotated[int, Field(ge=0, le=255, description="Address of the device.")] = 1
    baud: Annotated[int, Field(ge=1200, le=4_000_000, description="Baud rate of a serial port.")] = 115_200
    timeout_s: Annotated[float, Field(gt=0.0, le=2.0, description="Timeout for each answer, s.")] = 0.2


class ModbusPoints:
    """The points of a Modbus device, see `IoPort`. Their names are, for example, `coil 3`, `input 0`,
    `register 7`, `input register 2`. Numbers begin at 0.
    """

    def __init__(self, options: ModbusOptions) -> None:
        kind = TcpMaster if options.protocol == "tcp" else Master
        self._master = kind(
            options.device, options.unit, options.baud, options.timeout_s, slave="the Modbus device"
        )

    def open(self) -> None:
        """Connect. Raises GripperError if the device cannot be reached."""
        self._master.open()

    def close(self) -> None:
        self._master.close()

    def read(self, name: str) -> float:
        kind, address = parts_of(name)
        if kind in BITS:
            return float(self._master.read_bit(address, KINDS[kind]))
        return float(self._master.read(address, 1, KINDS[kind])[0])

    def set(self, name: str, value: float) -> None:
        kind, address = parts_of(name)
        if kind not in WRITABLE:
            raise GripperError(f"{name} is an input of the Modbus device; name a coil or a register")
        if kind == "coil":
            self._master.write_coil(address, value != 0.0)
            return
        if not 0.0 <= value <= MAX_WORD:
            raise GripperError(f"{name} is {value:g}, allowed: 0 to {MAX_WORD}")
        self._master.write(address, [round(value)])


def port_of(modbus: ModbusOptions | None, port: IoPort) -> IoPort:
    """The points of the Modbus device, or the robot's points if there is no device."""
    return port if modbus is None else ModbusPoints(modbus)


def parts_of(name: str) -> tuple[str, int]:
    """Parse the name of a point into kind and address.

    Raises:
        GripperError: the name is invalid.
    """
    found = _NAME.fullmatch(name)
    if found is None or int(found[2]) > MAX_WORD:
        raise GripperError(
            f"{name!r} is not a point of a Modbus device; valid names: "
            f"{', '.join(f'{kind} N' for kind in KINDS)}, with N from 0 to {MAX_WORD}"
        )
    return found[1], int(found[2])


def check_names(
    modbus: ModbusOptions | None, outputs: tuple[str | None, ...], inputs: tuple[str | None, ...]
) -> None:
    """Check the names of points of a Modbus device.

    Raises:
        ValueError: a name is invalid, or the name of an output belongs to an input of the device.
    """
    if modbus is None:
        return
    for name in (*outputs, *inputs):
        if name is None:
            continue
        try:
            kind, _ = parts_of(name)
        except GripperError as exc:
            raise ValueError(str(exc)) from exc
        if name in outputs and kind not in WRITABLE:
            raise ValueError(f"{name} is an input of the Modbus device; name a coil or a register")
