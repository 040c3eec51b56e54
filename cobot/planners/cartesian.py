"""Following a path of the TCP: what lin and circ have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cobot.errors import PlanningError, UnreachableError
from cobot.motions.requests import MotionRequest
from cobot.planners.path import Path
from cobot.planners.time_law import time_optimal
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.robot.frames import angle_between
from cobot.robot.inverse_kinematics import LEAST_GAP_M, reach_gap, solve_near
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits, Pose

LARGEST_DEVIATION_M = 1e-4
LARGEST_DEVIATION_RAD = np.radians(0.05)
FIRST_SAMPLES, LAST_SAMPLES = 24, 768
LARGEST_JOINT_STEP_RAD = 0.5
"""A joint may turn by so much between two of the first samples, and by less where there are more of them."""
STANDING_M, STANDING_RAD = 1e-6, 1e-6


@dataclass(frozen=True, slots=True)
class TcpPath:
    """A path of the TCP over u in [0, 1].

    Attributes:
        name: of the planner, for messages.
        pose_at: the pose in the base frame.
        length_m, angle_rad: how far the TCP travels and turns.
    """

    name: str
    pose_at: Callable[[float], Pose]
    length_m: float
    angle_rad: float


def turn_between(start: Pose, goal: Pose) -> Array:
    """The rotation vector, shape (3,), rad, that takes one orientation to the other the short way."""
    return np.array(quaternion.between(start.quaternion.tolist(), goal.quaternion.tolist()))


def turned(start: Pose, turn: Array, share: float) -> Array:
    """The quaternion after a share of a turn: slerp."""
    return np.array(quaternion.product(quaternion.exp((share * turn).tolist()), start.quaternion.tolist()))


def follow(robot: RobotDescription, request: MotionRequest, path: TcpPath) -> Trajectory | None:
    """A trajectory whose TCP stays within `LARGEST_DEVIATION_*` of the path; None if the path is a point.

    Raises:
        UnreachableError: saying at what percentage of the path which joint cannot go on.
        PlanningError: the joints cannot follow at a useful speed, or not accurately enough.
    """
    if path.length_m < STANDING_M and path.angle_rad < STANDING_RAD:
        return None
    _require_reach(robot, path, request.start)
    scaling, limits = request.scaling, request.scaled_limits(robot)
    tcp_limits = robot.cartesian_limits.scaled(scaling.speed, scaling.acceleration, scaling.jerk)
    samples = FIRST_SAMPLES
    while samples <= LAST_SAMPLES:
        joint_path = _joint_path(robot, request.start, path, samples)
        deviation_m, deviation_rad = deviation(robot, joint_path, path, samples)
        if deviation_m <= LARGEST_DEVIATION_M and deviation_rad <= LARGEST_DEVIATION_RAD:
            return time_optimal(robot, joint_path, limits, tcp_limits).trajectory
        samples *= 2
    raise PlanningError(
        f"{path.name}: the joints cannot follow the path accurately: {1e3 * deviation_m:.2f} mm and "
        f"{np.degrees(deviation_rad):.3f} degrees off, allowed are 0.1 mm and 0.05 degrees"
    )


def _require_reach(robot: RobotDescription, path: TcpPath, start: Array) -> None:
    gap = reach_gap(robot.model, path.pose_at(1.0))
    if gap <= LEAST_GAP_M:
        return
    shares = np.linspace(0.0, 1.0, 101)
    end = next(share for share in shares if reach_gap(robot.model, path.pose_at(share)) > LEAST_GAP_M)
    joints = solve_near(robot.model, path.pose_at(end), start).joints
    joint = int(np.abs(joints - start).argmax())
    raise UnreachableError(
        f"{path.name}: at {100 * end:.0f} % of the path the TCP cannot go on: the goal is out of reach by "
        f"{gap:.3g} m, with {robot.limits.names[joint]} turning most, to {joints[joint]:.3f} rad"
    )


def deviation(robot: RobotDescription, joint_path: Path, path: TcpPath, samples: int) -> tuple[float, float]:
    """How far (m, rad) the TCP is at the most from the path, half way between the samples."""
    shares = (np.arange(samples) + 0.5) / samples
    worst_m = worst_rad = 0.0
    for pose, share in zip(robot.model.poses(joint_path.at(shares)), shares, strict=True):
        target = path.pose_at(float(share))
        worst_m = max(worst_m, float(np.linalg.norm(pose[:3] - target.position)))
        worst_rad = max(worst_rad, angle_between(pose[3:], target.quaternion))
    return worst_m, worst_rad


def _joint_path(robot: RobotDescription, start: Array, path: TcpPath, samples: int) -> Path:
    """Joint angles over u: inverse kinematics at even steps, each from the one before."""
    shares = np.linspace(0.0, 1.0, samples + 1)
    rows = [start]
    for share in shares[1:]:
        descent = solve_near(robot.model, path.pose_at(float(share)), rows[-1])
        at_limit = _at_limit(robot.limits, descent.joints, rows[-1])
        if not descent.solved or at_limit:
            raise UnreachableError(_failure(robot, path, float(share), descent.joints, rows[-1], at_limit))
        jump = np.abs(descent.joints - rows[-1])
        if jump.max() > LARGEST_JOINT_STEP_RAD * FIRST_SAMPLES / samples + 1e-3:
            joint = int(jump.argmax())
            raise UnreachableError(
                f"{path.name}: at {100 * share:.0f} % of the path {robot.limits.names[joint]} would have to "
                f"jump by {jump[joint]:.2f} rad: the path leads through a singularity"
            )
        rows.append(descent.joints)
    return Path.through(shares, np.array(rows))


def _at_limit(limits: JointLimits, joints: Array, before: Array) -> list[int]:
    """The joints that this step has driven into a limit."""
    stuck = (joints <= limits.min_position) | (joints >= limits.max_position)
    return [int(joint) for joint in np.flatnonzero(stuck & (np.abs(joints - before) > 1e-9))]


def _failure(
    robot: RobotDescription, path: TcpPath, share: float, joints: Array, before: Array, at_limit: list[int]
) -> str:
    place = f"{path.name}: at {100 * share:.0f} % of the path"
    limits = robot.limits
    for joint in at_limit:
        limit = limits.min_position[joint] if joints[joint] < 0 else limits.max_position[joint]
        return f"{place} {limits.names[joint]} reaches its limit of {limit:.4f} rad"
    pose, target = robot.model.forward(joints), path.pose_at(share)
    missing = 1e3 * float(np.linalg.norm(pose.position - target.position))
    angle = np.degrees(angle_between(pose.quaternion, target.quaternion))
    joint = int(np.abs(joints - before).argmax())
    return (
        f"{place} the TCP cannot go on: it stays {missing:.1f} mm and {angle:.2f} degrees away, "
        f"with {limits.names[joint]} turning most, to {joints[joint]:.3f} rad"
    )
