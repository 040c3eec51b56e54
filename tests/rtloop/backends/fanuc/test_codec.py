"""The bytes of Stream Motion.

Oracle: `airo_fanuc.testing.wire`, whose layouts were captured from a real CRX; struct for what it lacks.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtloop.backends.fanuc.codec import (
    decode_received,
    decode_sent,
    encode_capability,
    encode_capability_request,
    encode_command,
    encode_io_config,
    encode_io_result,
    encode_limits,
    encode_limits_request,
    encode_start,
    encode_status,
    encode_stop,
)
from rtloop.backends.fanuc.messages import (
    AXES,
    IO_BYTES,
    CapabilityPacket,
    CommandPacket,
    IoBlock,
    IoBlockKind,
    IoConfigRequest,
    IoConfigResult,
    LimitRate,
    LimitsPacket,
    LimitsRequest,
    PointType,
    StartPacket,
    StatusPacket,
    StopPacket,
)

WORD = st.integers(0, 2**32 - 1)
BYTE = st.integers(0, 255)
SINGLE = st.floats(width=32, allow_nan=False)
ROW = st.lists(SINGLE, min_size=AXES, max_size=AXES).map(tuple)
DOUBLES = st.lists(st.floats(allow_nan=False), min_size=AXES, max_size=AXES).map(tuple)
STATUS = st.builds(
    StatusPacket,
    version=st.sampled_from([3, 4]),
    sequence=WORD,
    status=BYTE,
    robot_status=BYTE,
    contact_stop=st.integers(0, 4),
    time_ms=WORD,
    pose=ROW,
    joints=ROW,
    currents=ROW,
    safety_scale=SINGLE,
    io=st.binary(min_size=IO_BYTES, max_size=IO_BYTES),
)
COLUMNS = st.lists(SINGLE, min_size=20, max_size=20).map(tuple)
LIMITS = st.builds(
    LimitsPacket, WORD, st.integers(1, AXES), st.sampled_from(LimitRate), WORD, WORD, COLUMNS, COLUMNS
)


@pytest.fixture(scope="module")
def wire() -> Any:
    return pytest.importorskip("airo_fanuc.testing.wire", reason="airo-fanuc is not installed")


@given(sequence=WORD, position=DOUBLES, is_last=st.booleans(), moves=st.booleans())
def test_a_command_has_the_bytes_of_the_peer(
    wire: Any, sequence: int, position: tuple[float, ...], is_last: bool, moves: bool
) -> None:
    theirs = wire.encode_command_packet(
        sequence, position, is_last_command=is_last, do_motn_ctrl=moves, version_no=3
    )
    ours = CommandPacket(3, sequence, position, is_last, moves)
    assert encode_command(ours) == theirs
    assert decode_sent(theirs) == ours


@given(packet=STATUS)
def test_a_state_is_read_as_the_peer_reads_it(wire: Any, packet: StatusPacket) -> None:
    data = encode_status(packet)
    assert decode_received(data) == packet
    theirs = wire.decode_status_packet(data)
    assert (theirs.sequence_no, theirs.status, theirs.robot_status, theirs.time_stamp) == (
        packet.sequence, packet.status, packet.robot_status, packet.time_ms,
    )  # fmt: skip
    assert tuple(theirs.joint_angle_deg) == packet.joints
    assert tuple(theirs.position_deg) == packet.pose
    assert tuple(theirs.current) == packet.currents
    assert theirs.contact_stop_status == packet.contact_stop
    assert theirs.packet_type == (204 if packet.version == 4 else 202)


def test_the_peers_own_states_are_read(wire: Any) -> None:
    found = decode_received(wire._build_synthetic_status_204())
    assert isinstance(found, StatusPacket)
    assert found.joints == tuple(20.0 + axis for axis in range(AXES))
    assert (found.sequence, found.safety_scale) == (12345, 0.875)
    older = decode_received(wire._build_synthetic_status_v3())
    assert isinstance(older, StatusPacket)
    assert (older.sequence, older.joints[0]) == (7777, 50.0)


def test_the_requests_have_the_bytes_of_the_peer(wire: Any) -> None:
    assert encode_start(3) == wire.encode_start_packet(version_no=3)
    assert encode_stop(4) == wire.encode_stop_packet(version_no=4)
    assert encode_capability_request(3) == wire.encode_get_capability_packet(version_no=3)
    told = wire.encode_capability_result_packet(sampling_rate_ms=4, available_version=4, start_move=2)
    assert decode_received(told) == CapabilityPacket(4, 4, 2)
    ours = encode_capability(CapabilityPacket(4, 2, 1, at_tcp=True))
    theirs = wire.decode_capability_result_packet(ours)
    assert (theirs.available_version, theirs.sampling_rate_ms, theirs.start_move) == (4, 2, 1)
    assert decode_sent(encode_start(3)) == StartPacket(3)
    assert decode_sent(encode_stop(3)) == StopPacket(3)


def test_a_capability_with_a_short_last_field_is_read() -> None:
    """As some R-50iA send it."""
    whole = encode_capability(CapabilityPacket(3, 2, 1))
    assert decode_received(whole[:25]) == CapabilityPacket(3, 2, 1)


@given(packet=LIMITS)
def test_a_table_is_where_the_manual_has_it(packet: LimitsPacket) -> None:
    data = encode_limits(packet)
    row = np.frombuffer(data, ">u4")
    assert row[:6].tolist() == [
        3,
        packet.version,
        packet.axis,
        packet.rate,
        packet.max_speed,
        packet.interval_ms,
    ]
    assert tuple(np.frombuffer(data[24:], ">f4").tolist()) == packet.unloaded + packet.loaded
    assert decode_received(data) == packet
    asked = encode_limits_request(LimitsRequest(3, packet.axis, packet.rate))
    assert asked == struct.pack(">4I", 3, 3, packet.axis, packet.rate)
    assert decode_sent(asked) == LimitsRequest(3, packet.axis, packet.rate)


def test_an_io_configuration_has_32_blocks() -> None:
    block = IoBlock(IoBlockKind.COMMAND, PointType.RO, 3, 2)
    data = encode_io_config(IoConfigRequest(3, (block,)))
    assert len(data) == 8 + 32 * 16
    assert struct.unpack_from(">6I", data) == (203, 3, 1, 2, 3, 2)
    assert decode_sent(data) == IoConfigRequest(3, (block,))
    assert decode_received(encode_io_result(IoConfigResult(2, 40))) == IoConfigResult(2, 40)


@given(data=st.binary(max_size=600))
def test_any_bytes_are_a_packet_or_a_sentence(data: bytes) -> None:
    for decode in (decode_received, decode_sent):
        found: object = decode(data)
        assert not isinstance(found, str) or found.startswith("a")


@given(packet=STATUS, cut=st.integers(0, 415), flip=st.integers(0, 8 * 388 - 1))
def test_damaged_bytes_never_raise(packet: StatusPacket, cut: int, flip: int) -> None:
    data = bytearray(encode_status(packet))
    if cut < len(data):
        assert isinstance(decode_received(bytes(data[:cut])), str)
    data[flip // 8] ^= 1 << flip % 8
    decode_received(bytes(data))


def test_an_old_version_is_named() -> None:
    data = bytearray(encode_status(StatusPacket(3, 1, 0, 0, 0, 0, (0.0,) * 9, (0.0,) * 9)))
    data[4:8] = struct.pack(">I", 1)
    assert "version 1; the oldest supported version is 3" in str(decode_received(bytes(data)))


def test_values_that_are_no_numbers_come_through() -> None:
    """The cycle finds them, and faults."""
    packet = StatusPacket(3, 1, 0, 0, 0, 0, (0.0,) * 9, (math.nan,) * 9)
    found = decode_received(encode_status(packet))
    assert isinstance(found, StatusPacket)
    assert math.isnan(found.joints[0])
