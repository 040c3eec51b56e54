"""Servo sessions: the arm follows points that clients send one by one, in one of seven modes.

This module connects the protocol's rules in `cobot.servo.protocol` with the modes in rtloop. `servo_sessions`
begins and ends sessions, `servo_points` handles their points, and `servo_wrench` handles their wrench.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Any

from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService
from app.services.streaming.servo_points import PointInverse, ServoPoints
from app.services.streaming.servo_sessions import ServoSessions
from app.services.streaming.servo_wrench import ServoWrench
from app.services.streaming.sessions import StreamService
from cobot import audit
from cobot.errors import CobotError, ConflictError, InputError, LimitError, UnavailableError, UnreachableError
from cobot.ipc.layout import ServoMode
from cobot.robot.description import RobotDescription
from cobot.servo.fields import BrokenRule, Refusal
from cobot.servo.protocol import FjtControl, Point, ServoRules, SetMode, Stop

FAR_POINT = (
    "the first point of the session is too far from the arm and is not followed: begin with the measured "
    "state, or move to the first point beforehand"
)


class ServoService:
    """Manages one robot's servo sessions, one at a time. A session holds the claim on the arm.

    Attributes:
        rules: the protocol's state and counts.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        streams: StreamService,
        force: ForceService,
    ) -> None:
        self._robot = robot
        limits = robot.limits
        self.rules = ServoRules(
            limits.min_position.tolist(),
            limits.max_position.tolist(),
            streams.period_s,
            [limits.unit(joint) for joint in range(limits.dof)],
        )
        self._link = link
        self._streams = streams
        inverse = PointInverse(robot, link)
        self._points = ServoPoints(link, self.rules, inverse, ServoWrench(force, link.memory.dof))
        self._sessions = ServoSessions(link, streams, force, self.rules, self._points, inverse)

    def restore_limits(self) -> None:
        """Use the robot's current position limits."""
        limits = self._robot.limits
        self.rules.limit_positions(limits.min_position.tolist(), limits.max_position.tolist())

    @property
    def active(self) -> bool:
        """Whether a session accepts points."""
        return self.rules.active

    @property
    def reason(self) -> str:
        """Reason why the last session ended or could not begin; "" while a session is open."""
        return self._sessions.reason

    @property
    def session(self) -> int:
        """Number of the last session that was requested."""
        return self._sessions.generation

    def holds(self, session: int) -> bool:
        """Whether this session still accepts points."""
        return self.rules.active and self.session == session

    async def handle(self, text: str) -> None:
        """Handle one message from /{robot}/joint_cmd. Rejected messages are counted; see `feedback`."""
        self.receive(text)

    def receive(self, text: str) -> None:
        """Like `handle`, but without waiting. A session begins in the background. Points that arrive before
        it has begun wait for it.
        """
        message = self.rules.read(text)
        if not isinstance(message, Point):  # points have no entries of their own, only their session does
            audit.note("joint_cmd", message=text)
        match message:
            case SetMode():
                self._sessions.request(message)
            case Stop():
                self._sessions.leave("stopped by servo_control", at_once=False)
            case FjtControl():
                self.rules.fjt = message
            case Point():
                try:
                    self._streams.require_control()
                except ConflictError as exc:
                    self.rules.refuse(Refusal.REJECTED, str(exc))
                    return
                with contextlib.suppress(BrokenRule):
                    self._points.take(message, self._sessions.current)

    async def begin(
        self,
        mode: int,
        watchdog_s: float = 0.0,
        send_period_s: float = 0.0,
        *,
        stops: int | None = None,
        owner: str = "",
    ) -> int:
        """Begin a session, after the previous session has ended and the arm is at rest. Mode 0 only ends the
        previous session.

        Args:
            watchdog_s: time without a point after which the session ends, s. 0 means 0.5 s.
            send_period_s: interval between points, s. 0 means the control period.
            stops: `RobotLink.stops` at the time of the request; None for its current value.
            owner: the only client that may send its points; "" for any client.

        Returns:
            The number of the session, for `holds`.

        Raises:
            InputError: the mode does not exist, or a time is out of range.
            ConflictError: another client is moving the arm, or a stop has been requested since the session
                was.
            NotReadyError, ExecutionError, UnavailableError: see `StreamService.open`.
        """
        try:
            request = self.rules.request(mode, watchdog_s, send_period_s)
        except BrokenRule as exc:
            raise InputError(str(exc)) from None
        if request.mode is ServoMode.NONE:
            await self.end()
            return self.session
        task = self._sessions.request(request, stops, owner)
        number = self.session
        await asyncio.shield(task)
        return number

    async def end(self, reason: str = "ended by its owner") -> None:
        """End the session. Returns when the arm is at rest."""
        await self._sessions.end(reason)

    async def point(
        self,
        position: Sequence[float],
        *,
        cartesian: bool = False,
        time_s: float = 0.0,
        lookahead_s: float = 0.0,
        gain: float = 0.0,
        owner: str = "",
    ) -> None:
        """Send a point to the session: joint angles in rad, or a pose [x, y, z, rx, ry, rz]. The other values
        default to 0.

        Args:
            owner: see `begin`.

        Raises:
            ConflictError: there is no session, the buffer is full, or another client has control.
            LimitError, UnreachableError, InputError: the target cannot be reached; the error gives the
                reason.
        """
        self._streams.require_control()
        try:
            point = self.rules.point(
                position, cartesian=cartesian, time_s=time_s, lookahead_s=lookahead_s, gain=gain, owner=owner
            )
        except BrokenRule as exc:
            self.rules.refuse(exc.kind, str(exc))
            raise _error(exc) from None
        try:
            self._points.take(point, self._sessions.current)
        except BrokenRule as exc:
            raise _error(exc) from None

    def feedback(self) -> dict[str, Any]:
        """Report the state of the session, and the points that were rejected since it began. Without a
        session, report the counts of the last session.
        """
        rules = self.rules
        counts = dict.fromkeys(("points_taken", "points_dropped", "points_buffered", "underruns"), 0)
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            counts = {name: getattr(state, name) for name in counts}
        far = counts["points_dropped"] and not counts["points_taken"]
        refused = {str(kind): count for kind, count in rules.refused.items()}
        return {
            "state": self._sessions.phase,
            "mode": int(rules.mode) if rules.active else 0,
            "active": rules.active,
            "session_id": rules.session_id or 0,
            "point_id": rules.point_id or 0,
            "watchdog_timeout": rules.watchdog_s,
            "send_period": rules.send_period_s,
            "points_received": rules.received,
            "points_accepted": rules.accepted,
            "points_refused": rules.refused.total(),
            "refused": refused,
            "last_refusal": rules.last_refusal or (FAR_POINT if far else ""),
            "points_taken": counts["points_taken"],
            "jumps": counts["points_dropped"],
            "buffered": counts["points_buffered"] + self._points.waiting,
            "underruns": counts["underruns"],
            "overruns": rules.refused[Refusal.OVERRUN],
            "reason": self.reason,
        }

    def close(self) -> None:
        """Stop sending points, because the service is ending. rtloop then ends the session."""
        self._sessions.close()


def _error(broken: BrokenRule) -> CobotError:
    """Create the error for the caller of `ServoService.point`."""
    match broken.kind:
        case Refusal.NOT_ACTIVE | Refusal.OVERRUN:
            return ConflictError(str(broken))
        case Refusal.LIMIT:
            return LimitError(str(broken))
        case Refusal.INVERSE_KINEMATICS:
            return UnreachableError(str(broken))
    return InputError(str(broken))
