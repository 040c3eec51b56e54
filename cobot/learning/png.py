"""Reads PNG files that `cobot.robot.geometry.rays.png` writes: eight bits, RGB, no filter, not interlaced."""

from __future__ import annotations

import struct
import zlib

import numpy as np

MAX_BYTES = 100_000_000
"""Maximum size of the pixels of a picture, in bytes."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"


def pixels_of_png(content: bytes) -> np.ndarray:
    """The pixels of a PNG file, uint8, shape (height, width, 3).

    Raises:
        ValueError: the file is damaged, or is a different kind of PNG.
    """
    if not content.startswith(SIGNATURE):
        raise ValueError("a picture in it is not a PNG")
    place, head, data = len(SIGNATURE), b"", bytearray()
    while place + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, place)
        kind, body = content[place + 4 : place + 8], content[place + 8 : place + 8 + length]
        if content[place + 8 + length : place + 12 + length] != struct.pack(">I", zlib.crc32(kind + body)):
            raise ValueError("a picture in it is damaged")
        head = body if kind == b"IHDR" else head
        data += body if kind == b"IDAT" else b""
        place += 12 + length
    if len(head) != 13:
        raise ValueError("a picture in it is damaged")
    width, height, *form = struct.unpack(">IIBBBBB", head)
    if form != [8, 2, 0, 0, 0]:
        raise ValueError("a picture in it is not 8 bits of RGB")
    size = height * (1 + 3 * width)
    if not 0 < size <= MAX_BYTES:
        raise ValueError(
            f"a picture in it claims {width} x {height} pixels, which are {size} bytes; at most {MAX_BYTES} "
            "are allowed"
        )
    try:
        content = zlib.decompressobj().decompress(data, size + 1)
    except zlib.error as exc:
        raise ValueError("a picture in it is damaged") from exc
    if len(content) != size:
        raise ValueError("a picture in it is damaged")
    rows = np.frombuffer(content, np.uint8).reshape(height, 1 + 3 * width)
    if rows[:, 0].any():
        raise ValueError("a picture in it has filtered rows")
    return rows[:, 1:].reshape(height, width, 3)
