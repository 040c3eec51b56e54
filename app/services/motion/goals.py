"""What clients ask for, as goals of motions: names, joint angles, poses and arcs, in whatever frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.services.motion.tool_and_limits import compose
from cobot.config import PlanningSection
from cobot.errors import InputError
from cobot.motions.checks import (
    check_arc,
    check_end,
    check_free_axes,
    check_synchronization,
    check_tcp_speed,
    check_through,
    check_via,
)
from cobot.motions.constraints import Constraints
from cobot.motions.requests import ANY_SPEED, Arc, MotionRequest, TcpSpeed
from cobot.robot.description import RobotDescription
from cobot.robot.frames import pose_from_abc, rotation_matrix
from cobot.robot.limits import check_positions
from cobot.types import (
    RRT_CONNECT,
    Algorithm,
    Array,
    FreeAxis,
    NamedPosition,
    PlannerName,
    Pose,
    Scaling,
    Synchronization,
)

TOOL = "tool"
"""The frame_id of what is given in the TCP's frame."""
NOWHERE = pose_from_abc(*[0.0] * 6)
"""The target of an arc by an angle, which ends wherever that leads."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to go, and how: see `MotionRequest`."""

    target: Array | Pose
    scaling: Scaling
    planner: PlannerName = PlannerName.PTP
    via: Array | None = None
    algorithm: Algorithm = RRT_CONNECT
    synchronization: Synchronization = Synchronization.TIME
    arc: Arc | None = None
    through: tuple[Pose, ...] = ()
    radius_m: float = 0.0
    tcp_speed: TcpSpeed = ANY_SPEED
    constraints: Constraints | None = None
    free_axes: tuple[FreeAxis, ...] = ()
    cyclic: bool | None = None
    end_joints: Array | None = None
    in_tool: bool = False
    """All poses and points are given in the TCP's frame, as it is where the motion begins."""

    def placed(self, frame: Pose) -> Goal:
        """The same in the base frame, of what is given in a frame whose pose there is `frame`."""
        via = None if self.via is None else _point(frame, self.via)
        arc = self.arc
        if arc is not None:
            axis = None if arc.axis is None else rotation_matrix(frame.quaternion) @ arc.axis
            arc = replace(arc, centre=_point(frame, arc.centre), axis=axis)
        through = tuple(compose(frame, pose) for pose in self.through)
        target = compose(frame, self.target) if isinstance(self.target, Pose) else self.target
        return replace(self, target=target, via=via, arc=arc, through=through, in_tool=False)


