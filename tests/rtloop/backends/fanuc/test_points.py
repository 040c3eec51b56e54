"""Where inputs and outputs are in the packets.

Oracle: the rule that FANUC's library publishes (`gpio_buffer.cpp`): blocks one after the other, each from a
multiple of four bytes on, lowest byte and lowest bit first.
"""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from rtloop.backends import BackendError
from rtloop.backends.fanuc.messages import IO_BYTES, IoBlockKind
from rtloop.backends.fanuc.options import FanucOptions
from rtloop.backends.fanuc.points import Points

NAMES = ["DO[11]", "DI[1]", "DO[12]", "AO[2]", "RI[5]", "DO[14]", "AI[1]", "F[1]"]


def test_consecutive_numbers_share_a_block() -> None:
    points = Points(NAMES)
    states = [(b.type.name, b.start, b.length) for b in points.blocks if b.kind == IoBlockKind.STATE]
    assert states == [
        ("DO", 11, 2), ("DO", 14, 1), ("DI", 1, 1), ("RI", 5, 1), ("AO", 2, 1),
        ("AI", 1, 1), ("F", 1, 1),
    ]  # fmt: skip
    commands = [(b.type.name, b.start, b.length) for b in points.blocks if b.kind == IoBlockKind.COMMAND]
    assert commands == [
        ("DO", 11, 2),
        ("DO", 14, 1),
        ("AO", 2, 1),
        ("F", 1, 1),
    ]


def test_values_are_where_the_rule_has_them() -> None:
    points = Points(NAMES)
    data = bytearray(IO_BYTES)
    data[0], data[8], data[16:18], data[20:22] = 0b10, 1, b"\x34\x12", b"\xff\x00"
    found = {each.name: each.value for each in points.reported(bytes(data))}
    assert found == {
        "DO[11]": 0.0, "DO[12]": 1.0, "DO[14]": 0.0, "DI[1]": 1.0, "RI[5]": 0.0, "AO[2]": float(0x1234),
        "AI[1]": 255.0, "F[1]": 0.0,
    }  # fmt: skip
    points.set("DO[12]", 1.0)
    points.set("DO[14]", 1.0)
    points.set("AO[2]", 0x1234)
    points.set("F[1]", 1.0)
    assert points.data[:16] == bytes([2, 0, 0, 0, 1, 0, 0, 0, 0x34, 0x12, 0, 0, 1, 0, 0, 0])
    points.set("DO[12]", 0.0)
    assert points.data[0] == 0


def test_no_output_changes_when_commands_begin() -> None:
    points = Points(NAMES)
    points.begin({"DO[11]": 1, "DO[12]": 0, "DO[14]": 1, "AO[2]": 700, "F[1]": 0})
    assert points.data[0] == 1
    assert points.data[4] == 1
    assert int.from_bytes(points.data[8:10], "little") == 700


def test_what_is_no_output_is_not_set() -> None:
    points = Points(NAMES)
    with pytest.raises(
        BackendError, match=r"DI\[1\] is not one of the outputs in robot.backend.io: DO\[11\]"
    ):
        points.set("DI[1]", 1.0)
    with pytest.raises(BackendError, match="allowed: 0 to 65535"):
        points.set("AO[2]", 65536.0)
    assert Points([]).data == bytes(IO_BYTES)


def test_too_many_blocks_are_refused() -> None:
    with pytest.raises(BackendError, match="need 40 blocks, allowed: 32"):
        Points([f"DO[{2 * number}]" for number in range(1, 21)])


@pytest.mark.parametrize("name", ["DO1", "XX[1]", "DO[0]", "DO[01]", "do[1]", "DO[1]x", "R[1]"])
def test_a_name_that_is_none_is_named(name: str) -> None:
    with pytest.raises(ValidationError, match="is not an input or output such as DO"):
        FanucOptions(io=[name])
