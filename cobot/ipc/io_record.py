"""Records of inputs and outputs in shared memory: the device's report, and the requested value of an
output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.ipc.layout import IO_NAME_BYTES, IO_POINTS, text
from cobot.robot.io_points import IoKind, IoPoint

KINDS = tuple(IoKind)


@dataclass(frozen=True, slots=True)
class IoReport:
    """A report of inputs and outputs.

    Attributes:
        number: number of the report. It increases with each report.
    """

    number: int
    points: tuple[IoPoint, ...]


def fill_points(record: np.ndarray, points: Sequence[IoPoint]) -> list[str]:
    """Write points into a record of `cobot.ipc.layout.IO`. Returns the names of the points that do not
    fit.
    """
    kept = [each for each in points if len(each.name.encode()) <= IO_NAME_BYTES][:IO_POINTS]
    count = record["count"] = len(kept)
    record["names"][:count] = [each.name.encode() for each in kept]
    record["kinds"][:count] = [KINDS.index(each.kind) for each in kept]
    record["outputs"][:count] = [each.is_output for each in kept]
    record["values"][:count] = [each.value for each in kept]
    return [each.name for each in points if each not in kept] if len(kept) < len(points) else []


def report_of(record: np.ndarray) -> IoReport:
    """Read a record of `cobot.ipc.layout.IO`.

    Raises:
        ValueError: the record is invalid.
    """
    count = int(record["count"])
    kinds = record["kinds"][:count]
    if count > IO_POINTS or (kinds >= len(KINDS)).any():
        raise ValueError(f"a record of {count} inputs and outputs with the kinds {kinds.tolist()} is invalid")
    rows = zip(*(record[name][:count] for name in ("names", "kinds", "outputs", "values")), strict=True)
    points = tuple(
        IoPoint(text(name), KINDS[kind], bool(output), float(value)) for name, kind, output, value in rows
    )
    return IoReport(int(record["number"]), points)
