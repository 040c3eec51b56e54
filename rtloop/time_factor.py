"""The time factor of a simulation: robot time per wall time while a planned motion runs."""

from __future__ import annotations

from cobot.types import TIME_FACTORS
from rtloop.backends import Backend, Paced, capabilities_of
from rtloop.clock import CycleClock, RealtimeClock

ONLY = "only a simulated robot has a time factor other than 1"


def time_factor_refusal(backend: Backend, clock: CycleClock, factor: float) -> str:
    """Return the reason why this robot cannot have this time factor; "" if it can."""
    least, most = TIME_FACTORS
    if factor == 1.0:
        return ""
    if not least <= factor <= most:
        return f"the time factor is {factor:g}, allowed: {least:g} to {most:g}"
    if capabilities_of(backend).hardware:
        return f"{ONLY}, and this backend moves a real arm"
    if isinstance(backend, Paced):
        return f"{ONLY}, and this device has its own clock"
    if not isinstance(clock, RealtimeClock):
        return "with rt.clock: fast, motions run as fast as the computer can, so the time factor must be 1"
    return ""
