"""Prepares servo points for rtloop: solves the inverse kinematics, and keeps points until their session
begins.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from app.services.state.link import RobotLink
from app.services.streaming.servo_wrench import ServoWrench
from app.services.streaming.sessions import StreamSession
from cobot.errors import CobotError
from cobot.ipc.layout import POINTS
from cobot.ipc.stream_writer import PointWriter
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import continued
from cobot.servo.fields import BrokenRule, Refusal
from cobot.servo.protocol import Point, ServoRules
from cobot.types import Array, Pose

FAILURE_COST = 4.0
"""Pause after a failed inverse kinematics, as a multiple of its duration. Without it, many unreachable points
would keep the service busy.
"""


class PointInverse:
    """Solves the inverse kinematics of points. Each solution is the one nearest to the solution for the
    previous point.
    """

    def __init__(self, robot: RobotDescription, link: RobotLink) -> None:
        self._robot = robot
        self._link = link
        self._before: Array | None = None
        self._not_before_s = 0.0

    def restart(self) -> None:
        """Start again: the solution for the next point is the one nearest to the arm's commanded position."""
        self._before = None

    def accept(self, joints: Sequence[float]) -> None:
        """Record the joint angles of an accepted point, shape (dof,), in rad. The next point continues from
        them.
        """
        self._before = np.array(joints)

    def joints(self, point: Point) -> Sequence[float]:
        """Calculate the joint angles for a point. Shape: (dof,), in rad. Raises BrokenRule if the point is
        out of reach or was not calculated.
        """
        if not point.cartesian:
            return point.position
        # Not the service's clock, on which no time need pass during the computation.
        begun_s = time.perf_counter()
        if self._link.clock.now_s() < self._not_before_s:
            raise BrokenRule(
                Refusal.INVERSE_KINEMATICS,
                "the inverse kinematics of this point was not tried, because it failed for "
                "the previous point",
            )
        x, y, z, rx, ry, rz = point.position
        try:
            near = self._link.state().commanded_position if self._before is None else self._before
            pose = Pose.from_abc(x, y, z, rz, ry, rx)
            joints: list[float] = continued(self._robot.model, pose, near).tolist()
            return joints
        except CobotError as exc:
            cost_s = time.perf_counter() - begun_s
            self._not_before_s = self._link.clock.now_s() + FAILURE_COST * cost_s
            raise BrokenRule(Refusal.INVERSE_KINEMATICS, str(exc)) from None


class ServoPoints:
    """Accepts points, keeps those that arrive before their session has begun, and counts rejected ones."""

    def __init__(
        self, link: RobotLink, rules: ServoRules, inverse: PointInverse, wrench: ServoWrench
    ) -> None:
        self._rules = rules
        self._inverse = inverse
        self._wrench = wrench
        self._writer = PointWriter(link.memory)
        self._waiting: deque[tuple[Sequence[float], Point]] = deque()

    @property
    def waiting(self) -> int:
        """Number of points that are waiting for the session to begin."""
        return len(self._waiting)

    def drop(self) -> int:
        """Drop the waiting points, and return their number."""
        dropped = len(self._waiting)
        self._waiting.clear()
        return dropped

    def begin(self, session: StreamSession) -> None:
        """Pass the waiting points to a session that has begun."""
        self._writer.begin(session.number)
        self._wrench.begin(session)
        while self._waiting:
            self._pass_on(*self._waiting.popleft(), session)

    def take(self, point: Point, session: StreamSession | None) -> None:
        """Pass a point to the session, or keep it until the session begins.

        Raises:
            BrokenRule: the point is rejected and counted.
        """
        try:
            if session is not None and session.over:
                raise BrokenRule(Refusal.NOT_ACTIVE, f"the servo session is over: {session.over}")
            joints = self._inverse.joints(point)
            if session is None:
                if len(self._waiting) >= POINTS:
                    raise BrokenRule(
                        Refusal.OVERRUN,
                        f"{POINTS} points are already waiting for the session to begin, which is the maximum",
                    )
                self._waiting.append((joints, point))
            else:
                self._put(joints, point, session)
        except BrokenRule as exc:
            self._rules.refuse(exc.kind, str(exc))
            raise
        self._inverse.accept(joints)
        self._rules.accept(point)

    def _pass_on(self, joints: Sequence[float], point: Point, session: StreamSession) -> None:
        """Pass an accepted point to the session, possibly one that had to wait for it."""
        try:
            self._put(joints, point, session)
        except BrokenRule as exc:
            self._rules.accepted -= 1
            self._rules.refuse(exc.kind, str(exc))

    def _put(self, joints: Sequence[float], point: Point, session: StreamSession) -> None:
        self._wrench.update(session)
        if not self._writer.put(joints, point.time_s, point.lookahead_s, point.gain):
            raise BrokenRule(Refusal.OVERRUN, f"the buffer is full, because {POINTS} points wait in it")
