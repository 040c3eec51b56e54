"""The codes of Modbus, for its clients in the service and in the grippers.

Source: MODBUS Application Protocol V1.1b3, modbus.org.
"""

from __future__ import annotations

from enum import IntEnum


class ModbusFunction(IntEnum):
    """Function codes."""

    READ_COILS = 1
    READ_DISCRETE_INPUTS = 2
    READ_HOLDING_REGISTERS = 3
    READ_INPUT_REGISTERS = 4
    WRITE_COIL = 5
    WRITE_REGISTER = 6
    WRITE_REGISTERS = 16
    READ_WRITE_REGISTERS = 23


REFUSED = 0x80
"""Flag that a device adds to the function code of a request that it rejects."""
REFUSALS = {
    1: "illegal function",
    2: "illegal address",
    3: "illegal value",
    4: "device failure",
    5: "acknowledge",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway no response",
}
"""Exception codes."""
COIL_ON = 0xFF00
"""Value that means "on" in a request to write a coil."""
