"""Following a path of the TCP: what lin and circ have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from cobot.errors import PlanningError, UnreachableError
from cobot.motions.requests import MotionRequest
from cobot.planners.time_law import PathRates, TimeLaw, joint_rates, traverse
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.robot.frames import angle_between
from cobot.robot.inverse_kinematics import LEAST_GAP_M, reach_gap, solve_near
from cobot.trajectory import Trajectory
from cobot.types import Array, CartesianLimits, JointLimits, Pose

LARGEST_DEVIATION_M = 1e-4
LARGEST_DEVIATION_RAD = np.radians(0.05)
FIRST_SAMPLES, LAST_SAMPLES = 24, 768
LARGEST_JOINT_STEP_RAD = 0.5
"""A joint may turn by so much between two of the first samples, and by less where there are more of them."""
SLOWEST = 50.0
"""A path that takes so many times longer than by the TCP's own limits leads through or past a singularity:
refused, because nobody wants a tool that nearly stops on the way."""
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
    scaling = request.scaling
    cap = _tcp_rates(path, robot.cartesian_limits.scaled(scaling.speed, scaling.acceleration, scaling.jerk))
    limits = request.scaled_limits(robot)
    samples = FIRST_SAMPLES
    while samples <= LAST_SAMPLES:
        joint_path = _joint_path(robot, request.start, path, samples)
        rates = joint_rates(joint_path, limits, cap)
        _require_speed(joint_path, rates, cap, limits, path.name)
        law = TimeLaw(rates)
        trajectory = traverse(joint_path, law, samples, limits)
        deviation_m, deviation_rad = deviation(robot, trajectory, path, law)
        if deviation_m <= LARGEST_DEVIATION_M and deviation_rad <= LARGEST_DEVIATION_RAD:
            return trajectory
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


def deviation(
    robot: RobotDescription, trajectory: Trajectory, path: TcpPath, law: TimeLaw
) -> tuple[float, float]:
    """How far (m, rad) the TCP is at the most from where the path is at that moment, between knots too."""
    knots = trajectory.breakpoints_s
    times = np.concatenate([knots[:-1] + share * np.diff(knots) for share in (0.25, 0.5)])
    shares = np.clip(law.at(times * (law.duration_s / trajectory.duration_s))[0], 0.0, 1.0)
    worst_m = worst_rad = 0.0
    for joints, share in zip(trajectory.sample(times), shares, strict=True):
        pose, target = robot.model.forward(joints), path.pose_at(float(share))
        worst_m = max(worst_m, float(np.linalg.norm(pose.position - target.position)))
        worst_rad = max(worst_rad, angle_between(pose.quaternion, target.quaternion))
    return worst_m, worst_rad


def _joint_path(robot: RobotDescription, start: Array, path: TcpPath, samples: int) -> BSpline:
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
    return make_interp_spline(shares, np.array(rows), k=5)


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


def _tcp_rates(path: TcpPath, limits: CartesianLimits) -> PathRates:
    length, angle = max(path.length_m, 1e-9), max(path.angle_rad, 1e-9)
    linear = PathRates(
        limits.max_linear_velocity / length,
        limits.max_linear_acceleration / length,
        limits.max_linear_jerk / length,
    )
    angular = PathRates(
        limits.max_angular_velocity / angle,
        limits.max_angular_acceleration / angle,
        limits.max_angular_jerk / angle,
    )
    return linear.capped(angular)


def _require_speed(path: BSpline, rates: PathRates, cap: PathRates, limits: JointLimits, name: str) -> None:
    if 1.0 / rates.velocity <= SLOWEST * TimeLaw(cap).duration_s:
        return
    shares = np.linspace(0.0, 1.0, 400)
    demand = np.abs(path.derivative(1)(shares)) * cap.velocity / limits.max_velocity
    sample, joint = np.unravel_index(int(demand.argmax()), demand.shape)
    raise PlanningError(
        f"{name}: at {100 * shares[sample]:.0f} % of the path {limits.names[int(joint)]} would have to turn "
        f"{demand[sample, joint]:.0f} times faster than it may: the path leads past a singularity"
    )
