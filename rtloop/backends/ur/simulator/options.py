"""Options of a simulated controller."""

from __future__ import annotations

from dataclasses import dataclass

from rtloop.backends.ur.torques import check_version
from rtloop.results import ACCEPTED

SERIES = {
    "e": (0.002, (5, 17, 0, 128_000)),
    "cb3": (0.008, (3, 15, 8, 106_339)),
    "x": (0.002, (10, 12, 0, 0)),
}
"""Control period, s, and software version of each series."""


@dataclass(frozen=True, slots=True)
class UrControllerOptions:
    """
    Attributes:
        series: "e", "cb3", or "x" for PolyScope X, which provides the Robot API instead of the dashboard
            server.
        is_on: whether the arm is switched on and its brakes are released at the start.
        is_remote: whether Remote Control is selected at the teach pendant.
        slider: position of the speed slider, 0 to 1.
        software: software version; None for the version in `SERIES`.
    """

    series: str = "e"
    is_on: bool = False
    is_remote: bool = True
    slider: float = 1.0
    software: tuple[int, int, int, int] | None = None

    @property
    def period_s(self) -> float:
        return SERIES[self.series][0]

    @property
    def version(self) -> tuple[int, int, int, int]:
        return self.software or SERIES[self.series][1]

    @property
    def has_torque(self) -> bool:
        """Whether this version supports `direct_torque` and `MOTOR_TORQUE`."""
        return check_version(self.version, "", has_torque=True) is ACCEPTED
