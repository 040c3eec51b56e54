"""Freedrive: the arm moves where a hand pushes it, and stays where it is released.

Freedrive is a streaming session with soft springs, so that the arm yields at once. This module makes the
session's targets follow the hand (admittance control): a joint's external torque above a threshold is
converted to a velocity of this joint, as with a damper. The closer the measured arm is to a joint limit or an
obstacle, the smaller the velocity, as in a jog (`jog_limits`). A joint resists being pushed further.

If a device can release its arm itself, the device also controls the motion: there are no targets, and the arm
does not slow down before a limit or an obstacle.

Freedrive ends when it is switched off, when the arm is stopped, or when it is not renewed in time, for
example because the client has disconnected. A renewal does not restart freedrive after it has ended.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

import numpy as np

from app.services.clients import CLIENT, SERVICE_CLIENT, RequestClient
from app.services.state.link import RobotLink
from app.services.streaming.jog import MAX_STEP_S, PERIOD_S
from app.services.streaming.jog_limits import JOINT_ROOM, RATE_PER_S, JogLimits
from app.services.streaming.sessions import StreamService, StreamSession
from cobot.errors import CobotError, ConflictError, NotSupportedError
from cobot.ipc.layout import Interpolation, Stream
from cobot.ipc.session_rules import decimation, nominal_session
from cobot.reasons import Reason, ReasonCode
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits

TIMEOUTS_S = (0.5, 60.0)
"""Minimum and maximum time within which freedrive must be renewed, s."""
TIMEOUT_S = 3.0
SOFTNESS = 16.0
"""Ratio of the robot's nominal stiffness to the stiffness of the springs. Their natural frequency is thus a
quarter of the nominal one.
"""
FOLLOW_S = 0.15
"""Delay with which the arm follows a hand that moves steadily, s. A shorter delay would make the arm feel
lighter, but unstable against hard objects. It must be longer than `SMOOTHING_S` and the cycle.
"""
SMOOTHING_S = 0.1
"""Time constant with which the velocity follows the hand, s."""
TOUCH_SHARE = 0.005
"""Threshold for a joint's external torque, as a share of its effort limit. Smaller values are ignored,
because estimates are not exact.
"""
PUSHED_SHARE = 0.02
"""Maximum external torque at the start of freedrive, as a share of the effort limit. With more, the arm would
drift although nothing pushes it.
"""
PUSHED_N = 20.0
"""Maximum force on the TCP when a device releases its arm itself, N. It is above the noise of a sensor."""
ROOM_RAD = 0.05
"""Distance that a joint keeps from its limit, rad or m, because soft springs yield to continued pushing."""
MAX_LEAD_RAD = 0.05
"""Maximum distance of a target from rtloop's command, which may lag behind, rad or m."""
OFF = "freedrive was switched off"
SWITCHED_OFF = "robot.backend.freedrive is false; set it to true to guide this arm by hand"
NO_REASON = Reason("")


@dataclass(frozen=True, slots=True)
class FreedriveState:
    """State of freedrive.

    Attributes:
        session: number of the current session; None while freedrive is off.
        left_s: time until freedrive ends unless it is renewed, s; 0 while it is off.
        limited_by: reason why the arm does not follow the push; "" while it follows.
        ended: reason why freedrive last ended; "" if it has never ended.
    """

    session: int | None
    left_s: float
    limited_by: Reason
    ended: Reason


class Guidance:
    """Calculates how a robot moves while a person pushes it by hand.

    Attributes:
        velocity: joint velocities of the newest target, rad/s or m/s, shape (dof,).
    """

    def __init__(self, robot: RobotDescription, stiffness: Array) -> None:
        """
        Args:
            stiffness: stiffness of the springs in freedrive, shape (dof,), N·m/rad.
        """
        self._bounds = robot.limits
        self._limits = JogLimits(robot)
        self._damping = stiffness * FOLLOW_S
        self._touch = TOUCH_SHARE * robot.limits.max_effort
        self.velocity = self._wanted = np.zeros(robot.limits.dof)

    def step(self, target: Array, position: Array, external: Array, step_s: float) -> tuple[Array, Reason]:
        """Calculate the next target.

        Args:
            target: the last target, rad or m, shape (dof,).
            position: measured joint positions.
            external: external torques or forces on the joints, N·m or N.
            step_s: time since the last target, s.

        Returns:
            The target, and the reason why the arm does not follow the push; "" if it follows.
        """
        asked = (external - np.clip(external, -self._touch, self._touch)) / self._damping
        bounded, why = self._within_limits(asked, position)
        wanted = self._limits.wanted(bounded, None, position).velocity
        self._wanted += step_s / (SMOOTHING_S + step_s) * (wanted - self._wanted)
        share, near = self._limits.of_obstacles(position, self._wanted)
        self.velocity = share * self._wanted
        low, high = self._bounds.min_position + JOINT_ROOM, self._bounds.max_position - JOINT_ROOM
        return np.clip(target + step_s * self.velocity, low, high), near or why

    def _within_limits(self, asked: Array, position: Array) -> tuple[Array, Reason]:
        """Return the velocities, reduced near the joint limits. A joint that was pushed beyond its limit
        moves back.
        """
        bounds = self._bounds
        up = RATE_PER_S * (bounds.max_position - ROOM_RAD - position)
        down = RATE_PER_S * (bounds.min_position + ROOM_RAD - position)
        back = np.where(asked < 0.0, np.maximum(asked, down), 0.0)
        allowed = np.where(asked > 0.0, np.minimum(asked, up), back)
        beyond = np.abs(asked - allowed)
        joint = int(beyond.argmax())
        if beyond[joint] <= 0.0:
            return allowed, NO_REASON
        end = bounds.max_position[joint] if asked[joint] > 0.0 else bounds.min_position[joint]
        unit, name = bounds.unit(joint), bounds.names[joint]
        return allowed, _at_limit(name, position[joint], end, unit, f"near its limit of {end:.2f} {unit}")


