"""The speed override: sets the speed of motions along their paths, as a fraction of the planned speed, and
pauses them.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from app.services.state.link import POLL_S, RobotLink
from cobot.errors import (
    ConflictError,
    ExecutionError,
    LimitError,
    NotSupportedError,
    UnavailableError,
)
from cobot.types import RESTING

REST_TIMEOUT_S = 3.0
"""Timeout for the arm to be at rest after a request to pause, s."""
MAX_PAUSE_S = 3600.0
"""Maximum time by which pauses extend the timeout of a motion, s."""
FRACTIONS = (0.01, 1.0)
"""Smallest and largest fraction of full speed that may be set. A fraction of 0 is also permitted."""


class SpeedOverride:
    """The speed override for one robot's motions. It does not apply to streaming sessions.

    Args:
        changed: function that is called when a pause has begun or ended.

    Attributes:
        fraction: speed of motions that are not paused, as a fraction of full speed.
        opened: event that is set while motions may begin.
        others: the speed overrides of robots that move together with this one. They all pause and continue
            together.
        follows_stream: whether the current streaming session handles pauses and the fraction itself.
    """

    def __init__(self, link: RobotLink, changed: Callable[[], None] = lambda: None) -> None:
        self._link = link
        self._changed = changed
        self._asked = False
        self.fraction = 1.0
        self._paused_s = 0.0
        self._slowed_s = self._stretched_s = 0.0
        self._since_s = link.clock.now_s()
        self._restoring: asyncio.Task[None] | None = None
        self.opened = asyncio.Event()
        self.opened.set()
        self.others: tuple[SpeedOverride, ...] = ()
        self.follows_stream = False

    @property
    def paused(self) -> bool:
        """Whether a pause was requested, or the fraction is 0."""
        return not self.opened.is_set()

    @property
    def paused_s(self) -> float:
        """Total duration of all pauses, including the current pause, s."""
        return self.delays_s()[0]

    @property
    def held_up_s(self) -> float:
        """Total duration of all pauses, plus the time that motions have lost outside pauses because the time
        factor was below 1, s.
        """
        paused_s, _, stretched_s = self.delays_s()
        return paused_s + stretched_s

    def delays_s(self) -> tuple[float, float, float]:
        """Return three times, s. The first is the duration of all pauses, including the current one. The
        second is the time that motions have lost outside pauses because the fraction or the time factor was
        below 1. The third is the time that they would have lost if only the time factor had been below 1.
        """
        lasts_s = self._link.clock.now_s() - self._since_s
        if self.paused:
            return self._paused_s + lasts_s, self._slowed_s, self._stretched_s
        factor = min(self._link.time_factor, 1.0)
        slowed_s, stretched_s = (1.0 - self.fraction * factor) * lasts_s, (1.0 - factor) * lasts_s
        return self._paused_s, self._slowed_s + slowed_s, self._stretched_s + stretched_s

    async def set_time_factor(self, factor: float) -> None:
        """Set the time factor of the simulation, for the current motion and all later ones.

        Raises:
            ConflictError: the robot is moving together with other robots, or cannot have this factor.
            UnavailableError: rtloop does not answer.
        """
        if self.others:
            raise ConflictError("the time factor cannot be changed during a synchronous motion")
        self._account()
        try:
            await self._link.commands.set_time_factor(factor)
        except ExecutionError as exc:
            raise ConflictError(str(exc)) from exc
        self._link.events.publish("time_factor", factor=factor)

    async def set_fraction(self, fraction: float) -> None:
        """Set the fraction for the current motion and all later ones.

        Raises:
            ConflictError: the robot is moving in step with other robots.
            LimitError: the fraction is out of bounds.
            NotSupportedError: the device executes whole motions itself.
            UnavailableError: rtloop does not answer.
        """
        if self.others:
            raise ConflictError("the speed of a synchronous motion cannot be changed after its beginning")
        self._require_path_clock()
        least, most = FRACTIONS
        if fraction != 0.0 and not least <= fraction <= most:
            raise LimitError(
                f"the fraction of the speed must be 0, or from {least} to {most:g}, got {fraction:g}"
            )
        self._take(fraction)
        await self._apply()

    def restore(self, fraction: float) -> None:
        """Return to an earlier fraction, because the client that set the current one no longer has control.

        A motion that is waiting because the fraction is 0 continues.
        """
        held = self.fraction == 0.0
        self._take(fraction)
        if held and not self.paused:
            self._restoring = asyncio.get_running_loop().create_task(self._restore())

    def _take(self, fraction: float) -> None:
        if fraction != self.fraction:
            self._account()
            self.fraction = fraction
            self._link.events.publish("speed", fraction=fraction)
        self._settle()

    async def _restore(self) -> None:
        with contextlib.suppress(UnavailableError):  # a restarted rtloop has no motion that could be paused
            await self._apply()

    async def pause(self) -> None:
        """Pause the arm and all robots that move together with it. They stop on their paths, and no new
        motion begins.

        Returns when all of them are at rest.

        Raises:
            ConflictError: a streaming session is running, which has no path.
            NotSupportedError: the device executes whole motions itself.
            UnavailableError: rtloop does not answer.
            ExecutionError: an arm does not stop.
        """
        overrides = (self, *self.others)
        for override in overrides:
            if override._link.state().session and not override.follows_stream:
                raise ConflictError(
                    "a streaming session has no path on which it could pause; end it, or POST /stop"
                )
            override._require_path_clock()
        # before anything is awaited, so that a motion that ends in the meantime also ends the pause
        for override in overrides:
            override._asked = True
            override._settle()
        await asyncio.gather(*(override._come_to_rest() for override in overrides))

    async def _come_to_rest(self) -> None:
        await self._apply()
        if self.follows_stream:
            return
        timeout_s = REST_TIMEOUT_S / min(self._link.time_factor, 1.0)
        deadline_s = self._link.clock.now_s() + timeout_s
        while not self._rests():
            if self._link.clock.now_s() > deadline_s:
                raise ExecutionError(f"the arm has not stopped on its path within {timeout_s:g} s")
            await asyncio.sleep(POLL_S)

    async def resume(self) -> None:
        """Resume the paused motion and all waiting ones.

        Raises:
            UnavailableError: rtloop does not answer.
        """
        overrides = (self, *self.others)
        for override in overrides:
            override.reset()
        await asyncio.gather(*(override._apply() for override in overrides))

    def _require_path_clock(self) -> None:
        known = self._link.device()
        if known is not None and known[1].capabilities.trajectories:
            raise NotSupportedError(
                f"the backend {known[0]} executes whole motions itself, so a motion can be stopped, but "
                "neither slowed down nor paused; use `speed` of the next motion, or POST /stop"
            )

    def reset(self) -> None:
        """Cancel a pause, because the paused motion has ended."""
        self._asked = False
        self._settle()

    def _settle(self) -> None:
        """Permit or block motions according to the current pause and fraction."""
        held = self._asked or self.fraction == 0.0
        if held == self.paused:
            return
        self._account()
        if held:
            self.opened.clear()
        else:
            self.opened.set()
        self._changed()

    def _account(self) -> None:
        """Add the time since the last change to the totals. Call this before each change."""
        self._paused_s, self._slowed_s, self._stretched_s = self.delays_s()
        self._since_s = self._link.clock.now_s()

    async def begin_motion(self) -> None:
        """Apply the override to a motion that has just begun. Every motion begins at full speed."""
        if self.paused or self.fraction != 1.0:
            await self._apply()

    def _rests(self) -> bool:
        state = self._link.state()
        return state.mode in RESTING or state.path_rate == 0.0

    async def _apply(self) -> None:
        try:
            await self._link.commands.set_rate(0.0 if self.paused else self.fraction)
        except ExecutionError:
            return  # no motion is running; the override is applied to the next one
