"""Descriptions of the device that connects the control cycle to an arm: its capabilities and its status."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType

from cobot.ipc.state_fields import MEASURED_NAMES

DEFAULT_MEASURED = frozenset(
    ("position", "velocity", "effort", "desired_effort", "external_effort", "wrench")
)
"""Quantities that a device measures if its capabilities do not list any. A new quantity must not be added
here, because existing backends would then claim to measure it.
"""
LESS = "the device permits less than the model"
"""Beginning of messages about device limits that are lower than those of the model."""
ANY_PERIOD: tuple[float, ...] = ()
FLAGS = ("impedance", "torque", "wrench", "freedrive", "brakes", "payload", "io", "trajectories")
STOP_CATEGORIES = (0, 1, 2)
"""Stop categories of IEC 60204-1. 0 removes power immediately. 1 removes power after the arm has stopped. 2
keeps the power on after the stop.
"""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """The capabilities of a device. A request that needs a missing capability is rejected; the error names
    the capability.

    Attributes:
        periods_s: cycle periods that the device supports, s; empty: any.
        measured: names from `MEASURED_NAMES`: the attributes of `rtloop.backends.Measured` that the device
            fills in. All others are zeros.
        impedance: the drives accept a commanded stiffness and damping.
        torque: the arm follows streamed torques.
        wrench: the device accepts a force at the TCP in addition to positions.
        freedrive: the arm can be guided by hand.
        guides: the device itself releases the arm for hand guiding; otherwise cobot guides the arm with
            springs and measured torques.
        brakes: brakes can be commanded separately from the drives.
        payload: the device accepts the payload.
        io: the device has inputs and outputs.
        trajectories: the device accepts only whole motions and executes them autonomously; nothing can be
            streamed to it.
        stops: stop categories that cobot can command, each with whether the device itself confirms it.
        hardware: the device drives a real arm.
    """

    periods_s: tuple[float, ...] = ANY_PERIOD
    measured: frozenset[str] = DEFAULT_MEASURED
    impedance: bool = False
    torque: bool = False
    wrench: bool = False
    freedrive: bool = False
    brakes: bool = False
    payload: bool = False
    io: bool = False
    trajectories: bool = False
    stops: Mapping[int, bool] = field(default_factory=lambda: MappingProxyType({1: False, 2: False}))
    hardware: bool = False
    guides: bool = False

    def __post_init__(self) -> None:
        """
        Raises:
            ValueError: a name in `measured` is unknown, or a stop category or a period is invalid.
        """
        unknown = sorted(self.measured - set(MEASURED_NAMES))
        if unknown:
            raise ValueError(f"measured: {unknown[0]!r} is invalid; valid names: {', '.join(MEASURED_NAMES)}")
        strange = [category for category in self.stops if category not in STOP_CATEGORIES]
        if strange:
            raise ValueError(f"stops: {strange[0]!r} is not a stop category; valid values: 0, 1 and 2")
        if any(not period_s > 0.0 for period_s in self.periods_s):
            raise ValueError(f"periods_s: {self.periods_s} must be above 0")

    def period_refusal(self, period_s: float) -> str:
        """The reason why the device cannot be driven with this period; "" if it can be driven."""
        if not self.periods_s or any(abs(period_s - each) < 1e-9 for each in self.periods_s):
            return ""
        valid = ", ".join(f"{each:g}" for each in self.periods_s)
        return f"rt.period_s is {period_s:g} s; the device can be driven every {valid} s"

    def lacks(self, backend: str, what: str, *names: str) -> str:
        """The reason why a request is rejected for lack of a capability; "" if the device has it.

        Args:
            backend: display name of the device.
            what: the request, as the beginning of a sentence.
            names: names from `FLAGS`; the device needs only one of these capabilities.
        """
        if any(getattr(self, name) for name in names):
            return ""
        needed = " or ".join(WORDS[name] for name in names)
        return (
            f"{what} needs {needed}, which the backend {backend} does not have; it {self._listed_abilities}"
        )

    def does_not_measure(self, backend: str, what: str, row: str) -> str:
        """The reason why a request that needs one of `MEASURED_NAMES` is rejected; "" if the device measures
        this quantity.
        """
        if row in self.measured:
            return ""
        return f"{what} needs {row}, which the backend {backend} does not measure; it measures {self._rows}"

    @property
    def _listed_abilities(self) -> str:
        able = ", ".join(WORDS[name] for name in FLAGS if getattr(self, name))
        return f"has {able}" if able else "accepts positions only"

    @property
    def _rows(self) -> str:
        return ", ".join(name for name in MEASURED_NAMES if name in self.measured) or "nothing"

    @property
    def words(self) -> str:
        """The capabilities as human-readable text, in one line."""
        periods = ", ".join(f"{1e3 * each:g}" for each in self.periods_s)
        kind = "hardware" if self.hardware else "simulation"
        stops = ", ".join(
            f"{category} ({'confirmed by the device' if self.stops[category] else 'by cobot'})"
            for category in sorted(self.stops)
        )
        return "; ".join(
            [
                kind,
                f"every {periods} ms" if periods else "any period",
                f"measures {self._rows}",
                self._listed_abilities,
                f"stop categories {stops}",
            ]
        )


WORDS = {
    "impedance": "impedance control",
    "torque": "torque control",
    "wrench": "wrench control",
    "freedrive": "freedrive",
    "brakes": "control of its brakes",
    "payload": "setting of the payload",
    "io": "inputs and outputs",
    "trajectories": "whole motions only, which it executes itself",
}


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """The status that a device reports. Values that the device does not report are "" or None.

    Attributes:
        connection: state of the connection, for example "connected", or the state of its session.
        quality: connection quality.
        operation_mode: T1 (manual, reduced speed), T2 (manual) or AUT.
        safety_stop: the reason why the arm cannot move; "" if it can move.
        drives, brakes: their states, for example "on", "released".
        speed_scaling: the device's own speed override, from 0 to 1, which the path clock follows.
        packets_lost: number of packets lost since the connection was opened.
        device_time_s: device time, s.
        text: a further sentence that a user should read.
    """

    connection: str = ""
    quality: str = ""
    operation_mode: str = ""
    safety_stop: str = ""
    drives: str = ""
    brakes: str = ""
    speed_scaling: float = 1.0
    packets_lost: int = 0
    device_time_s: float | None = None
    text: str = ""


STATUS_WORDS = tuple(each.name for each in fields(DeviceStatus) if each.type == "str")
