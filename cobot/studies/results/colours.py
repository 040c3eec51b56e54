"""Colours of maps: a scale from dark blue through green to yellow, and grey for places without a value."""

from __future__ import annotations

import numpy as np

from cobot.types import Array

SCALE = np.array([[59, 40, 110], [45, 105, 142], [33, 158, 137], [120, 205, 84], [250, 228, 45]], dtype=float)
"""Colours at even distances, RGB. Each colour is brighter than the previous one, so that the order is visible
even without colour.
"""
NOTHING = np.array([205, 208, 212])
"""Colour of places that are not reached."""


def colours_of(values: Array, low: float, high: float) -> np.ndarray:
    """The colours of values, uint8, shape (n, 3). A value that is not finite is treated as missing."""
    known = np.isfinite(values)
    share = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-12), 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(SCALE))
    mixed = np.column_stack([np.interp(share, places, SCALE[:, channel]) for channel in range(3)])
    return np.where(known[:, None], np.rint(mixed), NOTHING).astype(np.uint8)


def range_of(values: Array) -> tuple[float, float]:
    """The range of the finite values, for a colour scale. If no value is negative, the range begins at 0.
    Without any values, it is 0 to 1.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low = min(0.0, float(finite.min()))
    high = float(finite.max())
    return low, high if high > low else low + 1.0
