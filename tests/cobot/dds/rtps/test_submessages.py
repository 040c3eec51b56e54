"""Bytes of submessages and parameters; oracles: the examples and tables of the RTPS 2.2 specification."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot.dds.rtps import Guid, MalformedError, SampleIdentity
from cobot.dds.rtps import submessages as sub
from cobot.dds.rtps.cursor import Cursor, Layout
from cobot.dds.rtps.number_sets import pack_fragments, pack_sequences, read_fragments, read_sequences
from cobot.dds.rtps.parameters import (
    SENTINEL,
    ParameterReader,
    Pid,
    disposal,
    disposes,
    locator,
    parameter,
    read_identity,
    read_parameters,
    related_identity,
    text,
)

READER, WRITER = b"\0\0\1\4", b"\0\0\2\3"


def cursor(data: bytes, *, little: bool = True) -> Cursor:
    return Cursor(memoryview(data), 0, len(data), little)


def only(data: bytes) -> sub.Submessage:
    (message,) = sub.read_submessages(cursor(data))
    return message


def test_a_cursor_never_reads_beyond_its_end() -> None:
    short = cursor(b"\1\2\3")
    for read in (short.u32, short.sequence, lambda: short.take(4), lambda: short.read(Layout("HH"))):
        with pytest.raises(MalformedError, match="3 left"):
            read()
    assert short.rest() == b"\1\2\3"


def test_both_byte_orders_are_read() -> None:
    assert cursor(b"\0\0\1\2", little=False).u32() == cursor(b"\2\1\0\0").u32() == 0x102


def test_the_set_in_the_specification_is_read_and_written() -> None:
    # RTPS 2.2, 9.4.2.6: "1234/12:00110" stands for 1236 and 1237.
    words = bytes.fromhex("00000000 d2040000 0c000000 00000030")
    assert read_sequences(cursor(words)) == (1234, [1236, 1237])
    assert pack_sequences(1234, [1236, 1237]) == bytes.fromhex("00000000 d2040000 04000000 00000030")


@given(st.integers(1, 2**62), st.sets(st.integers(0, 255)))
def test_sets_of_sequence_numbers_survive_the_wire(base: int, offsets: set[int]) -> None:
    members = sorted(base + offset for offset in offsets)
    assert read_sequences(cursor(pack_sequences(base, members))) == (base, members)


@given(st.integers(1, 2**31), st.sets(st.integers(0, 255)))
def test_sets_of_fragment_numbers_survive_the_wire(base: int, offsets: set[int]) -> None:
    members = sorted(base + offset for offset in offsets)
    assert read_fragments(cursor(pack_fragments(base, members))) == (base, members)


def test_a_set_holds_256_numbers_and_what_lies_beyond_is_left_out() -> None:
    assert read_sequences(cursor(pack_sequences(1, range(1, 1000)))) == (1, list(range(1, 257)))


@pytest.mark.parametrize("bits", [257, 0xFFFFFFFF])
def test_a_set_of_more_than_256_bits_is_malformed(bits: int) -> None:
    with pytest.raises(MalformedError, match="allowed: 256"):
        read_sequences(cursor(bytes(4) + b"\1\0\0\0" + bits.to_bytes(4, "little") + bytes(64)))


@given(st.binary(max_size=40), st.integers(1, 2**62))
def test_a_sample_survives_the_wire_with_at_most_three_zeros_more(payload: bytes, sequence: int) -> None:
    inline = related_identity(SampleIdentity(Guid(bytes(range(16))), 7))
    data = sub.read_data(only(sub.data(READER, WRITER, sequence, inline, payload, key=False)))
    assert (data.reader, data.writer, data.sequence) == (READER, WRITER, sequence)
    assert data.payload is not None
    assert data.payload.tobytes() == payload + bytes(-len(payload) % 4)
    assert read_identity(data.inline, data.little) == SampleIdentity(Guid(bytes(range(16))), 7)


def test_a_fragment_survives_the_wire() -> None:
    fragment = sub.data_fragment(READER, WRITER, 1, b"", b"abcdefgh", 2, 4)
    data = sub.read_data(only(fragment))
    assert data.fragment == sub.DataFragment(first=2, count=1, size=4, total=8)
    assert data.payload == b"efgh"


def test_heartbeats_gaps_and_answers_survive_the_wire() -> None:
    big = 1 << 40
    message = only(sub.heartbeat(READER, WRITER, big, big + 3, 9, final=True))
    assert sub.read_pair(message) == (READER, WRITER)
    assert sub.read_heartbeat(message) == (big, big + 3, True)
    message = only(sub.heartbeat_fragment(READER, WRITER, big, 5, 1))
    assert (sub.read_pair(message), sub.read_heartbeat_fragment(message)) == ((READER, WRITER), (big, 5))
    message = only(sub.gap(READER, WRITER, 3, 5, [7, 9]))
    assert (sub.read_pair(message), sub.read_gap(message)) == ((READER, WRITER), (3, 5, [7, 9]))
    message = only(sub.acknowledgement(READER, WRITER, 4, [4, 6], 1, final=False))
    assert (sub.read_pair(message), sub.read_acknowledgement(message)) == (
        (READER, WRITER),
        (4, [4, 6], False),
    )
    message = only(sub.fragments_wanted(READER, WRITER, big, [2, 8], 1))
    assert (sub.read_pair(message), sub.read_fragments_wanted(message)) == ((READER, WRITER), (big, [2, 8]))


@pytest.mark.parametrize(
    "message",
    [
        sub.heartbeat(READER, WRITER, 0, 0, 1, final=True),
        sub.heartbeat(READER, WRITER, 5, 3, 1, final=True),
    ],
)
def test_a_heartbeat_of_impossible_samples_is_malformed(message: bytes) -> None:
    read = only(message)
    sub.read_pair(read)
    with pytest.raises(MalformedError, match="heartbeat"):
        sub.read_heartbeat(read)


def test_a_gap_that_ends_before_it_begins_is_malformed() -> None:
    read = only(sub.gap(READER, WRITER, 9, 5))
    sub.read_pair(read)
    with pytest.raises(MalformedError, match="gap"):
        sub.read_gap(read)


def test_the_last_submessage_may_have_length_zero() -> None:
    message = bytearray(sub.heartbeat(READER, WRITER, 1, 2, 3, final=False))
    message[2:4] = b"\0\0"
    read = only(bytes(message))
    sub.read_pair(read)
    assert sub.read_heartbeat(read) == (1, 2, False)


def test_time_survives_the_wire_to_a_nanosecond() -> None:
    assert sub.read_time(only(sub.info_time(1_700_000_000.25))) == 1_700_000_000.25
    assert sub.read_time(only(b"\x09\x03\0\0")) is None


def test_parameters_end_at_their_sentinel_and_not_without_it() -> None:
    listed = parameter(Pid.TOPIC_NAME, b"ab") + parameter(Pid.TOPIC_NAME, b"cdef") + SENTINEL
    assert read_parameters(cursor(listed + b"rest")) == {Pid.TOPIC_NAME: [b"ab\0\0", b"cdef"]}
    with pytest.raises(MalformedError):
        read_parameters(cursor(listed[:-4]))


def test_a_related_identity_is_found_under_either_number() -> None:
    # 0x800F is all that Fast DDS before 2.14 knows, 0x0083 is the standard's.
    both = read_parameters(cursor(related_identity(SampleIdentity(Guid(b"g" * 16), 3)) + SENTINEL))
    assert set(both) == {0x0083, 0x800F}
    for pid in both:
        assert read_identity({pid: both[pid]}, True) == SampleIdentity(Guid(b"g" * 16), 3)
    assert read_identity({0x0083: [bytes(24)]}, True) is None


def test_a_disposal_is_told_from_a_sample() -> None:
    assert disposes(read_parameters(cursor(disposal(b"g" * 16) + SENTINEL)))
    assert not disposes(read_parameters(cursor(SENTINEL)))
    assert not disposes(None)


def test_only_udp_locators_with_an_address_and_a_port_count() -> None:
    shared_memory = b"\x10\0\0\0" + bytes(20)
    listed = b"".join(
        parameter(Pid.DEFAULT_UNICAST_LOCATOR, value)
        for value in (
            shared_memory,
            locator(("10.0.0.1", 7411)),
            locator(("0.0.0.0", 1)),
            locator(("1.2.3.4", 0)),
        )
    )
    values = ParameterReader(b"\0\3\0\0" + listed + SENTINEL)
    assert values.locators(Pid.DEFAULT_UNICAST_LOCATOR) == [("10.0.0.1", 7411)]


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (b"", "begins with"),
        (b"\0\1\0\0" + SENTINEL, "begins with"),
        (b"\0\3\0\0" + parameter(Pid.TOPIC_NAME, b"\xff\xff\xff\xff") + SENTINEL, "at most"),
        (b"\0\3\0\0" + parameter(Pid.TOPIC_NAME, b"\2\0\0\0\xff\0") + SENTINEL, "UTF-8"),
        (b"\0\3\0\0" + SENTINEL, "lacks"),
    ],
)
def test_a_bad_announcement_says_what_is_wrong(payload: bytes, message: str) -> None:
    with pytest.raises(MalformedError, match=message):
        ParameterReader(payload).text(Pid.TOPIC_NAME, 100)


def test_text_is_read_up_to_its_end() -> None:
    values = ParameterReader(b"\0\3\0\0" + parameter(Pid.TOPIC_NAME, text("rt/über")) + SENTINEL)
    assert values.text(Pid.TOPIC_NAME, 100) == "rt/über"
