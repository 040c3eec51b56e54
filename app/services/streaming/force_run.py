"""A running motion with force: its measurements, its commands, and its result."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from app.services.rights.claims import Caller, Claim
from app.services.rights.ownership import Ownership
from app.services.rights.speed_override import MAX_PAUSE_S
from app.services.rights.stop_reason import StopReason
from app.services.state.link import RobotLink
from app.services.streaming.force_stages import Aim, ForceSample, NotMet, Push, Stage, let_go
from app.services.streaming.sessions import StreamSession
from cobot.errors import CobotError, ExecutionError, MotionStopped
from cobot.motions.force_bodies import AnyForceMotion, FollowMotion
from cobot.pose import Pose
from cobot.reasons import Reason

PERIOD_S = 0.01
FORCE_INTEGRAL_PER_S = 2.0
"""Gain of the integral term that removes a persistent force error, for example on a slope, 1/s."""


@dataclass(frozen=True, slots=True)
class TouchPoint:
    """The pose of the TCP at the first contact, and its distance along the push."""

    pose: Pose
    distance_m: float
    force_n: float


@dataclass(slots=True)
class ForceOutcome:
    """The result of a motion with force. Forces are measured along the push direction, distances from the
    start. The pose is the TCP pose.

    Attributes:
        error: None if the end was reached, or if the request does not require it.
        stopped_by: word for the cause that ended the motion; "" before the end.
        force_n: mean force while the force was held, N; None if it was not held.
    """

    error: CobotError | None = None
    stopped_by: str = ""
    contact: TouchPoint | None = None
    force_n: float | None = None
    max_force_n: float = 0.0
    pose: Pose | None = None
    distance_m: float = 0.0
    duration_s: float = 0.0
    held: list[float] = field(default_factory=list)


def outcome_word(outcome: ForceOutcome) -> Callable[[str], None]:
    """Create a function that records in `outcome` what has ended the search. The function gets the cause as a
    word.
    """

    def note(word: str) -> None:
        outcome.stopped_by = word

    return note


class ForceRun:
    """A running motion with force.

    Attributes:
        free_n: external force at the beginning, in the base frame, shape (3,), N.
    """

    def __init__(
        self, link: RobotLink, ownership: Ownership, push: Push, body: AnyForceMotion, caller: Caller
    ) -> None:
        self._link, self._ownership = link, ownership
        self.push, self.body, self.caller = push, body, caller
        self.outcome = ForceOutcome()
        self.free_n = link.state().wrench[:3].copy()
        self._in_tool = push.start.rotation.T @ push.axis
        self._turns = isinstance(body, FollowMotion) and body.frame == "tool"
        self._stops = link.stops
        self._begun_s = link.clock.now_s()
        self._paused_s = ownership.speed_override.paused_s
        self._before_s = link.clock.now_s()
        self._number = 0
        self._missing_n = 0.0  # missing contact force, integrated over time, N·s
        self._aim = Aim(push.start, 0.0)

    async def drive(self, session: StreamSession, stages: Stage) -> None:
        """Run the stages, then release the contact, whatever the result of the stages.

        Raises:
            NotMet: a limit was reached first.
            MotionStopped, ExecutionError: the session was ended from outside.
        """
        try:
            most_s = self.caller.timeout_s if self.caller.waits else np.inf
            await self._run(session, stages, min(self.body.max_time_s, most_s))
        except NotMet:
            with contextlib.suppress(NotMet):  # the answer reports the limit that was reached first
                await self._let_go(session)
            raise
        await self._let_go(session)

    async def _let_go(self, session: StreamSession) -> None:
        last = self._sample(0.0)
        # The way back is limited as well, including pauses.
        most_s = self._active_s() + self.body.max_time_s
        await self._run(session, let_go(self.push, last, self._aim, self.body.retract), most_s)

    async def _run(self, session: StreamSession, stage: Stage, most_s: float) -> None:
        aim = next(stage)
        while True:
            self._feed(session, aim)
            await asyncio.sleep(PERIOD_S)
            now_s = self._link.clock.now_s()
            step_s, self._before_s = now_s - self._before_s, now_s
            self._require_going(session)
            override = self._ownership.speed_override
            sample = self._sample(0.0 if override.paused else override.fraction * step_s)
            if self._active_s() > most_s:
                stage.close()
                raise NotMet("max_time", f"the motion has not reached its end within {most_s:g} s")
            if override.paused:
                continue
            self._account(aim, sample)
            try:
                aim = stage.send(sample)
            except StopIteration:
                return

    def _active_s(self) -> float:
        """Return for how long the motion has been running, s. Pauses that extend the timeout are not
        counted.
        """
        paused_s = self._ownership.speed_override.paused_s - self._paused_s
        return self._link.clock.now_s() - self._begun_s - min(paused_s, MAX_PAUSE_S)

    def _account(self, aim: Aim, sample: ForceSample) -> None:
        """Integrate the force error while the force is held."""
        if self.outcome.contact is None or aim.force_n != self.push.force_n:
            self._missing_n = 0.0
            return
        missing_n = self._missing_n + FORCE_INTEGRAL_PER_S * sample.step_s * (aim.force_n - sample.force_n)
        self._missing_n = float(np.clip(missing_n, -aim.force_n, aim.force_n))

    def _sample(self, step_s: float) -> ForceSample:
        state = self._link.state()
        pose = Pose.from_numbers(state.tcp)
        axis = pose.rotation @ self._in_tool if self._turns else self.push.axis
        force_n = float((self.free_n - state.wrench[:3]) @ axis)
        outcome = self.outcome
        outcome.max_force_n = max(outcome.max_force_n, force_n)
        outcome.pose, outcome.distance_m = pose, self.push.distance_m(pose)
        return ForceSample(step_s, pose, force_n)

    def _feed(self, session: StreamSession, aim: Aim) -> None:
        self._aim = aim
        axis = aim.pose.rotation @ self._in_tool if self._turns else self.push.axis
        self._number += 1
        setpoint = session.setpoint.copy()
        setpoint["number"] = self._number
        setpoint["pose"] = aim.pose.numbers
        # rtloop's measured force includes the force that was already measured while the TCP was free.
        setpoint["wrench"][2] = aim.force_n + self._missing_n - float(self.free_n @ axis)
        session.take_setpoint(self._number, setpoint)

    def _require_going(self, session: StreamSession) -> None:
        """Check that nothing has ended the motion.

        Raises:
            MotionStopped: the motion was stopped or cancelled, or the client has disconnected.
            ExecutionError: rtloop has ended the session; the error gives the reason.
        """
        if self.caller.gone.is_set() and self.caller.job is not None:
            gone = StopReason("the client has disconnected", "client_left").error
            self._ownership.cancel(self.caller.job, gone)
            raise gone
        if not session.over:
            return
        claim = self._ownership.moving
        cause = claim.interruption if isinstance(claim, Claim) else None
        if cause is not None or self._link.stops != self._stops:
            raise MotionStopped(session.over, details=None if cause is None else cause.details)
        raise ExecutionError(session.over, details=Reason.of_text(session.over).fields())
