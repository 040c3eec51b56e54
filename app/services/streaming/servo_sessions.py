"""Begins and ends servo sessions. Each begins once the arm is at rest after the previous one, and ends for
exactly one reason.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from dataclasses import replace

import numpy as np

from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService, ForceSettings
from app.services.streaming.servo_points import PointInverse, ServoPoints
from app.services.streaming.sessions import StreamService, StreamSession
from cobot.errors import CobotError, ConflictError
from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.session_rules import nominal_session
from cobot.servo.fields import Refusal
from cobot.servo.protocol import ServoRules, SetMode

NAME = "a servo session"
OPEN_TIMEOUT_S = 2.0
PATIENCE_S = 0.5
"""Timeout for a motion that has just ended to release its claim on the arm, s."""
RETRY_S = 0.02
FORCE_MODES = (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)

log = logging.getLogger("cobot.servo")


class ServoSessions:
    """Manages one robot's servo sessions, one at a time. Each request has a number, its generation.

    Attributes:
        generation: number of the last request.
        reason: reason why the last session ended or could not begin; "" while a session is open.
    """

    def __init__(
        self,
        link: RobotLink,
        streams: StreamService,
        force: ForceService,
        rules: ServoRules,
        points: ServoPoints,
        inverse: PointInverse,
    ) -> None:
        self.generation = 0
        self.reason = ""
        self._link = link
        self._streams = streams
        self._force = force
        self._rules = rules
        self._points = points
        self._inverse = inverse
        self._session: StreamSession | None = None  # rtloop's session; kept until the arm is at rest
        self._belongs_to = 0  # the generation for which the session was begun
        self._task: asyncio.Task[None] | None = None
        self._followers: set[asyncio.Task[None]] = set()

    @property
    def current(self) -> StreamSession | None:
        """The last requested session, from its beginning until it starts to end; otherwise None."""
        return self._session if self._belongs_to == self.generation else None

    @property
    def phase(self) -> str:
        """Phase of the session, as a word for the feedback."""
        if not self._rules.active:
            return "idle" if self._session is None else "closing"
        return "opening" if self.current is None else "active"

    def request(self, request: SetMode, stops: int | None = None, owner: str = "") -> asyncio.Task[None]:
        """Leave the current session, and begin a new one unless the mode is 0. The returned task is done when
        the new session has begun.

        Args:
            stops: `RobotLink.stops` at the time of the request; None for its current value.
            owner: the only client that may send its points; "" for any client.
        """
        before, session = self._task, self._session
        ends = request.mode is ServoMode.NONE
        self.leave("ended by mode 0" if ends else "another session was requested")
        if not ends:
            self._rules.begin(request, owner)
            self.reason = ""
        stops = self._link.stops if stops is None else stops
        work = self._open(request, self.generation, stops, before, session)
        self._task = asyncio.create_task(work, name="servo session")
        self._task.add_done_callback(_consume_error)
        return self._task

    def leave(self, reason: str, *, at_once: bool = True) -> None:
        """Accept no more points. The arm stops at once, or after the points that were already accepted."""
        self.generation += 1
        self._points.drop()
        if self._rules.active:
            self.reason = reason
        self._rules.end()
        if self._session is not None and at_once:
            self._session.end(reason)
        elif self._session is not None:
            self._session.finish(reason)

    async def end(self, reason: str) -> None:
        """End the session. Returns when the arm is at rest."""
        session = self._session
        self.leave(reason)
        if self._task is not None:
            await asyncio.wait({self._task})
        if session is not None:
            await asyncio.shield(session.ended)

    def close(self) -> None:
        """Stop sending points, because the service is ending. rtloop then ends the session."""
        for task in (self._task, *self._followers):
            if task is not None:
                task.cancel()

    async def _open(
        self,
        request: SetMode,
        generation: int,
        stops: int,
        before: asyncio.Task[None] | None,
        last: StreamSession | None,
    ) -> None:
        if before is not None:
            await asyncio.wait({before})
        last = self._session or last
        if last is not None:
            await asyncio.shield(last.ended)
        if request.mode is ServoMode.NONE or generation != self.generation:
            return
        try:
            session = await self._begin(request, stops)
        except CobotError as exc:
            if generation == self.generation:
                self._fail(str(exc))
            log.warning("%sservo mode %d was rejected: %s", self._link.label, request.mode, exc)
            raise
        follower = asyncio.create_task(self._follow(session, generation, request.mode))
        self._followers.add(follower)
        follower.add_done_callback(self._followers.discard)
        self._session, self._belongs_to = session, generation
        if generation != self.generation:
            session.end("another session or mode 0 was requested")
            raise ConflictError("the servo session was ended while it began")
        self._points.begin(session)

    async def _begin(self, request: SetMode, stops: int) -> StreamSession:
        """Wait for a claim that is being released, then request the session from rtloop. rtloop rejects the
        session if a stop has been requested since.
        """
        deadline_s = self._link.clock.now_s() + PATIENCE_S
        if request.mode in FORCE_MODES:
            await self._force.lend()
        try:
            while True:
                self._inverse.restart()
                try:
                    asked = session_request(request, self._streams.info, self._force.settings)
                    return await self._streams.open(asked, NAME, OPEN_TIMEOUT_S, stops)
                except ConflictError:
                    if self._link.clock.now_s() > deadline_s:
                        raise
                await asyncio.sleep(RETRY_S)
        except CobotError:
            with contextlib.suppress(CobotError):
                await self._force.take_back()
            raise

    def _fail(self, reason: str) -> None:
        """Reject the waiting points after the session could not begin."""
        self.reason = reason
        self._rules.end()
        lost = self._points.drop()
        self._rules.accepted -= lost
        self._rules.refuse(Refusal.REJECTED, reason, 1 + lost)

    async def _follow(self, session: StreamSession, generation: int, mode: ServoMode) -> None:
        reason = await asyncio.shield(session.ended)
        if self._session is session:
            self._session = None
        if generation == self.generation:
            self._rules.end()
            self.reason = reason
        log.info("%sservo mode %d has ended: %s", self._link.label, mode, reason)
        if not self._rules.active:  # no client has requested another session yet
            with contextlib.suppress(CobotError):
                await self._force.take_back()


def session_request(request: SetMode, info: np.ndarray, force: ForceSettings) -> np.ndarray:
    """Create the request to rtloop, a record of `cobot.ipc.layout.session_dtype`.

    Args:
        info: record of `cobot.ipc.layout.info_dtype`.
        force: settings of force control. They apply to the modes with force control, if it is enabled.
    """
    asked = nominal_session(info)
    asked["servo_mode"], asked["watchdog_s"] = request.mode, request.watchdog_s
    asked["interpolation"], asked["decimation"] = Interpolation.NONE, 1
    asked["stream"] = Stream.JOINT_IMPEDANCE
    if request.mode in FORCE_MODES:
        asked["stream"] = Stream.CARTESIAN
        (force if force.enabled else replace(force, axes=(False,) * 6)).describe(asked)
    return asked


def _consume_error(task: asyncio.Task[None]) -> None:
    """Ignore the task's error, which has already been reported."""
    if not task.cancelled():
        task.exception()
