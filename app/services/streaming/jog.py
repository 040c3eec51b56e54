"""Jogging: the arm moves while the client repeats its request several times a second, within safe limits.

Each frame requests velocities of the joints or of the TCP. They are converted to joint targets of a streaming
session, so all limits of streaming sessions apply. In addition, this module reduces the velocity when a joint
approaches its limit or the arm approaches an obstacle, exponentially, so that neither is reached. All joints
are slowed down by the same factor, so the direction stays the same. The TCP stays on its line (`jog_line`).

The session ends and the arm stops when the client releases the jog, when no frame arrives for `SILENCE_S`, or
when the session is ended from outside. In the last case, the client must release the jog before it can jog
again, because a button that is still held must not restart the arm after a stop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.services.state.link import RobotLink
from app.services.streaming.jog_limits import UNLIMITED, JogLimits, LimitedVelocity
from app.services.streaming.jog_line import JogLine
from app.services.streaming.sessions import StreamService, StreamSession
from cobot.errors import CobotError
from cobot.ipc.layout import Interpolation, Stream
from cobot.ipc.session_rules import decimation, nominal_session
from cobot.reasons import Reason, ReasonCode
from cobot.robot.description import RobotDescription
from cobot.robot.limits import streamed
from cobot.types import Array

SILENCE_S = 0.2
"""Time without a frame from the client after which the jog ends, s."""
PERIOD_S = 0.02
"""Interval between targets, s."""
MAX_STEP_S = 0.05
"""Maximum time step of one target, s. It applies if the service itself was late."""
SMOOTHING_S = 0.15
"""Time constant with which the joint or TCP velocity follows the requested one, s."""
MAX_LEAD_RAD = 0.1
"""Maximum distance of the targets from the arm, rad or m. At this distance they wait for the arm."""
LET_GO = Reason("the client has let go", ReasonCode.CLIENT_ENDED)
SILENT = Reason(f"no jog frame for {SILENCE_S:g} s; let go, then press again", ReasonCode.JOG_SILENT)
GONE = Reason("the connection to the client was lost", ReasonCode.CONNECTION_LOST)
NOT_AT_REST = Reason("the arm must come to rest first", ReasonCode.NOT_AT_REST)


@dataclass(frozen=True, slots=True)
class JogCommand:
    """A jog command with velocities of the joints or of the TCP.

    Attributes:
        joints: joint velocities, shape (dof,), rad/s or m/s. If None, `twist` moves the TCP.
        twist: TCP velocity, shape (6,), m/s and rad/s. Used if `joints` is None.
        in_tool: whether the twist is given along the axes of the TCP frame. If not, it is given along the
            axes of the base frame.
    """

    joints: Array | None
    twist: Array | None = None
    in_tool: bool = False


@dataclass(frozen=True, slots=True)
class JogAnswer:
    """The state of a jog.

    Attributes:
        share: commanded velocity as a share of the requested one.
        limited_by: reason why the share is below 1; "" if it is 1.
    """

    share: float
    limited_by: Reason


class Jog:
    """Jogs the arm for one client."""

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        streams: StreamService,
        ended: Callable[[Reason], None],
    ) -> None:
        """
        Args:
            ended: function that is called with the reason when a jog has ended and the arm is at rest.
        """
        self._robot, self._link = robot, link
        self._streams = streams
        self._ended = ended
        self._limits = JogLimits(robot, streamed(robot.limits, streams.section))
        self._session: StreamSession | None = None
        self._task: asyncio.Task[None] | None = None
        self._command: JogCommand | None = None
        self._heard_s = 0.0
        self._spent = UNLIMITED  # why the last session ended; kept until the client releases the jog
        self._answer = JogAnswer(1.0, UNLIMITED)
        self._position = self._velocity = np.zeros(robot.limits.dof)
        self._line: JogLine | None = None  # the line along which the TCP moves
        self._let_go = False

    async def take(self, command: JogCommand, name: str, timeout_s: float) -> JogAnswer:
        """Jog with this velocity, for at most `SILENCE_S`. The first command begins a session.

        Args:
            name: the client's displayed name.
            timeout_s: timeout for rtloop's answer, s.

        Raises:
            InputError: the number of joints is wrong.
            ConflictError, NotReadyError, ExecutionError, UnavailableError: see `StreamService.open`.
        """
        self._limits.check(command.joints)
        self._heard_s = self._link.clock.now_s()
        if self._spent:
            return JogAnswer(0.0, self._spent)
        if self._task is not None:
            if self._session is not None and self._session.over:
                return JogAnswer(0.0, NOT_AT_REST)
            self._command = command
            return self._answer
        request = nominal_session(self._streams.info)
        request["stream"], request["interpolation"] = Stream.JOINT_IMPEDANCE, Interpolation.RUCKIG
        request["decimation"] = decimation(1.0 / PERIOD_S, self._streams.period_s)
        try:
            session = await self._streams.open(request, name, timeout_s)
        except CobotError as exc:
            self._spent = Reason(str(exc))
            raise
        self._let_go = False
        self._command, self._session, self._answer = command, session, JogAnswer(1.0, UNLIMITED)
        self._heard_s = self._link.clock.now_s()
        self._position = self._link.state().commanded_position.copy()
        self._velocity = np.zeros_like(self._position)
        if self._line is not None and not self._line.rests_at(self._position):
            self._line = None
        self._task = asyncio.create_task(self._run(session), name="jog")
        return self._answer

    def release(self) -> None:
        """End the jog after the client has released it. The arm stops."""
        self._spent = UNLIMITED
        self._let_go = True
        if self._session is not None:
            self._session.end(LET_GO)

    def close(self) -> None:
        """End the jog after the client has disconnected."""
        if self._session is not None:
            self._session.end(GONE)

    async def _run(self, session: StreamSession) -> None:
        """Send targets until the session ends, then wait until the arm is at rest."""
        try:
            sequence, before_s = 0, self._link.clock.now_s()
            while True:
                await asyncio.sleep(PERIOD_S)
                now_s = self._link.clock.now_s()
                if now_s - self._heard_s > SILENCE_S:
                    session.end(SILENT)
                if session.over:
                    break
                sequence += 1
                self._step(session, sequence, min(now_s - before_s, MAX_STEP_S))
                before_s = now_s
        except CobotError as exc:
            session.end(str(exc))
        finally:
            # the session has already ended, unless an unexpected exception was raised
            session.end("the jog has failed")
        reason = await asyncio.shield(session.ended)
        if self._line is not None:
            self._line.rest(self._link.state().commanded_position)
        self._task = self._session = None
        if not self._let_go:
            self._spent = reason
        self._ended(UNLIMITED if reason == LET_GO else reason)

    def _step(self, session: StreamSession, sequence: int, step_s: float) -> None:
        """Send the next target."""
        assert self._command is not None
        wanted = self._accelerate(self._command, step_s)
        share, reason = self._limits.share(self._position, self._velocity)
        here = self._link.state().commanded_position
        if np.abs(self._position - here).max() > MAX_LEAD_RAD:
            share, reason = 0.0, reason or self._obstacle(here)
        velocity = share * self._velocity
        if self._line is not None:
            self._line.advance(self._position, velocity, step_s)
        self._position = self._position + step_s * velocity
        setpoint = session.setpoint.copy()
        setpoint["joints"], setpoint["joint_velocity"], setpoint["feed_forward"] = (
            self._position,
            velocity,
            True,
        )
        setpoint["number"] = sequence
        session.take_setpoint(sequence, setpoint)
        self._answer = JogAnswer(share * wanted.share, reason or wanted.reason)

    def _accelerate(self, command: JogCommand, step_s: float) -> LimitedVelocity:
        """Change the joint velocities towards the requested ones."""
        gain = step_s / (SMOOTHING_S + step_s)
        if command.twist is None:
            self._line = None
            wanted = self._limits.wanted(command.joints, None, self._position)
            change = gain * (wanted.velocity - self._velocity)
        else:
            line = self._line or JogLine(self._robot.model, self._position, self._velocity)
            twist = line.in_base(np.array(command.twist)) if command.in_tool else np.array(command.twist)
            wanted = self._limits.wanted(None, twist, self._position)
            line.twist = line.twist + gain * (wanted.speed * twist - line.twist)
            change = self._limits.of_twist(line.corrected(self._position), self._position) - self._velocity
            # Near a singularity the TCP leaves its line, so a new line begins at its position.
            self._line = None if wanted.reason else line
        self._velocity += self._limits.gentle_share(change / step_s) * change
        return wanted

    def _obstacle(self, here: Array) -> Reason:
        """Return the reason why the real-time loop slows the arm down."""
        section = self._streams.section
        within_m = section.collision_margin_m + section.slow_down_m
        near = self._limits.nearest(here, self._velocity, within_m)
        words = f"the arm does not follow: {near or 'an unknown cause slows it down or holds it'}"
        return Reason(words, near.code or ReasonCode.NOT_FOLLOWING, near.of, near.value, unit=near.unit)
