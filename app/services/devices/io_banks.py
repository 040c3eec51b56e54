"""Simulated digital and analog inputs and outputs. Each has the value that a client wrote last."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.errors import InputError, LimitError, NotSupportedError

DIGITAL = {"standard": 16, "tool": 4, "configurable": 8}
"""Number of inputs, and also of outputs, in each group. They are numbered from 0."""
ANALOG = {"standard": 4, "tool": 2}
RANGES = ((0.004, 0.020, "A"), (0.0, 10.0, "V"))
"""Range and unit of an analog input or output, by domain. Domain 0 is current, domain 1 is voltage."""


@dataclass(slots=True)
class Analog:
    """An analog input or output. Its domain states whether the value is in V or A."""

    domain: int = 1
    value: float = 0.0


class IoBanks:
    """All inputs and outputs, by direction ("input" or "output") and group.

    Args:
        simulated: whether the arm is simulated. The inputs and outputs of a real controller are not
            accessible.
    """

    def __init__(self, *, simulated: bool) -> None:
        self._simulated = simulated
        directions = ("input", "output")
        self._digital = {(way, group): [False] * n for way in directions for group, n in DIGITAL.items()}
        self._analog = {
            (way, group): [Analog() for _ in range(n)] for way in directions for group, n in ANALOG.items()
        }

    def digital(self, way: str, group: str) -> list[bool]:
        """Return the values of a group.

        Raises:
            NotSupportedError: the arm is not simulated.
        """
        self._require_simulation()
        return self._digital[way, group]

    def digital_value(self, way: str, group: str, index: int) -> bool:
        """Return the value of one input or output.

        Raises:
            InputError: there is no such index.
        """
        places = self.digital(way, group)
        return places[_checked(index, len(places))]

    def set_digital(self, way: str, group: str, index: int, value: bool) -> None:
        """Set a digital input or output. Inputs can be set because the surroundings are simulated too.

        Raises:
            InputError: there is no such index.
        """
        places = self.digital(way, group)
        places[_checked(index, len(places))] = value

    def mask(self, way: str, group: str) -> int:
        """Return the values of a group as bits. Index 0 is the lowest bit."""
        return sum(1 << index for index, value in enumerate(self.digital(way, group)) if value)

    def analog(self, way: str, group: str, index: int) -> Analog:
        """Return an analog input or output, with its domain.

        Raises:
            InputError: there is no such index.
        """
        self._require_simulation()
        places = self._analog[way, group]
        return places[_checked(index, len(places))]

    def set_analog(self, way: str, group: str, index: int, value: float) -> None:
        """Set an analog input or output, V or A.

        Raises:
            InputError: there is no such index.
            LimitError: the value is outside the range of the domain.
        """
        place = self.analog(way, group, index)
        least, most, unit = RANGES[place.domain]
        if not least <= value <= most:
            raise LimitError(
                f"{group} analog {way} {index} must be from {least:g} to {most:g} {unit}, got {value:g}"
            )
        place.value = value

    def set_domain(self, way: str, group: str, index: int, domain: int) -> None:
        """Set the domain: 0 for current, 1 for voltage. The value becomes the minimum of the range.

        Raises:
            InputError: there is no such index or domain.
        """
        place = self.analog(way, group, index)
        if domain not in range(len(RANGES)):
            raise InputError(f"domain must be 0 (current, A) or 1 (voltage, V), got {domain}")
        place.domain, place.value = domain, RANGES[domain][0]

    def _require_simulation(self) -> None:
        if not self._simulated:
            raise NotSupportedError("these inputs and outputs exist only in simulation, and this arm is real")


def _checked(index: int, count: int) -> int:
    if not 0 <= index < count:
        raise InputError(f"index must be from 0 to {count - 1}, got {index}")
    return index
