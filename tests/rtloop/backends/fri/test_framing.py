"""The frame of FRI 2.7 against Google's protobuf (a fixed32) and zlib's CRC-32, and damaged frames."""

from __future__ import annotations

import random
import zlib
from dataclasses import replace

import pytest
from fri_descriptor import fri_messages
from hypothesis import given, settings
from hypothesis import strategies as st

from rtloop.backends.fri.codec import MAX_BYTES, MAX_PACKET, decode_command, decode_monitoring
from rtloop.backends.fri.encoding import encode_command, encode_monitoring
from rtloop.backends.fri.framing import frame
from rtloop.backends.fri.messages import (
    COMMAND_ID,
    MONITORING_ID,
    CommandMessage,
    FriHeader,
    MonitoringMessage,
)

SEVEN = (0.25,) * 7
MESSAGE = MonitoringMessage(
    FriHeader(MONITORING_ID, 5, 4),
    joints=7,
    measured_position=SEVEN,
    external_force=(1.0, -2.0, 3.0, 0.1, 0.2, -0.3),
    framed=True,
)
ANSWER = CommandMessage(FriHeader(COMMAND_ID, 8, 5), position=SEVEN, framed=True)
BARE = encode_monitoring(replace(MESSAGE, framed=False))


def fixed32(value: int) -> bytes:
    """As Google's protobuf writes it, without the key of its field."""
    pytest.importorskip("google.protobuf", reason="Google's protobuf, the oracle of this test, is missing")
    content: bytes = fri_messages().FrameLength(value=value).SerializeToString()
    return content[1:]


def test_a_frame_is_what_protobuf_and_zlib_make_of_it() -> None:
    assert encode_monitoring(MESSAGE) == fixed32(len(BARE)) + BARE + fixed32(zlib.crc32(BARE))
    bare = encode_command(replace(ANSWER, framed=False))
    assert encode_command(ANSWER) == fixed32(len(bare)) + bare + fixed32(zlib.crc32(bare))


def test_a_framed_message_of_googles_protobuf_is_read() -> None:
    message = fri_messages().FRIMonitoringMessage()
    message.header.messageIdentifier, message.header.sequenceCounter = MONITORING_ID, 5
    message.header.reflectedSequenceCounter = 4
    message.monitorData.measuredJointPosition.value.extend(SEVEN)
    message.monitorData.externalForce.element.extend(MESSAGE.external_force)
    content = message.SerializeToString()
    found = decode_monitoring(fixed32(len(content)) + content + fixed32(zlib.crc32(content)))
    assert found == MESSAGE
    assert isinstance(found, MonitoringMessage)
    assert found.version == "2.7"


def test_both_directions_come_back_as_they_were() -> None:
    assert decode_monitoring(encode_monitoring(MESSAGE)) == MESSAGE
    assert decode_command(encode_command(ANSWER)) == ANSWER
    assert decode_monitoring(BARE) == replace(MESSAGE, framed=False)


@pytest.mark.parametrize("size", [0x10A, 0x20A, 0xA0A])
def test_a_length_that_begins_like_a_bare_message_is_a_length(size: int) -> None:
    """Its lowest byte is the key of a header; an unknown field fills the message up."""
    more = size - len(BARE) - 4
    content = BARE + b"\xfa\x7f" + bytes((more & 0x7F | 0x80, more >> 7)) + bytes(more)
    assert (len(content), frame(content)[0]) == (size, 0x0A)
    assert decode_monitoring(frame(content)) == MESSAGE


@pytest.mark.parametrize("length", [0, 1, len(BARE) - 1, len(BARE) + 1, 2**31, 2**32 - 1])
def test_a_wrong_length_is_named(length: int) -> None:
    packet = bytearray(encode_monitoring(MESSAGE))
    packet[:4] = length.to_bytes(4, "little")
    assert decode_monitoring(bytes(packet)) == (
        f"no monitoring message of FRI: the frame of FRI 2.7 states a message of {length} bytes, but the "
        f"message has {len(BARE)} (packet: {len(packet)} bytes)"
    )


def test_a_wrong_checksum_is_named() -> None:
    packet = bytearray(encode_monitoring(MESSAGE))
    packet[-10] ^= 1
    found, sent = zlib.crc32(packet[4:-4]), zlib.crc32(BARE)
    assert decode_monitoring(bytes(packet)) == (
        f"no monitoring message of FRI: the frame of FRI 2.7 states the CRC-32 {sent:#010x}, but its message "
        f"has {found:#010x}"
    )


def test_a_frame_around_too_long_a_message_is_named() -> None:
    assert f"at most {MAX_BYTES}" in str(decode_monitoring(frame(bytes(MAX_BYTES + 1))))
    assert len(frame(bytes(MAX_BYTES))) == MAX_PACKET


@settings(deadline=None, max_examples=300)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_single_damaged_byte_passes_for_another_message(seed: int) -> None:
    """CRC-32 finds every burst of up to 32 bits."""
    rng, whole = random.Random(seed), encode_monitoring(MESSAGE)
    packet = bytearray(whole)
    packet[rng.randrange(len(packet))] ^= rng.randrange(1, 256)
    assert isinstance(decode_monitoring(bytes(packet)), str)
    cut = decode_monitoring(whole[: rng.randrange(len(whole))])
    assert isinstance(cut, str)
    assert cut
