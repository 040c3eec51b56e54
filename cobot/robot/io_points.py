"""The inputs and outputs of a device, by name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from cobot.errors import InputError, LimitError, NotFoundError
from cobot.foreign import bounded, plain_text
from cobot.strict import shown

MAX_DIGITAL = 2**53 - 1
"""Maximum value of a digital input or output. Up to this value, a double represents every integer exactly."""
ANALOG_SHARE = 1e-3
"""Tolerance for the value that a device reports for an analog output, because converters are inexact."""


MAX_POINTS = 1000
"""Maximum number of points in a device's report. The service publishes fewer."""
MAX_POINT_NAME = 1000
"""Maximum number of characters of a name in a device's report. The service publishes a shorter name."""


class IoKind(StrEnum):
    BOOLEAN = "boolean"
    DIGITAL = "digital"  # a whole number from 0 to `MAX_DIGITAL`
    ANALOG = "analog"


@dataclass(frozen=True, slots=True)
class IoPoint:
    """An input or output, with the value that the device reports. The value of a boolean is 0.0 or 1.0."""

    name: str
    kind: IoKind
    is_output: bool
    value: float

    @property
    def shown(self) -> bool | int | float | None:
        """The value in the type that belongs to the point's kind. None if the device reports an invalid
        number.
        """
        if not math.isfinite(self.value):
            return None
        if self.kind is IoKind.BOOLEAN:
            return bool(self.value)
        return int(self.value) if self.kind is IoKind.DIGITAL else self.value

    @property
    def direction(self) -> str:
        return "output" if self.is_output else "input"

    def has(self, number: float) -> bool:
        """Whether the device reports the value `number`."""
        if self.kind is IoKind.ANALOG:
            return math.isclose(self.value, number, rel_tol=ANALOG_SHARE, abs_tol=ANALOG_SHARE)
        return self.value == number


def io_points(reported: Iterable[object]) -> tuple[IoPoint, ...]:
    """Check a device's report, which may contain anything.

    Raises:
        InputError: the report contains too many points, an object of the wrong type, or a name that is not
            printable.
    """
    points = bounded(reported, MAX_POINTS, "inputs and outputs")
    for point in points:
        if not isinstance(point, IoPoint):
            raise InputError(
                f"the inputs and outputs contain a {plain_text(type(point), 80)}; all must be IoPoint"
            )
        name = point.name
        if type(name) is not str or not 0 < len(name) <= MAX_POINT_NAME or not name.isprintable():
            raise InputError(
                f"the name of an input or output is '{plain_text(name, 80)}'; it must be a string of 1 to "
                f"{MAX_POINT_NAME} printable characters"
            )
    return points


def output_of(points: Sequence[IoPoint], name: str) -> IoPoint:
    """The output with this name.

    Raises:
        NotFoundError: there is no point with this name; the message lists the outputs.
        InputError: the point is an input.
    """
    point = next((each for each in points if each.name == name), None)
    if point is None:
        known = ", ".join(each.name for each in points if each.is_output) or "none"
        raise NotFoundError(f"there is no output {shown(name)}; the device's outputs are: {known}")
    if not point.is_output:
        raise InputError(f"{name} is an input, which only the device sets; name an output")
    return point


def number_of(point: IoPoint, value: float) -> float:
    """Convert a value for an output into a number.

    Raises:
        InputError: the value does not match the output's kind.
        LimitError: the value is out of range.
    """
    if point.kind is IoKind.BOOLEAN:
        if not isinstance(value, bool):
            raise InputError(f"{point.name} is boolean: the value must be true or false, got {shown(value)}")
    elif isinstance(value, bool):
        raise InputError(f"{point.name} is {point.kind}: the value must be a number, got {shown(value)}")
    elif point.kind is IoKind.DIGITAL and not isinstance(value, int):
        raise InputError(f"{point.name} is digital: the value must be a whole number, got {shown(value)}")
    try:
        number = float(value)
    except OverflowError as exc:
        raise LimitError(f"{point.name}: the value has too many digits") from exc
    require_number(point, number)
    return number


def require_number(point: IoPoint, number: float) -> None:
    """Check that an output can have this value.

    Raises:
        LimitError: the value is out of range.
    """
    if point.kind is IoKind.BOOLEAN and number not in (0, 1):
        raise LimitError(f"{point.name} is boolean: the value must be 0 or 1, got {number:g}")
    if point.kind is IoKind.DIGITAL and not (0 <= number <= MAX_DIGITAL and number == int(number)):
        raise LimitError(
            f"{point.name} is digital: the value must be a whole number from 0 to {MAX_DIGITAL}, got "
            f"{number:g}"
        )
    if not math.isfinite(number):
        raise LimitError(f"{point.name}: the value is not finite")
