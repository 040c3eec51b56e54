"""What a planner is asked for, and the checks that every plan has to pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.errors import InputError
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_limits
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits, PlannerName, Pose, Scaling

ALREADY_THERE_RAD = 1e-6


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """A motion from rest to rest. Picklable: it travels to the planning workers.

    Attributes:
        start: shape (dof,), rad.
        goal: joint angles, shape (dof,), rad, or a pose of the TCP in the base frame.
        via: shape (3,), m in the base frame: a point on the arc, for circ only.
        seed: of the planners that draw random samples.
        timeout_s: after which ompl and chomp give up.
    """

    start: Array
    goal: Array | Pose
    planner: PlannerName
    scaling: Scaling
    via: Array | None = None
    seed: int = 0
    timeout_s: float = 10.0

    def scaled_limits(self, robot: RobotDescription) -> JointLimits:
        """The share of the joint limits that this motion may use."""
        scaling = self.scaling
        return robot.limits.scaled(scaling.speed, scaling.acceleration, scaling.jerk)


def check_via(planner: PlannerName, via: object) -> None:
    """A point on the arc is what circ needs and no other planner takes.

    Raises:
        InputError: there is none for circ, or one for another planner.
    """
    if via is None and planner is PlannerName.CIRC:
        raise InputError("via: is missing; planner circ needs a point on its arc")
    if via is not None and planner is not PlannerName.CIRC:
        raise InputError(f"via: is for planner circ only, not for {planner}")


def validate(
    robot: RobotDescription, trajectory: Trajectory, limits: JointLimits, labels: list[str] | None = None
) -> None:
    """The checks that no motion escapes: limits on true extrema, self-collision and surroundings.

    An arm that stands beyond a limit, because it was pushed there, may move back, but not further out.

    Raises:
        LimitError: from `check_limits`.
        CollisionError: from the collision checker.
    """
    check_limits(trajectory, limits.including(trajectory.start), labels)
    robot.collision.check_trajectory(trajectory)


def is_there(start: Array, goal: Array) -> bool:
    """Whether there is nothing to move."""
    return bool(np.abs(goal - start).max() < ALREADY_THERE_RAD)
