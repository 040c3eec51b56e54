"""One row of the result table for each figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Row:
    """A figure and its tail, with the values that it is compared with.

    Attributes:
        columns: what the values are, where they are not p50, p99 and p99.9.
        ratio_of: which of the columns the ratio and the aim are about; "" for each of them.
    """

    name: str
    unit: str
    columns: tuple[str, ...]
    values: Sequence[float]
    against: str
    against_values: Sequence[float]
    ratio_of: str
    ratios: Sequence[float]
    aim: str

    def __str__(self) -> str:
        ours, theirs = (" / ".join(_short(v) for v in row) for row in (self.values, self.against_values))
        unit = self.unit if self.columns == PERCENTILES else " / ".join(self.columns)
        ratios = " / ".join(_short(ratio) for ratio in self.ratios)
        which = f" ({self.ratio_of})" if self.ratio_of else ""
        return f"| {self.name} | {unit} | {ours} | {self.against} | {theirs} | {ratios}{which} | {self.aim} |"


PERCENTILES = ("p50", "p99", "p99.9")
EACH = "each"
"""Of the columns, for a ratio."""
HEADER = (
    "| Figure | Unit or columns | p50 / p99 / p99.9 | Compared with | p50 / p99 / p99.9 | Ratio | Aim |\n"
    "|---|---|---|---|---|---|---|"
)


def percentiles(samples: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    """p50, p99, p99.9."""
    p50, p99, p999 = np.percentile(samples, (50.0, 99.0, 99.9))
    return float(p50), float(p99), float(p999)


def row(
    name: str,
    unit: str,
    values: Sequence[float],
    against: str,
    against_values: Sequence[float],
    *,
    columns: tuple[str, ...] = PERCENTILES,
    ratio_of: str = "",
    aim: str = "",
) -> Row:
    """A row whose ratio is cobot's value divided by the other value: in the named column, in every column for
    `EACH`, or in the first column without a name.
    """
    pairs = zip(values, against_values, strict=True)
    ratios = [ours / theirs if theirs else 1.0 if ours == theirs else math.inf for ours, theirs in pairs]
    if ratio_of == EACH:
        return Row(name, unit, columns, values, against, against_values, "", ratios, aim)
    ratio_of = ratio_of or columns[0]
    chosen = [ratios[columns.index(ratio_of)]]
    return Row(name, unit, columns, values, against, against_values, ratio_of, chosen, aim)


def _short(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"
