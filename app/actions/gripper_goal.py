"""Converts action goals to gripper commands, and the gripper's state to feedback and results."""

from __future__ import annotations

import math
from dataclasses import dataclass

from app.graph.actions import RejectedGoalError
from app.services.gripping.commands import has_arrived
from cobot.grippers import GripperCapabilities, GripperState
from cobot.motions.gripper_bodies import GripperGrasp, GripperMove, GripperRequest
from cobot.ros.fingers import FINGER_JOINTS, FingerState
from cobot.ros.messages import Message
from cobot.strict import shown

SAME_M = 1e-6
"""Two finger positions that differ by at most this are equal, m."""
GRASP, RELEASE = 0.0, 1.0
"""Positions that mean grasp and release for a gripper without a width."""


@dataclass(frozen=True, slots=True)
class Grip:
    """A gripper goal, in a common form for both actions.

    Attributes:
        width: requested width, m.
        force: maximum finger force, N. 0 means the gripper's default.
        speed: maximum speed at which the width changes, m/s. 0 means the gripper's default.
    """

    width: float
    force: float = 0.0
    speed: float = 0.0

    def request(self, able: GripperCapabilities) -> GripperRequest:
        """Build the gripper command. A limit above the gripper's own maximum is reduced to it.

        Raises:
            RejectedGoalError: a value is not a number or out of range.
        """
        for name, value in (("position", self.width), ("effort", self.force), ("velocity", self.speed)):
            if not math.isfinite(value) or value < 0.0:
                raise RejectedGoalError(f"{name} is {value:g}; it must be a number from 0 on")
        force = _at_most(self.force, able.force_n, "effort", "N")
        speed = _at_most(self.speed, able.speed_m_s, "velocity", "m/s")
        if able.width_m is None:
            return self._request_without_width(force, speed)
        least, most = able.width_m
        if not least - SAME_M <= self.width <= most + SAME_M:
            raise RejectedGoalError(
                f"the width is {self.width:g} m, but the gripper allows {least:g} to {most:g} m"
            )
        width = min(max(self.width, least), most)
        return GripperRequest(
            "move", GripperMove(width=width, speed=speed, force=force, if_blocked="success")
        )

    def _request_without_width(self, force: float | None, speed: float | None) -> GripperRequest:
        if self.width == GRASP:
            return GripperRequest.of({"command": "grasp", "speed": speed, "force": force})
        if self.width == RELEASE:
            return GripperRequest.of({"command": "release"})
        raise RejectedGoalError(
            f"position is {self.width:g}, but this gripper has no width: 0 grasps, 1 releases"
        )


def _at_most(value: float, able: tuple[float, float] | None, name: str, unit: str) -> float | None:
    """Convert the limit that a goal requests to the limit to command. None means the gripper's default."""
    if value == 0.0:
        return None
    if able is None:
        raise RejectedGoalError(f"{name} is {value:g} {unit}, but the gripper cannot limit it: set it to 0")
    least, most = able
    if value < least:
        raise RejectedGoalError(
            f"{name} is {value:g} {unit}, but the gripper needs at least {least:g} {unit}"
        )
    return min(value, most)


@dataclass(frozen=True, slots=True)
class Grasped:
    """The state of the fingers, compared with a goal.

    Attributes:
        width, force: current width, m, and force, N. NaN if unknown.
        stalled: whether an object has stopped the fingers.
        reached: whether the fingers are at the goal. False if the gripper does not report its width.
    """

    width: float
    force: float
    stalled: bool
    reached: bool

    @classmethod
    def of(
        cls, request: GripperRequest, state: GripperState | None, able: GripperCapabilities, *, ended: bool
    ) -> Grasped:
        """Compare a gripper state with a goal. `state` is None if it is unknown.

        Args:
            ended: whether the command has ended. Until then, the state may be older than the command.
        """
        if state is None:
            return cls(math.nan, math.nan, stalled=False, reached=False)
        width = math.nan if state.width is None else state.width
        force = math.nan if state.force is None else state.force
        if not ended or state.moving:
            return cls(width, force, stalled=False, reached=False)
        command, held = request.command, state.object is not None and state.object.is_held
        moves = isinstance(command, GripperMove)
        there = has_arrived(command.width, state, able) if isinstance(command, GripperMove) else not held
        unseen = held and state.width is None
        wanted = not isinstance(command, GripperGrasp) and there and not unseen
        return cls(width, force, stalled=held or (moves and not there), reached=wanted)

    @property
    def verdict(self) -> Message:
        return {"stalled": self.stalled, "reached_goal": self.reached}


class OneGap:
    """Goals of control_msgs/action/GripperCommand, which contain one position: the width."""

    type_ = "control_msgs/action/GripperCommand"

    @staticmethod
    def read(goal: Message) -> Grip:
        command = goal["command"]
        return Grip(command["position"], command["max_effort"])

    @staticmethod
    def feedback(grasped: Grasped) -> Message:
        return {"position": grasped.width, "effort": grasped.force, **grasped.verdict}

    result = feedback


class FingerJoints:
    """Goals of control_msgs/action/ParallelGripperCommand, which contain two joints. Each slides by half the
    width.
    """

    type_ = "control_msgs/action/ParallelGripperCommand"

    @staticmethod
    def read(goal: Message) -> Grip:
        """
        Raises:
            RejectedGoalError: the joints are not the gripper's, or their values do not match.
        """
        command = goal["command"]
        names, positions = command["name"] or list(FINGER_JOINTS[:1]), command["position"]
        unknown = [name for name in names if name not in FINGER_JOINTS]
        if unknown or len(set(names)) != len(names):
            valid = " and ".join(FINGER_JOINTS)
            raise RejectedGoalError(f"command.name is {shown(names)}; it must contain each of {valid} once")
        if len(positions) != len(names):
            raise RejectedGoalError(f"command.position must be {len(names)} numbers, got {len(positions)}")
        # NaN is not in the range either
        if not all(abs(each - positions[0]) <= SAME_M for each in positions[1:]):
            raise RejectedGoalError(
                f"command.position is {shown(positions)}; it must be the same for both fingers"
            )
        one = {}
        for name in ("velocity", "effort"):
            values = command[name]
            if values and len(values) != len(names):
                raise RejectedGoalError(
                    f"command.{name} must be {len(names)} numbers or none, got {len(values)}"
                )
            one[name] = max(values, default=0.0) if all(map(math.isfinite, values)) else math.nan
        return Grip(2.0 * positions[0], one["effort"], 2.0 * one["velocity"])

    @staticmethod
    def feedback(grasped: Grasped) -> Message:
        return {"state": FingerState(grasped.width, 0.0, grasped.force).message}

    @classmethod
    def result(cls, grasped: Grasped) -> Message:
        return {**cls.feedback(grasped), **grasped.verdict}
