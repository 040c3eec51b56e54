"""One row of the result table for each figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Row:
    """A figure, its tail, and the same of what it is compared with.

    Attributes:
        ratio_of: which of the columns the ratio and the aim are about.
    """

    name: str
    unit: str
    values: tuple[float, float, float]  # p50, p99, p99.9
    against: str
    against_values: tuple[float, float, float]
    ratio_of: str
    ratio: float
    aim: str

    def __str__(self) -> str:
        ours, theirs = (" / ".join(_short(v) for v in row) for row in (self.values, self.against_values))
        return (
            f"| {self.name} | {self.unit} | {ours} | {self.against} | {theirs} "
            f"| {self.ratio:.2f} ({self.ratio_of}) | {self.aim} |"
        )


HEADER = (
    "| Figure | Unit | p50 / p99 / p99.9 | Compared with | p50 / p99 / p99.9 | Ratio | Aim |\n"
    "|---|---|---|---|---|---|---|"
)
COLUMNS = {"p50": 0, "p99": 1, "p99.9": 2}


def percentiles(samples: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    """p50, p99, p99.9."""
    p50, p99, p999 = np.percentile(samples, (50.0, 99.0, 99.9))
    return float(p50), float(p99), float(p999)


def row(
    name: str,
    unit: str,
    values: tuple[float, float, float],
    against: str,
    against_values: tuple[float, float, float],
    *,
    ratio_of: str = "p50",
    aim: str = "",
) -> Row:
    """A row whose ratio is ours by theirs, in the named column."""
    column = COLUMNS[ratio_of]
    ratio = values[column] / against_values[column]
    return Row(name, unit, values, against, against_values, ratio_of, ratio, aim)


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
