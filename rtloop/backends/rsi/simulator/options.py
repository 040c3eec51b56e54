"""Options of a simulated controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

PERIODS_MS = (4, 12)


@dataclass(frozen=True, slots=True)
class ControllerOptions:
    """
    Attributes:
        period_ms: 4 (IPO_FAST) or 12 (IPO).
        relative: whether RSI_ON uses the relative mode instead of the absolute one.
        hold_on: whether the last correction stays at the output of ETHERNET if an answer is missing.
        timeout: number of late answers after which RSI ends.
        in_a_row: whether `timeout` applies to consecutive late answers instead of all since RSI_ON.
        operation_mode: T1, T2, AUT or EXT.
        override: program override, percent.
        reports: whether the context reports mode, state, override and the sum of corrections. Contexts that
            cobot has not written do not.
    """

    period_ms: int = 4
    relative: bool = False
    hold_on: bool = True
    timeout: int = 10
    in_a_row: bool = False
    operation_mode: Literal["T1", "T2", "AUT", "EXT"] = "AUT"
    override: int = 100
    reports: bool = True

    def __post_init__(self) -> None:
        if self.period_ms not in PERIODS_MS:
            raise ValueError(f"the period is {self.period_ms} ms; it must be 4 (IPO_FAST) or 12 (IPO)")
        if not 0 <= self.override <= 100:
            raise ValueError(f"the override is {self.override} %; it must be from 0 to 100")
