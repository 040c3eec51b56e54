"""Checks against the computer's clock. They run only with --realtime."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cobot.contract_checks import ContractError, NotTested
from rtloop.backends import BackendError, capabilities_of
from rtloop.clock import Pace
from rtloop.contract.cell import CheckedBackend

BEATEN_S = 0.5
LATE_SHARE = 0.01
"""Maximum share of cycles that take longer than their period."""


def punctuality(cell: CheckedBackend) -> str:
    """Reading and writing take less than a period."""
    if not cell.realtime:
        raise NotTested("durations are checked only with --realtime, on an idle computer")
    with cell.drive() as driver:
        driver.move()
        durations = np.array(driver.heard.durations_s)
    late = float((durations > cell.settings.rt.period_s).mean())
    said = f"p50 {1e6 * np.quantile(durations, 0.5):.0f} µs, p99 {1e6 * np.quantile(durations, 0.99):.0f} µs"
    if late > LATE_SHARE:
        raise ContractError(f"{said}: {100.0 * late:.1f} % of the cycles take longer than a period")
    return said


def beat(cell: CheckedBackend) -> str:
    """`wait` returns one packet per period of the clock."""
    if not cell.realtime:
        raise NotTested("the pace is checked only with --realtime")
    if not hasattr(cell.kind, "wait"):
        raise NotTested("rtloop's own clock starts the cycles")
    if capabilities_of(cell.kind).hardware:
        raise NotTested("the backend is for a real device, and a simulated device need not follow the clock")
    period_s, home = cell.settings.rt.period_s, cell.robot.positions[cell.settings.robot.start_position]
    backend: Any = cell.kind(cell.settings, cell.robot.limits)
    pace = Pace(period_s)
    try:
        backend.open(np.array(home.joints))
    except BackendError as exc:
        raise NotTested(f"the backend cannot be opened without its rig: {exc}") from exc
    try:
        begun, beats = time.monotonic(), 0
        while time.monotonic() - begun < BEATEN_S:
            beaten = bool(backend.wait(period_s))
            beats += beaten
            if pace.early_ns(time.monotonic_ns(), beaten):
                said = f"{beats} packets in {time.monotonic() - begun:.3f} s, but a period is {period_s:g} s"
                raise ContractError(f"wait() returns packets too fast: {said}")
    finally:
        backend.close()
    return f"{beats} packets in {BEATEN_S:g} s"


CHECKS: dict[str, Callable[[CheckedBackend], str]] = {"punctuality": punctuality, "beat": beat}
