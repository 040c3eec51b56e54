"""Limits the rate of steps, because a loop without a motion must not keep the service busy."""

from __future__ import annotations

from collections.abc import Callable

from cobot.clock import SYSTEM, Clock

MAX_STEPS_PER_S = 20.0
BURST = 20
"""Number of steps that may follow each other without a delay. After a pause of this many intervals, all of
them are available again.
"""


class StepPace:
    """Delays steps that would follow each other too fast."""

    def __init__(self, clock: Clock = SYSTEM, sleep: Callable[[float], object] | None = None) -> None:
        self._clock = clock
        self._sleep = clock.sleep if sleep is None else sleep
        self._used_s = clock.now_s() - BURST / MAX_STEPS_PER_S

    def keep(self) -> None:
        """Wait until the next step may start."""
        now_s = self._clock.now_s()
        self._used_s = max(self._used_s, now_s - BURST / MAX_STEPS_PER_S) + 1.0 / MAX_STEPS_PER_S
        if self._used_s > now_s:
            self._sleep(self._used_s - now_s)
