"""How fast motions go along their paths: a fraction of their own time, and pauses."""

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
"""Time within which a motion must be at rest after a request to pause, s."""
MAX_PAUSE_S = 3600.0
"""Total time of pauses that does not count towards the timeout of a motion, s."""
FRACTIONS = (0.01, 1.0)
"""The smallest and the largest fraction of full speed that may be set, in addition to 0."""


class SpeedOverride:
    """The speed override of one robot's motions; streams have none.

    Args:
        changed: called when a pause has begun or ended.

    Attributes:
        fraction: of full speed, at which motions go unless they are paused.
        opened: set while motions may begin.
        others: the overrides of the robots that move together with this one, which pause and go on with it.
        follows_stream: whether the stream under way follows pauses and the fraction by itself.
    """

    def __init__(self, link: RobotLink, changed: Callable[[], None] = lambda: None) -> None:
        self._link = link
        self._changed = changed
        self._asked = False
        self.fraction = 1.0
        self._paused_s = 0.0
        self._slowed_s = 0.0
        self._since_s = link.clock.now_s()
        self._restoring: asyncio.Task[None] | None = None
        self.opened = asyncio.Event()
        self.opened.set()
        self.others: tuple[SpeedOverride, ...] = ()
        self.follows_stream = False

    @property
    def paused(self) -> bool:
        """Whether a pause was asked for, or the fraction is 0."""
        return not self.opened.is_set()

    @property
    def paused_s(self) -> float:
        """How long all pauses were together, the present one included."""
        return self._paused_s + (self._lasts_s if self.paused else 0.0)

    def excused_s(self, paused_s: float) -> float:
        """By how much pauses prolong the time of a motion; at most by MAX_PAUSE_S.

        Args:
            paused_s: `paused_s` when the motion began.
        """
        return min(self.paused_s - paused_s, MAX_PAUSE_S)

    @property
    def slowed_s(self) -> float:
        """How much longer motions have taken in all because the fraction was below 1; without pauses."""
        return self._slowed_s + (0.0 if self.paused else (1.0 - self.fraction) * self._lasts_s)

    @property
    def _lasts_s(self) -> float:
        """How long it has been as it is."""
        return self._link.clock.now_s() - self._since_s

    async def set_fraction(self, fraction: float) -> None:
        """Go along the path faster or slower: the motion that runs, and all that follow.

        Raises:
            ConflictError: it moves together with other robots.
            LimitError: out of bounds.
            NotSupportedError: the device moves along whole motions by itself.
            UnavailableError: rtloop does not answer.
        """
        if self.others:
            raise ConflictError("a synchronous motion keeps the speed that it has begun with")
        self._require_path_clock()
        least, most = FRACTIONS
        if fraction != 0.0 and not least <= fraction <= most:
            raise LimitError(f"the fraction of the speed is 0, or from {least} to {most:g}, got {fraction:g}")
        self._take(fraction)
        await self._apply()

    def restore(self, fraction: float) -> None:
        """Return to a fraction, because the control of the client that set another one has ended.

        A motion that was held at 0 goes on.
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
        with contextlib.suppress(UnavailableError):  # a new rtloop has no motion that could be held
            await self._apply()

    async def pause(self) -> None:
        """Bring the arm to rest on its path, and those that move with it, and let nothing begin.

        Returns when they rest.

        Raises:
            ConflictError: it follows a stream, which has no path.
            NotSupportedError: the device moves along whole motions by itself.
            UnavailableError: rtloop does not answer.
            ExecutionError: it does not come to rest.
        """
        overrides = (self, *self.others)
        for override in overrides:
            if override._link.state().session and not override.follows_stream:
                raise ConflictError("a stream has no path to pause on; end it, or POST /stop")
            override._require_path_clock()
        for override in overrides:  # before anything is awaited: what ends meanwhile ends the pause too
            override._asked = True
            override._settle()
        await asyncio.gather(*(override._come_to_rest() for override in overrides))

    async def _come_to_rest(self) -> None:
        await self._apply()
        if self.follows_stream:
            return
        deadline_s = self._link.clock.now_s() + REST_TIMEOUT_S
        while not self._rests():
            if self._link.clock.now_s() > deadline_s:
                raise ExecutionError(f"the arm has not come to rest on its path within {REST_TIMEOUT_S:g} s")
            await asyncio.sleep(POLL_S)

    async def resume(self) -> None:
        """Go on with the motion that was paused, and with those that wait.

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
                f"the backend {known[0]} takes whole motions: on its way the arm can be stopped, neither "
                "slowed down nor paused; use `speed` of the next motion, or POST /stop"
            )

    def reset(self) -> None:
        """There is nothing left that was paused."""
        self._asked = False
        self._settle()

    def _settle(self) -> None:
        """Open or close the way for motions, as what was asked for has it."""
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
        """It becomes another one now."""
        self._paused_s, self._slowed_s = self.paused_s, self.slowed_s
        self._since_s = self._link.clock.now_s()

    async def begin_motion(self) -> None:
        """A motion has just begun, as every motion at its full rate."""
        if self.paused or self.fraction != 1.0:
            await self._apply()

    def _rests(self) -> bool:
        state = self._link.state()
        return state.mode in RESTING or state.path_rate == 0.0

    async def _apply(self) -> None:
        try:
            await self._link.commands.set_rate(0.0 if self.paused else self.fraction)
        except ExecutionError:
            return  # no motion is running; the next one asks
