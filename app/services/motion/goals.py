"""Converts requested goals in any frame into goals of motions: names, joint angles, poses and arcs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cobot.config import PlanningSection
from cobot.errors import InputError
from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.robot.limits import check_positions
from cobot.types import Array, JointLimits, NamedPosition, Pose

TOOL = "tool"
"""The frame_id that means the TCP frame."""
NOWHERE = Pose.from_abc(*[0.0] * 6)
"""Placeholder for the target of an arc that is defined by its angle and therefore has no target pose."""


class Goals:
    """Converts goals for one robot into planning requests. Looks up its named positions and frames.

    Attributes:
        taught: named positions in addition to those from the SRDF, by name.
        budget_s: planning budget of a motion whose request gives none, s.
    """

    def __init__(self, robot: RobotDescription, settings: PlanningSection) -> None:
        self._robot = robot
        self._settings = settings
        self.taught: dict[str, NamedPosition] = {}
        self.budget_s = settings.budget_s

    def named(self, name: str) -> Array:
        """Return the joint angles of a named position, shape (dof,), rad.

        Raises:
            InputError: there is no such position; the error lists the valid ones.
        """
        position = self._robot.positions.get(name) or self.taught.get(name)
        if position is None:
            valid = ", ".join(dict.fromkeys([*self._robot.positions, *self.taught]))
            raise InputError(f"there is no named position {name!r}; valid names: {valid}")
        return np.array(position.joints)

    def require_joints(
        self, angles: Array, *, name: str = "joints", limits: JointLimits | None = None, checked: bool = True
    ) -> None:
        """Check that joint angles are valid for this robot.

        Args:
            name: field name, for error messages.
            limits: the robot's own limits, or tighter ones.
            checked: whether to check the limits here. If false, planning checks them.

        Raises:
            InputError: the number of angles differs from the number of the robot's joints.
            LimitError: an angle is beyond the limits.
        """
        limits = limits or self._robot.limits
        if len(angles) != limits.dof:
            raise InputError(f"{name} must have {limits.dof} angles, got {len(angles)}")
        if checked:
            check_positions(limits, angles, share=1.0)

    def pose(self, goal: MotionRequest, frame: str) -> MotionRequest:
        """Convert a goal to the base frame. A goal in the TCP frame is converted only when the motion begins.

        Args:
            goal: a goal whose poses and points are in `frame`, which is "tool" or a frame of `Goals.frame`.

        Raises:
            InputError: the frame is unknown or moves, or this robot does not support a field.
        """
        goal.check_for(self._robot)
        if (frame or self._settings.default_frame) == TOOL:
            return replace(goal, in_tool=True)
        place = self.frame(frame)
        return goal if place is None else placed(goal, place)

    def placed(self, pose: Pose, frame: str) -> Pose:
        """Convert a pose from a frame to the base frame. Raises the same errors as `frame`."""
        place = self.frame(frame)
        return pose if place is None else place @ pose

    def frame(self, frame: str) -> Pose | None:
        """Return the pose of a fixed frame in the base frame; None for the base frame itself.

        Raises:
            InputError: there is no such frame, or it moves with the joints.
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
            raise InputError(f"frame_id: {name!r} moves with the joints; valid names: {valid}")
        raise InputError(f"frame_id: there is no frame {name!r}; valid names: {valid}")

    def request(self, goal: MotionRequest, start: Array) -> MotionRequest:
        """Create the planning request for a goal from the joint position `start`, which has shape (dof,), in
        rad.
        """
        if goal.in_tool:
            goal = placed(goal, self._robot.model.forward(start))
        return replace(goal, start=start, timeout_s=self._settings.timeout_s)


def placed(goal: MotionRequest, frame: Pose) -> MotionRequest:
    """Convert a goal from a frame to the base frame. `frame` is the pose of that frame in the base frame."""
    via = None if goal.via is None else frame.apply(goal.via)
    arc = goal.arc
    if arc is not None:
        axis = None if arc.axis is None else frame.rotation @ arc.axis
        arc = replace(arc, centre=frame.apply(arc.centre), axis=axis)
    through = tuple(frame @ pose for pose in goal.through)
    target = frame @ goal.goal if isinstance(goal.goal, Pose) else goal.goal
    return replace(goal, goal=target, via=via, arc=arc, through=through, in_tool=False)


def check_radii(goals: Sequence[MotionRequest], radii_m: Sequence[float]) -> None:
    """Check that there is one radius for each motion except the last one, or no radius at all.

    Raises:
        InputError: the number of radii is wrong.
    """
    if radii_m and len(radii_m) != len(goals) - 1:
        raise InputError(
            f"radii: {len(goals)} motions need {len(goals) - 1}, one for each motion except the "
            f"last; got {len(radii_m)}"
        )