class Goals:
    """Makes goals of what one robot is asked for, and of a goal what a planner is asked for.

    Attributes:
        taught: named positions beside those of the SRDF, by name.
    """

    def __init__(self, robot: RobotDescription, settings: PlanningSection) -> None:
        self._robot = robot
        self._settings = settings
        self.taught: dict[str, NamedPosition] = {}

    def named(
        self,
        name: str,
        scaling: Scaling,
        synchronization: Synchronization = Synchronization.TIME,
        *,
        checked: bool = True,
    ) -> Goal:
        """The goal of a named position; see `joints`.

        Raises:
            InputError: there is no such position; lists the valid ones.
        """
        position = self._robot.positions.get(name) or self.taught.get(name)
        if position is None:
            valid = ", ".join(dict.fromkeys([*self._robot.positions, *self.taught]))
            raise InputError(f"there is no named position {name!r}; valid are: {valid}")
        return self.joints(list(position.joints), scaling, synchronization, checked=checked)

    def joints(
        self,
        angles: list[float],
        scaling: Scaling,
        synchronization: Synchronization = Synchronization.TIME,
        *,
        checked: bool = True,
    ) -> Goal:
        """The goal of joint angles, rad.

        Args:
            checked: against the limits, which planning does too.

        Raises:
            InputError: another number of joints than the robot has.
            LimitError: beyond joint_limits.yaml.
        """
        limits = self._robot.limits
        if len(angles) != limits.dof:
            raise InputError(f"joints must have {limits.dof} angles, got {len(angles)}")
        target = np.array(angles, dtype=np.float64)
        if checked:
            check_positions(limits, target, share=1.0)
        return Goal(target, scaling, synchronization=synchronization)

    def pose(self, goal: Goal, frame: str) -> Goal:
        """A goal whose target is a pose of the TCP, in a frame: see `in_frame`.

        Raises:
            InputError: a frame that is unknown or moves, or fields that do not fit the planner.
        """
        name = goal.planner
        check_via(name, goal.via, goal.arc)
        check_arc(goal.arc)
        check_synchronization(name, goal.synchronization)
        check_through(name, goal.through, goal.radius_m)
        check_free_axes(goal.free_axes)
        check_end(name, goal.cyclic, goal.end_joints)
        if goal.end_joints is not None and len(goal.end_joints) != self._robot.limits.dof:
            raise InputError(
                f"end_joints: must have {self._robot.limits.dof} angles, got {len(goal.end_joints)}"
            )
        check_tcp_speed(name, goal.tcp_speed, self._robot.cartesian_limits)
        return self.in_frame(goal, frame)

    def in_frame(self, goal: Goal, frame: str) -> Goal:
        """A goal that is given in a frame: the base's, the TCP's where the motion begins (tool), or one that
        no joint moves.

        Raises:
            InputError: there is no such frame, or it moves.
        """
        if (frame or self._settings.default_frame) == TOOL:
            return replace(goal, in_tool=True)
        place = self.frame(frame)
        return goal if place is None else goal.placed(place)

    def placed(self, pose: Pose, frame: str) -> Pose:
        """A pose of a frame in the base frame; raises as `frame` does."""
        place = self.frame(frame)
        return pose if place is None else compose(place, pose)

    def frame(self, frame: str) -> Pose | None:
        """Where a frame is that does not move with the joints; None for the base frame itself.

        Raises:
            InputError: there is no such frame, or it moves.
        """
        base, model = self._robot.base_frame, self._robot.model
        name = frame or self._settings.default_frame
        if name == base:
            return None
        fixed = model.fixed_frames
        if name in fixed:
            return fixed[name]
        named = self._robot.collision.scene.frames
        if name in named:
            pose = np.array(named[name])
            return Pose(pose[:3], pose[3:])
        valid = (
            ", ".join([base, TOOL, *sorted((set(fixed) | set(named)) - {base})]) + f", or empty for {base}"
        )
        if name in model.frame_names or name == TOOL:
            raise InputError(f"frame_id: {name!r} moves with the joints; valid are: {valid}")
        raise InputError(f"frame_id: there is no frame {name!r}; valid are: {valid}")

    def request(self, goal: Goal, start: Array) -> MotionRequest:
        """What the planner is asked for, from where the arm stands, rad."""
        if goal.in_tool:
            goal = goal.placed(self._robot.model.forward(start))
        return MotionRequest(
            start,
            goal.target,
            goal.planner,
            goal.scaling,
            goal.via,
            timeout_s=self._settings.timeout_s,
            algorithm=goal.algorithm,
            synchronization=goal.synchronization,
            arc=goal.arc,
            through=goal.through,
            radius_m=goal.radius_m,
            tcp_speed=goal.tcp_speed,
            constraints=goal.constraints,
            free_axes=goal.free_axes,
            cyclic=goal.cyclic,
            end_joints=goal.end_joints,
        )


def check_radii(goals: Sequence[Goal], radii_m: Sequence[float]) -> None:
    """There is a radius for each corner, or none at all.

    Raises:
        InputError: it is not so.
    """
    if radii_m and len(radii_m) != len(goals) - 1:
        raise InputError(
            f"radii: {len(goals)} motions need {len(goals) - 1}, one for each but the last; "
            f"got {len(radii_m)}"
        )


def _point(frame: Pose, point: Array) -> Array:
    """A point of a frame in the base frame."""
    return np.asarray(frame.position + rotation_matrix(frame.quaternion) @ point)
