"""The codec of RTDE. Oracle: Python's struct on the layouts of Universal Robots' guide."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from rtloop.backends.ur.fields import OUTPUTS
from rtloop.backends.ur.rtde import (
    Kind,
    Package,
    Recipe,
    RtdeError,
    Splitter,
    decode_setup,
    decode_text,
    encode,
    encode_inputs_setup,
    encode_outputs_setup,
    encode_text,
)

NAMES = ("timestamp", "actual_q", "robot_mode", "actual_digital_input_bits", "output_bit_register_64")
TYPES = [OUTPUTS[name] for name in NAMES]
VALUES = {
    "timestamp": 12.5,
    "actual_q": (0.1, -0.2, 0.3, -0.4, 0.5, -0.6),
    "robot_mode": -1,
    "actual_digital_input_bits": 1 << 40 | 5,
    "output_bit_register_64": True,
}


def test_a_data_package_has_the_layout_of_the_guide() -> None:
    joints = VALUES["actual_q"]
    assert isinstance(joints, tuple)
    payload = struct.pack(">BddddddDiQ?".replace("D", "d"), 7, 12.5, *joints, -1, 1 << 40 | 5, True)
    assert Recipe(7, NAMES, TYPES).encode(VALUES) == struct.pack(">HB", len(payload) + 3, 85) + payload
    assert Recipe(7, NAMES, TYPES).decode(payload) == VALUES


def test_requests_have_the_layout_of_the_guide() -> None:
    assert encode(Kind.REQUEST_PROTOCOL_VERSION, struct.pack(">H", 2)) == b"\x00\x05V\x00\x02"
    assert encode(Kind.START) == b"\x00\x03S"
    assert encode_outputs_setup(125.0, ["a", "b"]) == b"\x00\x0eO" + struct.pack(">d", 125.0) + b"a,b"
    assert encode_inputs_setup(["a", "b"]) == b"\x00\x06Ia,b"
    assert decode_setup(b"\x03DOUBLE,IN_USE") == (3, ["DOUBLE", "IN_USE"])
    text = encode_text("out of range", "RTDE", 1)
    assert text == b"\x00\x16M\x0cout of range\x04RTDE\x01"
    assert decode_text(text[3:]) == "out of range"


def test_a_stream_is_split_however_it_is_cut() -> None:
    packages = [Package(85, b"one"), Package(77, b""), Package(79, b"x" * 300)]
    stream = b"".join(struct.pack(">HB", 3 + len(p.payload), p.kind) + p.payload for p in packages)
    random = np.random.default_rng(0)
    for _ in range(50):
        splitter, found, begin = Splitter(), list[Package](), 0
        while begin < len(stream):
            end = begin + int(random.integers(1, 40))
            found += splitter.split(stream[begin:end])
            begin = end
        assert found == packages


@pytest.mark.parametrize(
    ("payload", "found"),
    [
        (b"", "a data package has 0 bytes, expected 9"),
        (b"\x01" + b"\x00" * 9, "has 10 bytes"),
        (b"\x02" + b"\x00" * 8, "recipe 2, expected 1"),
    ],
)
def test_other_data_packages_are_rejected(payload: bytes, found: str) -> None:
    with pytest.raises(RtdeError, match=found):
        Recipe(1, ("timestamp",), ["DOUBLE"]).decode(payload)


def test_a_package_that_cannot_exist_is_an_error() -> None:
    with pytest.raises(RtdeError, match="a package has 2 bytes; the shortest possible package has 3"):
        Splitter().split(b"\x00\x02U")


def test_unknown_types_and_missing_types_are_errors() -> None:
    with pytest.raises(RtdeError, match="type 'NOT_FOUND' is not one of RTDE's"):
        Recipe(1, ("a",), ["NOT_FOUND"])
    with pytest.raises(RtdeError, match="1 types for 2 variables"):
        Recipe(1, ("a", "b"), ["DOUBLE"])
