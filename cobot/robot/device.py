"""What stands between the cycle and an arm, in words: what a device can do, and how it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType

MEASURED_NAMES = ("position", "velocity", "effort", "desired_effort", "external_effort", "wrench")
"""What a device may measure of its joints and at its TCP: the rows of `rtloop.backends.Measured`."""
LESS = "the device permits less than the model"
"""Before what it permits less of, for people."""
ANY_PERIOD: tuple[float, ...] = ()
FLAGS = ("impedance", "torque", "wrench", "freedrive", "brakes", "payload", "io", "trajectories")
STOP_CATEGORIES = (0, 1, 2)
"""IEC 60204-1: drives off at once; off when the arm has come to rest; rest with the drives on."""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a device can do. A mode that needs what is missing is refused by its name.

    Attributes:
        periods_s: of the cycle, that the device can be driven with, s; empty: any.
        measured: which rows of `Measured` are real: names of `MEASURED_NAMES`. The others are zeros.
        impedance: its drives give way as they are told.
        torque: its arm moves as streamed torques have it.
        wrench: it takes a force of the TCP on top of positions.
        freedrive: it can be guided by hand.
        brakes: they can be told apart from the drives.
        payload: it is told what it carries.
        io: it has inputs and outputs.
        trajectories: it takes whole motions and moves along them by itself: nothing can be streamed to it.
        stops: the stop categories that cobot can have it do, each with whether the device itself confirms it.
        hardware: it moves something real.
    """

    periods_s: tuple[float, ...] = ANY_PERIOD
    measured: frozenset[str] = frozenset(MEASURED_NAMES)
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

    def __post_init__(self) -> None:
        """
        Raises:
            ValueError: a row that nobody measures, no stop category, or no period.
        """
        unknown = sorted(self.measured - set(MEASURED_NAMES))
        if unknown:
            raise ValueError(f"measured: {unknown[0]!r} is none of {', '.join(MEASURED_NAMES)}")
        strange = [category for category in self.stops if category not in STOP_CATEGORIES]
        if strange:
            raise ValueError(f"stops: {strange[0]!r} is no stop category: 0, 1 or 2")
        if any(not period_s > 0.0 for period_s in self.periods_s):
            raise ValueError(f"periods_s: {self.periods_s} must be above 0")

    def period_refusal(self, period_s: float) -> str:
        """Why a cycle of this period cannot drive the device; "" if it can."""
        if not self.periods_s or any(abs(period_s - each) < 1e-9 for each in self.periods_s):
            return ""
        valid = ", ".join(f"{each:g}" for each in self.periods_s)
        return f"rt.period_s is {period_s:g} s; the device can be driven every {valid} s"

    def lacks(self, backend: str, what: str, *names: str) -> str:
        """Why what somebody asks for is refused; "" where the device can.

        Args:
            backend: its name, for people.
            what: needs it, as the beginning of a sentence.
            names: of `FLAGS`, any of which will do.
        """
        if any(getattr(self, name) for name in names):
            return ""
        needed = " or ".join(WORDS[name] for name in names)
        return f"{what} needs {needed}, which the backend {backend} does not have; it {self._able}"

    def does_not_measure(self, backend: str, what: str, row: str) -> str:
        """Likewise, of what needs one of `MEASURED_NAMES`."""
        if row in self.measured:
            return ""
        return f"{what} needs {row}, which the backend {backend} does not measure; it measures {self._rows}"

    @property
    def _able(self) -> str:
        able = ", ".join(WORDS[name] for name in FLAGS if getattr(self, name))
        return f"has {able}" if able else "is told positions only"

    @property
    def _rows(self) -> str:
        return ", ".join(name for name in MEASURED_NAMES if name in self.measured) or "nothing"

    @property
    def words(self) -> str:
        """For people, in a line."""
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
                self._able,
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
    "trajectories": "whole motions alone, along which it moves by itself",
}


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """How a device is, as it says itself; "" and None where it does not say.

    Attributes:
        connection: such as "connected", or the state of its session.
        quality: of the connection.
        operation_mode: T1 (reduced speed, by hand), T2 (by hand) or AUT.
        safety_stop: what stands in the way, "" for nothing.
        drives, brakes: such as "on", "released".
        speed_scaling: of its own speed override, from 0 to 1, which the path clock follows.
        packets_lost: since it was opened.
        device_time_s: on its own clock.
        text: anything else that a user should read, as a sentence.
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
