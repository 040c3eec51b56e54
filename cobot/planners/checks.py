"""The checks that every plan must pass."""

from __future__ import annotations

import numpy as np

from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_efforts, check_limits
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

ALREADY_THERE_RAD = 1e-6
TOLERANCE = 1e-9
"""Share of a limit by which rounding may make a planned motion exceed it."""


def validate(
    robot: RobotDescription, trajectory: Trajectory, limits: JointLimits, labels: list[str] | None = None
) -> None:
    """Check a motion: its limits at the true extrema, its efforts, and collisions of the arm with itself and
    its surroundings.

    An arm that was pushed beyond a limit may move back, but not further out.

    Raises:
        LimitError: see `check_limits` and `check_efforts`.
        CollisionError: the arm touches itself or its surroundings; see the collision checker.
    """
    check_limits(trajectory, limits.including(trajectory.start), labels, TOLERANCE)
    check_efforts(robot.model, trajectory, limits)
    robot.collision.check_trajectory(trajectory)


def is_there(start: Array, goal: Array) -> bool:
    """Whether the arm is already at the goal."""
    return bool(np.abs(goal - start).max() < ALREADY_THERE_RAD)
