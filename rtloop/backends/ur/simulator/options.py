"""Options of a simulated controller."""

from __future__ import annotations

from dataclasses import dataclass

SERIES = {
    "e": (0.002, (5, 17, 0, 128_000)),
    "cb3": (0.008, (3, 15, 8, 106_339)),
    "x": (0.002, (10, 12, 0, 0)),
}
"""Control period, s, and version of the software of each series."""


@dataclass(frozen=True, slots=True)
class UrControllerOptions:
    """
    Attributes:
        series: "e", "cb3", or "x" for PolyScope X, which has the Robot API instead of the dashboard server.
        is_on: whether the arm is switched on and its brakes are released at the start.
        is_remote: whether Remote Control is chosen at the teach pendant.
        slider: the speed slider, 0 to 1.
    """

    series: str = "e"
    is_on: bool = False
    is_remote: bool = True
    slider: float = 1.0

    @property
    def period_s(self) -> float:
        return SERIES[self.series][0]

    @property
    def version(self) -> tuple[int, int, int, int]:
        return SERIES[self.series][1]
