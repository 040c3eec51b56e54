"""Checks the sizes that a recording claims before a reader relies on them.

A chunk of an MCAP file states its decompressed size, and a reader allocates that much memory at once. The
same holds for the Zstandard frame in the chunk and for the length of each record. Source: "MCAP Format
Specification", Records and Chunk.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from typing import BinaryIO

from mcap.reader import SeekingReader
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import CONTENTSIZE_UNKNOWN, get_frame_parameters

MAX_CHUNK_BYTES = 64_000_000
"""Maximum uncompressed size of a chunk. The recorder writes chunks of about 1 MB."""
MEMORY_SHARE = 0.5
"""Maximum share of this computer's memory for all chunks of a file together, because the reader keeps their
content in memory.
"""
MAGIC_BYTES = 8
CHUNK = 0x06
COMPRESSIONS = ("", "zstd")
_RECORD = struct.Struct("<BQ")
_SIZES = struct.Struct("<QQQII")  # times of the first and last message, size, checksum, length of a name
_FRAME_HEADER = 18
"""Maximum size of the header of a Zstandard frame (RFC 8878), in bytes."""


def bounded_reader(file: BinaryIO) -> SeekingReader:
    """Return a reader for a file, after checking the sizes of its records and chunks, and the sum of all
    chunks.

    Raises:
        ValueError: a size exceeds its limit. The error names the location, the claimed size and the limit.
    """
    size = file.seek(0, os.SEEK_END)
    require_room("the chunks of the file", sum(_require_chunk(file, *each) for each in _records(file, size)))
    file.seek(0)
    reader = SeekingReader(file, validate_crcs=True, record_size_limit=MAX_CHUNK_BYTES)
    summary = reader.get_summary()
    for index in summary.chunk_indexes if summary is not None else ():
        _require_chunk(file, index.chunk_start_offset, _length_at(file, index.chunk_start_offset, size))
    file.seek(0)
    return reader


def bounded_records(file: BinaryIO) -> Iterator[McapRecord]:
    """The records in a file, up to its end. The file may be truncated.

    Raises:
        ValueError, McapError, ZstdError, struct.error: the file is truncated, or a chunk claims too large a
            size.
    """
    for record in StreamReader(file, emit_chunks=True, record_size_limit=MAX_CHUNK_BYTES).records:
        if isinstance(record, Chunk):
            _require_claims(record.compression, record.uncompressed_size, record.data[:_FRAME_HEADER])
            yield from breakup_chunk(record, validate_crc=True)
        else:
            yield record


def require_room(what: str, size: int) -> None:
    """Check that a size fits into memory.

    Raises:
        ValueError: the size exceeds the limit; the error names both.
    """
    limit = int(MEMORY_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    if size > limit:
        raise ValueError(f"{what} claim {size} bytes uncompressed, but only {limit} fit into memory here")


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, int]]:
    """The position and the length of each chunk in the file."""
    at = MAGIC_BYTES
    while at + _RECORD.size <= size - MAGIC_BYTES:
        length = _length_at(file, at, size)
        file.seek(at)
        if file.read(1)[0] == CHUNK:
            yield at, length
        at += _RECORD.size + length


def _length_at(file: BinaryIO, at: int, size: int) -> int:
    """The length of the record at a position."""
    file.seek(min(at, size))
    head = file.read(_RECORD.size)
    if len(head) < _RECORD.size:
        raise ValueError(f"the index has a chunk at byte {at}, but the file has only {size} bytes")
    length: int = _RECORD.unpack(head)[1]
    left = size - at - _RECORD.size
    if length > left:
        raise ValueError(
            f"the record at byte {at} claims {length} bytes, but only {left} are left in the file"
        )
    return length


def _require_chunk(file: BinaryIO, at: int, length: int) -> int:
    """Check a chunk and return the size that it claims."""
    file.seek(at + _RECORD.size)
    head = file.read(min(length, _SIZES.size))
    if len(head) < _SIZES.size:
        raise ValueError(f"the chunk at byte {at} has {length} bytes, but its sizes alone have {_SIZES.size}")
    _, _, claimed, _, name_bytes = _SIZES.unpack(head)
    compression = file.read(min(name_bytes, length)).decode("utf-8", "replace")
    file.read(8)  # skips the length of the compressed messages
    return _require_claims(compression, claimed, file.read(_FRAME_HEADER), f" at byte {at}")


def _require_claims(compression: str, claimed: int, frame: bytes, place: str = "") -> int:
    """The size that a chunk claims.

    Args:
        frame: first bytes of the compressed data.
    """
    if compression not in COMPRESSIONS:
        raise ValueError(f"the chunk{place} is compressed with {compression[:20]!r}; only zstd is supported")
    if compression and frame:
        claimed = max(claimed, _frame_claim(frame))
    if claimed > MAX_CHUNK_BYTES:
        raise ValueError(f"the chunk{place} claims {claimed} bytes uncompressed, allowed: {MAX_CHUNK_BYTES}")
    return claimed


def _frame_claim(frame: bytes) -> int:
    """The content size that a Zstandard frame states; 0 if it states none."""
    content = get_frame_parameters(frame).content_size
    return 0 if content == CONTENTSIZE_UNKNOWN else content
