"""Recordings that claim more than they have. Oracle: the sizes that the test itself has written into them."""

from __future__ import annotations

import io
import struct
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from mcap.records import Message
from mcap.writer import CompressionType, Writer

from cobot.errors import InputError
from cobot.recording import bounds
from cobot.recording.bounds import CHUNK, MAX_CHUNK_BYTES, bounded_reader, bounded_records
from cobot.recording.reader import read_recording

HEAD = struct.Struct("<BQ")
CLAIM = 4_000_000_000


def recording(compression: CompressionType = CompressionType.ZSTD) -> bytearray:
    file = io.BytesIO()
    writer = Writer(file, compression=compression)
    writer.start()
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channel = writer.register_channel("/t", "json", schema)
    writer.add_message(channel, 1, b"{}" * 100, 1)
    writer.finish()
    return bytearray(file.getvalue())


def chunk_at(content: bytes) -> int:
    at = 8
    while content[at] != CHUNK:
        at += HEAD.size + HEAD.unpack_from(content, at)[1]
    return at


def refusal(content: bytes) -> str:
    """Why it is not read; no more memory than a few megabytes is taken for that."""
    tracemalloc.start()
    try:
        with pytest.raises(ValueError) as caught:  # noqa: PT011  the text is the test's matter
            bounded_reader(io.BytesIO(content))
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
    return str(caught.value)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD])
def test_a_whole_recording_is_read(compression: CompressionType) -> None:
    messages = list(bounded_reader(io.BytesIO(recording(compression))).iter_messages())
    assert [message.data for _, _, message in messages] == [b"{}" * 100]


def test_a_chunk_that_claims_gigabytes_is_named_with_its_place() -> None:
    content = recording()
    at = chunk_at(content)
    struct.pack_into("<Q", content, at + HEAD.size + 16, CLAIM)
    assert refusal(content) == (
        f"the chunk at byte {at} claims {CLAIM} bytes uncompressed, allowed: {MAX_CHUNK_BYTES}"
    )


def test_a_frame_in_a_chunk_that_claims_gigabytes_is_named() -> None:
    """The chunk states few bytes, the header of its frame states many (RFC 8878: eight bytes of size)."""
    content = recording()
    at = chunk_at(content)
    frame = content.index(b"\x28\xb5\x2f\xfd", at)
    content[frame : frame + 13] = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", CLAIM)
    assert zstandard.get_frame_parameters(bytes(content[frame : frame + 18])).content_size == CLAIM
    assert f"claims {CLAIM} bytes uncompressed" in refusal(content)


def test_a_record_that_claims_more_than_the_file_has_is_named() -> None:
    content = recording()
    at = chunk_at(content)
    struct.pack_into("<Q", content, at + 1, CLAIM)
    assert f"the record at byte {at} claims {CLAIM} bytes, " in refusal(content)


def test_a_compression_that_is_not_cobots_is_named() -> None:
    content = recording()
    name = content.index(b"zstd", chunk_at(content))
    content[name : name + 4] = b"lz4\x1b"
    assert r"is compressed with 'lz4\x1b'; only zstd is supported" in refusal(content)


def test_the_reader_of_recordings_says_so_in_its_own_error(tmp_path: Path) -> None:
    content = recording()
    struct.pack_into("<Q", content, chunk_at(content) + HEAD.size + 16, CLAIM)
    path = tmp_path / "bomb.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"bomb.mcap: .* claims {CLAIM} bytes uncompressed"):
        read_recording(path)


def test_chunks_that_are_small_alone_are_bounded_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a computer of which half of the memory holds one chunk of the file, not two."""
    content = recording()
    at = chunk_at(content)
    end = at + HEAD.size + HEAD.unpack_from(content, at)[1]
    size = struct.unpack_from("<Q", content, at + HEAD.size + 16)[0]
    monkeypatch.setattr(bounds.os, "sysconf", {"SC_PAGE_SIZE": 1, "SC_PHYS_PAGES": 3 * size}.__getitem__)
    bounded_reader(io.BytesIO(content))
    twice = content[:end] + content[at:end] + content[end:]
    assert refusal(twice) == (
        f"the chunks of the file claim {2 * size} bytes uncompressed, but only {3 * size // 2} fit into "
        "memory here"
    )


@pytest.mark.parametrize("inside", [False, True])
def test_what_a_killed_recorder_left_is_read_until_a_chunk_claims_gigabytes(*, inside: bool) -> None:
    """The chunk's own claim, or that of the frame of Zstandard in it."""
    content = recording()
    at = chunk_at(content)
    assert [each.data for each in bounded_records(io.BytesIO(content)) if isinstance(each, Message)] == [
        b"{}" * 100
    ]
    if inside:
        frame = content.index(b"\x28\xb5\x2f\xfd", at)
        content[frame : frame + 13] = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", CLAIM)
    else:
        struct.pack_into("<Q", content, at + HEAD.size + 16, CLAIM)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=f"claims {CLAIM} bytes uncompressed"):
            list(bounded_records(io.BytesIO(content)))
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()