def _at_limit(name: str, value: float, limit: float, unit: str, where: str) -> Reason:
    words = f"{name} is at {value:.2f} {unit}, {where}"
    return Reason(words, ReasonCode.JOINT_LIMIT, (name,), float(value), float(limit), unit)


def outside(limits: JointLimits, position: Array) -> Reason:
    """Describe the joint that is furthest outside its limits, and the remedy; "" if all joints are within
    their limits.
    """
    past = np.maximum(limits.min_position - position, position - limits.max_position)
    joint = int(past.argmax())
    if not past[joint] > 0.0:
        return NO_REASON
    low, high, unit = limits.min_position[joint], limits.max_position[joint], limits.unit(joint)
    where = f"outside its limits of {low:.2f} to {high:.2f} {unit}: guide it back"
    end = high if position[joint] > high else low
    return _at_limit(limits.names[joint], position[joint], end, unit, where)


class FreedriveService:
    """Controls freedrive for one robot."""

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        streams: StreamService,
        *,
        is_switched_off: bool = False,
    ) -> None:
        """Create the service. `is_switched_off` states whether `robot.backend.freedrive` is false in the
        settings.
        """
        self._robot = robot
        self._is_switched_off = is_switched_off
        self._link = link
        self._streams = streams
        self._session: StreamSession | None = None
        self._client = SERVICE_CLIENT
        self._number = 0
        self._until_s = 0.0
        self._timeout_s = TIMEOUT_S
        self._limited_by = self._ended = NO_REASON
        self._task: asyncio.Task[None] | None = None

    @property
    def state(self) -> FreedriveState:
        """The current state of freedrive."""
        if self._session is None or self._session.over:
            ended = self._ended if self._session is None else Reason.of_text(self._session.over)
            return FreedriveState(None, 0.0, NO_REASON, ended)
        left_s = max(self._until_s - self._link.clock.now_s(), 0.0)
        return FreedriveState(self._session.number, left_s, self._limited_by, self._ended)

    async def begin(self, name: str, timeout_s: float, answer_s: float) -> None:
        """Switch freedrive on.

        Args:
            name: the client's displayed name.
            timeout_s: time after which freedrive ends unless `renew` is called, s.
            answer_s: timeout for rtloop's answer, s.

        Raises:
            NotSupportedError: the backend has no freedrive. The error names the backend.
            ConflictError: another client is moving the arm or has control, or the arm is already being
                pushed.
            NotReadyError, ExecutionError, UnavailableError: see `StreamService.open`.
        """
        by_device = self._require_able()
        self._streams.require_control()
        self._require_untouched(by_device)
        info = self._streams.info
        request = nominal_session(info)
        stream = Stream.GUIDED if by_device else Stream.JOINT_IMPEDANCE
        request["stream"], request["interpolation"] = stream, Interpolation.RUCKIG
        request["decimation"] = decimation(1.0 / PERIOD_S, self._streams.period_s)
        request["stiffness"] = info["stiffness"] / SOFTNESS
        request["damping_ratio"] = 1.0
        session = await self._streams.open(request, name, answer_s)
        self._session, self._number, self._limited_by = session, session.number, NO_REASON
        self._client = CLIENT.get()
        self._hold(timeout_s)
        guidance = None if by_device else Guidance(self._robot, request["stiffness"])
        self._task = asyncio.create_task(self._run(session, guidance), name="freedrive")

    def renew(self, session: int, timeout_s: float) -> None:
        """Keep freedrive active for another `timeout_s`.

        Args:
            session: session number.

        Raises:
            ConflictError: the session has ended (the error gives the reason), another freedrive session is
                active, or another client has control.
        """
        if session != self._number:
            raise ConflictError(f"there is no freedrive session {session}: start one without `session`")
        if self.state.session is None:
            ended = self.state.ended
            raise ConflictError(f"freedrive has ended: {ended}", details=ended.fields())
        # only the client that guides the arm may renew, because it must still be connected
        if not CLIENT.get().same(self._client):
            raise ConflictError(f"freedrive was started by {self._client}; no other client may renew it")
        self._streams.require_control()
        self._hold(timeout_s)

    def require(self, client: RequestClient) -> None:
        """Check that this client is guiding the arm now.

        Raises:
            ConflictError: freedrive is off, or another client has started it.
        """
        if self.state.session is None:
            raise ConflictError("hand guiding is off; begin it first with POST /robot/freedrive")
        if not client.same(self._client):
            raise ConflictError(f"the arm is guided by {self._client}")

    async def end(self, reason: str = OFF) -> None:
        """Switch freedrive off. Returns when the arm is at rest. Does nothing if it is off."""
        if (session := self._session) is not None:
            session.end(reason)
            await asyncio.shield(session.ended)

    def close(self) -> None:
        """Stop sending targets, because the service is ending. rtloop then ends the session."""
        if self._task is not None:
            self._task.cancel()

    def _hold(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._until_s = self._link.clock.now_s() + timeout_s

    def _require_able(self) -> bool:
        """Check that the device supports freedrive. Return whether it releases the arm itself, without
        springs.
        """
        named = self._link.device()
        if named is None:
            raise ConflictError("freedrive: the capabilities of the robot's backend cannot be read")
        backend, device = named
        refusal = device.capabilities.lacks(backend, "guiding the arm by hand", "freedrive")
        if refusal:
            raise NotSupportedError(SWITCHED_OFF if self._is_switched_off else refusal)
        return device.capabilities.guides

    def _require_untouched(self, by_device: bool) -> None:
        """Check that nothing is pushing the arm, because any measured effort would move it."""
        state, limits = self._link.state(), self._robot.limits
        force = float(np.linalg.norm(state.wrench[:3]))
        if by_device and force > PUSHED_N:
            raise ConflictError(
                f"freedrive: the TCP already feels {force:.1f} N, allowed: {PUSHED_N:g} N; let go of "
                "the arm, and check that its tool is set (POST /robot/tool)",
                details={"cause": "pushed"},
            )
        external = state.record["external_effort"]
        shares = np.abs(external) / limits.max_effort
        joint = int(shares.argmax())
        if shares[joint] > PUSHED_SHARE:
            raise ConflictError(
                f"freedrive: {limits.names[joint]} already feels {external[joint]:.1f} N·m, allowed: "
                f"{PUSHED_SHARE * limits.max_effort[joint]:.1f} N·m; let go of the arm, and check that "
                "its tool is set (POST /robot/tool)",
                details={"cause": "pushed"},
            )

    async def _run(self, session: StreamSession, guidance: Guidance | None) -> None:
        """Send targets until the session ends, then wait until the arm is at rest."""
        try:
            await (self._watch(session) if guidance is None else self._guide(session, guidance))
        except CobotError as exc:
            session.end(str(exc))
        finally:
            # the session has already ended, unless an unexpected exception was raised
            session.end("freedrive has failed")
        reason = await asyncio.shield(session.ended)
        self._ended = reason
        if self._session is session:  # otherwise the next session has begun
            self._session = None

    async def _watch(self, session: StreamSession) -> None:
        """End freedrive if it is not renewed, and report joints outside their limits. Used while the device
        itself releases the arm for hand guiding.
        """
        while not session.over:
            await asyncio.sleep(PERIOD_S)
            if self._link.clock.now_s() > self._until_s:
                session.end(f"freedrive was not renewed for {self._timeout_s:g} s")
                return
            self._limited_by = outside(self._robot.limits, self._link.state().position)

    async def _guide(self, session: StreamSession, guidance: Guidance) -> None:
        before_s, sequence = self._link.clock.now_s(), 0
        target = self._link.state().commanded_position.copy()
        while not session.over:
            await asyncio.sleep(PERIOD_S)
            now_s, state = self._link.clock.now_s(), self._link.state()
            if now_s > self._until_s:
                session.end(f"freedrive was not renewed for {self._timeout_s:g} s")
                return
            lead = np.clip(target - state.commanded_position, -MAX_LEAD_RAD, MAX_LEAD_RAD)
            external, step_s = state.record["external_effort"], min(now_s - before_s, MAX_STEP_S)
            held = state.commanded_position + lead
            target, self._limited_by = guidance.step(held, state.position, external, step_s)
            before_s, sequence = now_s, sequence + 1
            setpoint = session.setpoint.copy()
            setpoint["joints"], setpoint["joint_velocity"] = target, guidance.velocity
            setpoint["feed_forward"], setpoint["number"] = True, sequence
            session.take_setpoint(sequence, setpoint)
