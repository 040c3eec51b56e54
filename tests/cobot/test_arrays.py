"""Addresses for compiled code. Oracle: numpy's and ctypes' own idea of where the memory is."""

from __future__ import annotations

import ctypes
import sys
from typing import Any

import numpy as np
import pytest

from cobot.arrays import address_of_bytes, address_of_doubles


@pytest.mark.parametrize("array", [np.zeros(7), np.zeros((6, 7)), np.arange(10.0)[3:]])
def test_the_address_of_an_array_is_its_first_number(array: np.ndarray) -> None:
    assert address_of_doubles(array, array.size) == array.ctypes.data


def test_an_array_may_be_longer_than_needed() -> None:
    array = np.zeros(9)
    assert address_of_doubles(array, 7) == array.ctypes.data


def test_the_buffer_is_released_at_once() -> None:
    array, buffer = np.zeros(7), bytearray(8)
    before = sys.getrefcount(array)
    address_of_doubles(array, 7)
    address_of_bytes(buffer, 8)
    assert sys.getrefcount(array) == before
    buffer.append(1)  # refused as long as the buffer is exported


@pytest.mark.parametrize(
    ("array", "error", "words"),
    [
        (np.zeros(6), ValueError, "at least 7 numbers are needed, not 6"),
        (np.zeros(0), ValueError, "at least 7 numbers are needed, not 0"),
        (np.zeros(7, dtype=np.float32), TypeError, "float64 is needed, not one of float32"),
        (np.zeros(7, dtype=np.int64), TypeError, "float64 is needed, not one of int64"),
        (np.zeros(7, dtype=">f8"), TypeError, "float64 is needed, not one of >f8"),
        (np.zeros(7, dtype=complex), TypeError, "float64 is needed, not one of complex128"),
        (np.zeros(14)[::2], ValueError, "contiguous"),
        (np.zeros((7, 7)).T, ValueError, "contiguous"),
        (bytearray(56), TypeError, "float64 is needed, not one of B"),
        ([0.0] * 7, TypeError, "an array or a buffer is needed, not list"),
        (None, TypeError, "an array or a buffer is needed, not NoneType"),
    ],
)
def test_another_array_is_refused(array: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        address_of_doubles(array, 7)


def test_a_read_only_array_is_refused() -> None:
    array = np.zeros(7)
    array.flags.writeable = False
    with pytest.raises(ValueError, match="writable"):
        address_of_doubles(array, 7)
    with pytest.raises(ValueError, match="writable"):
        address_of_bytes(b"12345678", 8)


def test_numbers_that_are_not_aligned_are_refused() -> None:
    with pytest.raises((TypeError, ValueError), match=r"float64|aligned"):
        address_of_doubles(np.frombuffer(bytearray(57), dtype=np.float64, offset=1, count=7), 7)


def test_the_address_of_a_buffer_is_its_first_byte() -> None:
    buffer = bytearray(b"12345678")
    assert ctypes.string_at(address_of_bytes(buffer, 8), 8) == bytes(buffer)
    view = memoryview(buffer)[3:]
    assert address_of_bytes(view, 5) == address_of_bytes(buffer, 8) + 3


def test_a_buffer_that_is_too_short_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 8 bytes are needed, not 7"):
        address_of_bytes(bytearray(7), 8)
