"""Inputs and outputs of the controller and the tool, and the speed slider, by name."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from cobot.robot.io_points import IoKind, IoPoint
from cobot.robot.sent_outputs import SentOutputs
from rtloop.backends import BackendError

log = logging.getLogger("cobot.rtloop")

ENFORCED_S = 1.0
"""Maximum time for which an output value is sent repeatedly until the controller reports it, s."""
SLIDER = "speed_slider"
DIGITAL = (("digital", 8, 0), ("configurable", 8, 8), ("tool", 2, 16))
"""Groups of digital points: name, number of points, and first bit in `actual_digital_input_bits` and
`actual_digital_output_bits`.
"""
MAX_VOLT = 10.0
MIN_AMPERE, MAX_AMPERE = 0.004, 0.02
_OUTPUT_DOMAIN = 2
"""Index of the first output's bit in `analog_io_types`. A bit is 0 for current and 1 for voltage."""
GROUPS: tuple[tuple[str, ...], ...] = (
    ("speed_slider_mask", "speed_slider_fraction"),
    ("standard_digital_output_mask", "standard_digital_output"),
    ("configurable_digital_output_mask", "configurable_digital_output"),
    ("tool_digital_output_mask", "tool_digital_output"),
    (
        "standard_analog_output_mask",
        "standard_analog_output_type",
        "standard_analog_output_0",
        "standard_analog_output_1",
    ),
)
"""Groups of RTDE variables that are set together."""
READ = (
    "actual_digital_input_bits",
    "actual_digital_output_bits",
    "analog_io_types",
    *(f"standard_analog_{way}{n}" for way in ("input", "output") for n in (0, 1)),
    *(f"tool_analog_input{n}" for n in (0, 1)),
)


def points(data: Mapping[str, Any]) -> list[IoPoint]:
    """List all points in a data package."""
    found = []
    for way, bits in (
        ("in", data["actual_digital_input_bits"]),
        ("out", data["actual_digital_output_bits"]),
    ):
        for name, count, first in DIGITAL:
            for index in range(count):
                value = float(bits >> first + index & 1)
                found.append(IoPoint(f"{name}_{way}_{index}", IoKind.BOOLEAN, way == "out", value))
    for variable, name in _ANALOG:
        if variable in data:
            found.append(IoPoint(name, IoKind.ANALOG, "out" in name, float(data[variable])))
    percent = round(100.0 * data["target_speed_fraction"])
    found.append(IoPoint(SLIDER, IoKind.DIGITAL, True, float(percent)))
    return found


_ANALOG = [
    *((f"standard_analog_{way}put{n}", f"analog_{way}_{n}") for way in ("in", "out") for n in (0, 1)),
    *((f"tool_analog_input{n}", f"tool_analog_in_{n}") for n in (0, 1)),
]


@dataclass(slots=True)
class _Wanted:
    """An output that is being set.

    Attributes:
        group: first variable of the output's group.
        values: values of the group's variables.
        point: the output with the value that the controller must report.
    """

    group: str
    values: dict[str, Any]
    point: IoPoint
    until_s: float
    is_sent: bool = False


class UrOutputs:
    """The outputs that must be set. Each value is enforced until the controller reports it.

    Attributes:
        problem: sentence about an output that was not set or was set late; "" if all outputs were set in
            time.
    """

    def __init__(self, send: Callable[[str, Mapping[str, Any]], bool]) -> None:
        """
        Args:
            send: function that sets the variables of a group, and returns whether they were sent.
        """
        self._send = send
        self._wanted: dict[str, _Wanted] = {}
        self._sent = SentOutputs(ENFORCED_S)
        self.problem = ""

    def set(self, data: Mapping[str, Any], name: str, value: float, now_s: float) -> None:
        """
        Raises:
            BackendError: there is no such output, or it cannot have this value.
        """
        known = {each.name: each for each in points(data)}
        point = known.get(name)
        if point is None or not point.is_output:
            raise BackendError(f"{name} is not an output of the controller")
        group, values = _request(point, value, data)
        wanted = IoPoint(name, point.kind, True, float(value))
        self._wanted[name] = _Wanted(group, values, wanted, now_s + ENFORCED_S)
        self._sent.add(name, float(value), now_s)
        self.problem = ""

    def follow(self, data: Mapping[str, Any], now_s: float) -> None:
        """Send waiting values, and release each output that has reached its value. Call it once per cycle.

        Only one output of a group is set at a time, because the second of two packages within one control
        period would replace the first.
        """
        if not self._sent and not self._wanted:
            return
        reported = {each.name: each for each in points(data)}
        values = {name: each.value for name, each in reported.items()}
        if problem := self._sent.explain(values, now_s):
            self.problem = problem
            log.warning("an output of the device: %s", problem)
        occupied = {each.group for each in self._wanted.values() if each.is_sent}
        for name, wanted in list(self._wanted.items()):
            if now_s > wanted.until_s or (wanted.is_sent and reported[name].has(wanted.point.value)):
                del self._wanted[name]
                self._release(wanted)
            elif not wanted.is_sent and wanted.group not in occupied:
                wanted.is_sent = self._send(wanted.group, wanted.values)
                occupied.add(wanted.group)

    def _release(self, wanted: _Wanted) -> None:
        """Release the output for other clients, because the controller applies the mask until it is
        cleared.
        """
        self._send(wanted.group, {**wanted.values, wanted.group: 0})


def _request(point: IoPoint, value: float, data: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    name = point.name
    if name == SLIDER:
        if not 0.0 <= value <= 100.0:
            raise BackendError(f"{SLIDER} is {value:g}, allowed: 0 to 100 (per cent)")
        return GROUPS[0][0], {GROUPS[0][0]: 1, GROUPS[0][1]: value / 100.0}
    place, index = name.rsplit("_", 2)[0], int(name[-1])
    if place == "analog":
        return GROUPS[4][0], _analog(name, index, value, data)
    mask, output = GROUPS[1 + [each[0] for each in DIGITAL].index(place)][:2]
    return mask, {mask: 1 << index, output: (1 << index) if value else 0}


def _analog(name: str, index: int, value: float, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the variables that set an analog output. The unit is V or A, depending on the output's current
    domain.
    """
    domain = data.get("analog_io_types", 0) >> _OUTPUT_DOMAIN + index & 1
    low, high, unit = (0.0, MAX_VOLT, "V") if domain else (MIN_AMPERE, MAX_AMPERE, "A")
    if not low <= value <= high:
        raise BackendError(f"{name} is {value:g} {unit}, allowed: {low:g} to {high:g} {unit}")
    mask, kind, *outputs = GROUPS[4]
    share = (value - low) / (high - low)
    return {mask: 1 << index, kind: domain << index, **dict.fromkeys(outputs, share)}
