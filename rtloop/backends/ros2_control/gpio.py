"""Inputs and outputs of a driver, under the names in the settings."""

from __future__ import annotations

import math

from cobot.robot.io_points import IoKind, IoPoint
from cobot.ros.driver_io import MAX_AGE_S
from rtloop.backends.protocols import BackendError
from rtloop.backends.ros2_control.link import Facts
from rtloop.backends.ros2_control.options import Ros2ControlOptions


class GpioPoints:
    """The inputs and outputs that the options define."""

    def __init__(self, options: Ros2ControlOptions) -> None:
        self._options = options

    @property
    def exist(self) -> bool:
        return bool(self._options.inputs or self._options.outputs)

    def points(self, facts: Facts) -> list[IoPoint]:
        """Return all points with their last values. A value is NaN while the controller does not report
        it.
        """
        is_old = facts.gpio_age_s is None or facts.gpio_age_s > MAX_AGE_S
        named = {name: (place, False) for name, place in self._options.inputs.items()}
        named |= {name: (place, True) for name, place in self._options.outputs.items()}
        return [
            IoPoint(
                name, self._kind(name), is_output, math.nan if is_old else facts.gpio.get(place, math.nan)
            )
            for name, (place, is_output) in named.items()
        ]

    def place_of(self, name: str) -> str:
        """Return the interface of an output.

        Raises:
            BackendError: there is no such output.
        """
        if name not in self._options.outputs:
            known = ", ".join(self._options.outputs) or "none"
            raise BackendError(f"{name} is not an output; robot.backend.outputs has: {known}")
        return self._options.outputs[name]

    def _kind(self, name: str) -> IoKind:
        return IoKind.ANALOG if name in self._options.analog else IoKind.BOOLEAN
