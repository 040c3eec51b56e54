"""Checked arrays of numbers. Every array from outside passes this check."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cobot.errors import InputError

Array = npt.NDArray[np.float64]


def vector(values: object, size: int | None = None, *, name: str = "vector") -> Array:
    """A read-only float64 copy of `values`, shape (size,).

    Raises:
        InputError: the values are not numeric, have another length, or are not finite.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as exc:
        raise InputError(f"{name} must be a list of numbers") from exc
    if array.ndim != 1 or (size is not None and array.shape[0] != size):
        raise InputError(f"{name} must have {size} numbers, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite, got {array.tolist()}")
    array.flags.writeable = False
    return array
