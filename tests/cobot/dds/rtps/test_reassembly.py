"""Samples in fragments. Oracle: the sample itself, cut by hand and sent in random order, twice, in groups."""

from __future__ import annotations

import inspect
import random
from typing import Any

import pytest

from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.reassembly import MAX_FRAGMENTS, SampleAssembly
from cobot.dds.rtps.submessages import DataFragment

SEED = 20261122


def fragment(first: int, count: int, size: int, total: int) -> DataFragment:
    """Only what the assembly looks at; the rest is empty."""
    told: dict[str, Any] = {"first": first, "count": count, "size": size, "total": total}
    names = inspect.signature(DataFragment).parameters
    return DataFragment(**{name: told.get(name) for name in names})


def test_a_sample_is_whole_when_all_its_fragments_are_there_and_not_before() -> None:
    dice = random.Random(SEED)
    for _ in range(300):
        size, sample = dice.randrange(1, 9), dice.randbytes(dice.randrange(1, 60))
        count = -(-len(sample) // size)
        assembly = SampleAssembly(fragment(1, 1, size, len(sample)), None)
        assert (assembly.count, assembly.total) == (count, len(sample))
        there: set[int] = set()
        while len(there) < count:
            first = dice.randrange(1, count + 1)
            group = dice.randrange(1, count - first + 2)
            part = sample[(first - 1) * size : (first + group - 1) * size]
            there |= set(range(first, first + group))
            whole = assembly.add(fragment(first, group, size, len(sample)), memoryview(part))
            assert whole == (len(there) == count)
            if not whole:
                missing = [number for number in range(1, count + 1) if number not in there]
                assert assembly.missing(count) == missing
        assert assembly.payload() == sample


@pytest.mark.parametrize(
    ("first", "count", "size", "total", "sentence"),
    [
        (1, 1, 5, 20, "a fragment belongs to another sample"),
        (1, 1, 4, 21, "a fragment belongs to another sample"),
        (0, 1, 4, 20, "fragments 0 to 0, but the sample has 5"),
        (5, 2, 4, 20, "fragments 5 to 6, but the sample has 5"),
        (1, 0, 4, 20, "fragments 1 to 0, but the sample has 5"),
        (1, 2, 4, 20, "the fragments need 8 bytes, but 4 have arrived"),
    ],
)
def test_fragments_that_do_not_fit_are_malformed(
    first: int, count: int, size: int, total: int, sentence: str
) -> None:
    assembly = SampleAssembly(fragment(1, 1, 4, 20), None)
    with pytest.raises(MalformedError, match=sentence):
        assembly.add(fragment(first, count, size, total), memoryview(b"abcd"))


@pytest.mark.parametrize(
    ("size", "total", "sentence"),
    [
        (0, 20, "a fragment of an empty sample"),
        (4, 0, "a fragment of an empty sample"),
        (1, MAX_FRAGMENTS + 1, "fragments, allowed:"),
    ],
)
def test_what_cannot_be_a_sample_is_malformed(size: int, total: int, sentence: str) -> None:
    with pytest.raises(MalformedError, match=sentence):
        SampleAssembly(fragment(1, 1, size, total), None)
