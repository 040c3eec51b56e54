"""Chunks. Oracle: NumPy's own reading of NPZ; hypothesis's arrays."""

from __future__ import annotations

import io

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from cobot.errors import InputError
from cobot.studies.chunks import as_columns, failures, from_bytes, has_result, joined, to_bytes

DTYPES = some.sampled_from([np.dtype(each) for each in ("f8", "f4", "i4", "i8", "bool", "<U5")])


@given(
    some.dictionaries(
        some.from_regex("[a-z]{1,4}", fullmatch=True), DTYPES.flatmap(lambda d: arrays.arrays(d, 4))
    )
)
def test_columns_survive_and_have_one_form(columns: dict[str, np.ndarray]) -> None:
    whole = as_columns(columns, 4)
    content = to_bytes(whole)
    assert to_bytes(from_bytes(content)) == content == to_bytes(dict(reversed(whole.items())))
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        assert sorted(file.files) == sorted(columns)
        for name in columns:
            np.testing.assert_array_equal(file[name], columns[name])


@pytest.mark.parametrize("values", [[1, 2], [[1], [2], [3]], [1j, 2, 3], [None, 1, 2]])
def test_other_values_are_no_results(values: list[object]) -> None:
    with pytest.raises(InputError, match="result 'a': "):
        as_columns({"a": np.array(values)}, 3)


def test_parts_with_other_columns_are_joined() -> None:
    parts = [
        as_columns({"a": [1.5, 2.5], "b": [True, False]}, 2),
        failures(1, "no"),
        as_columns({"a": [3.0]}, 1),
    ]
    whole = joined(parts)
    np.testing.assert_array_equal(whole["a"], [1.5, 2.5, np.nan, 3.0])
    assert whole["b"].tolist() == [True, False, False, False]
    assert has_result(whole).tolist() == [True, True, False, True]
