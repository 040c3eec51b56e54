"""The cache of arrays. Oracle: the bytes of the arrays."""

from __future__ import annotations

import numpy as np

from cobot.robot.kept_arrays import KeptArrays
from cobot.types import Array


def test_arrays_are_kept_up_to_a_number_of_bytes_whatever_their_number() -> None:
    kept, made = KeptArrays(8000), []

    def get(name: str, numbers: int) -> Array:
        def make() -> Array:
            made.append(name)
            return np.zeros(numbers)

        return kept.get(name, make)

    for name in "abcdefgh":
        get(name, 100)
    assert get("a", 100) is get("a", 100)
    get("large", 500)  # b, c and d have not been used for the longest time
    for name in "aefgh":
        get(name, 100)
    assert "".join(made) == "abcdefghlarge"
    for name in "bcd":
        get(name, 100)
    assert "".join(made) == "abcdefghlargebcd"


def test_the_newest_array_is_kept_even_if_it_is_too_large() -> None:
    kept = KeptArrays(8)
    first = kept.get("first", lambda: np.zeros(100))
    assert kept.get("first", lambda: np.zeros(0)) is first
    kept.get("second", lambda: np.zeros(100))
    assert kept.get("first", lambda: np.zeros(3)).shape == (3,)
