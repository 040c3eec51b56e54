"""How far runs of one scenario that differ by nothing but rounding come apart.

What the safety layer pursues and Ruckig plans anew magnifies rounding, the more the longer a scenario lasts:
in some to 1e-4 rad. So a trace is recorded together with runs on other BLAS kernels and from starts some
1e-13 rad aside, and has in each row the largest difference so far between them, its spread. A later run is
compared to `ATOL`, or to `FACTOR` times that spread where it is more.
"""

from __future__ import annotations

import numpy as np

from cobot.types import Array

FACTOR = 20.0
ATOL = 1e-9
"""rad, rad/s, rad/s², s"""
EFFORT_ATOL = 1e-6
"""N·m and N"""
MODE_ROWS = 5
"""When an arm comes to rest may depend on rounding, too: so near to that no modes are compared."""
GRAIN = 2.0**-36
"""What is recorded is rounded to this, 1.5e-11 in its unit: fewer bits, far below what is compared."""
Traces = dict[str, np.ndarray]


def names(traces: Traces) -> list[str]:
    return list(dict.fromkeys(key.split("/")[0] for key in traces))


def with_spread(runs: list[Traces]) -> Traces:
    """The first run, with its spread among them all.

    Raises:
        ValueError: a scenario's words or length depend on rounding; it has to be another one.
    """
    found = dict(runs[0])
    for name in names(found):
        for what in ("words", "cycles"):
            values = [run[f"{name}/{what}"] for run in runs]
            if not all(np.array_equal(values[0], value) for value in values):
                raise ValueError(f"{name}: its {what} depend on rounding")
        for what in ("commands", "path_times", "measured"):
            found[f"{name}/{what}"] = np.round(found[f"{name}/{what}"] / GRAIN) * GRAIN
            found[f"{name}/{what}_spread"] = _spread([run[f"{name}/{what}"] for run in runs])
        modes = np.array([run[f"{name}/modes"] for run in runs])
        unsure = (modes != modes[0]).any(axis=0)
        rows = np.arange(len(unsure))
        near = np.abs(rows[:, None] - np.flatnonzero(unsure)) <= MODE_ROWS
        found[f"{name}/modes_sure"] = ~near.any(axis=1)
        counts = np.array([run[f"{name}/counts"] for run in runs])
        found[f"{name}/counts_sure"] = (counts == counts[0]).all(axis=0)
    return found


def _spread(values: list[Array]) -> np.ndarray:
    """The largest difference up to each row, shape (n,) or, of commands, (n, 3)."""
    all_of_them = np.array(values)
    apart = np.ptp(all_of_them, axis=0)
    if apart.ndim > 1:
        apart = apart.max(axis=-1)
    return np.maximum.accumulate(apart, axis=0).astype(np.float32)


def tolerance(spread: np.ndarray, least: float) -> Array:
    """What a later run may differ by."""
    return np.maximum(least, FACTOR * spread.astype(np.float64))
