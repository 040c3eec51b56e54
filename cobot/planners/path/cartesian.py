"""Joint motion along a TCP path, which lin and circ share.

First each pose is solved from the joints of the previous one. If that leads to a limit, a singularity or a
collision, or takes much longer than the TCP would need, the arm angle of an S-R-S arm is planned along the
path (`cobot/planners/path/redundancy.py`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cobot.errors import CobotError, InputError, PlanningError, UnreachableError
from cobot.findings import Finding
from cobot.motions.requests import MotionRequest
from cobot.planners.path.continued import SAME_RAD, STEPS, continued, joints_at, moving, share_along
from cobot.planners.path.joint_path import through
from cobot.planners.path.null_space import FEW, FINER, MANY, Particles
from cobot.planners.path.redundancy import ENCLOSING, MESHES, Profile, RedundancyGraph
from cobot.planners.path.tcp_path import PLACES, TcpPath
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import MIN_GAP_M, Arm
from cobot.trajectory import Trajectory
from cobot.types import Array, CartesianLimits

STANDING_M, STANDING_RAD = 1e-6, 1e-6
FAR = 0.5
"""Share of the path that the first start configurations must reach before further configurations are
tried. Further points are tried only after a configuration has reached the end.
"""
SLOW = 2.5
"""If a motion is slower by this factor than the TCP limits require, it is compared with a motion found by the
graph.
"""


def follow(
    robot: RobotDescription, request: MotionRequest, path: TcpPath, end: Array | None = None
) -> Trajectory | None:
    """Plan a motion whose TCP stays within `MAX_DEVIATION_*` of the path; None if the path is a point.

    Args:
        end: joints at the end of the motion, shape (dof,), with the TCP at the end of the path; None means
            any.

    Raises:
        UnreachableError: a joint cannot follow the path; the message names the joint and the path share.
        CollisionError: the motion touches something.
        PlanningError: the joints cannot follow at a useful speed or accurately enough.
    """
    if path.length_m < STANDING_M and path.angle_rad < STANDING_RAD:
        return None
    path = replace(path, free=request.free_axes)
    joint_limits, tcp = request.scaled_limits(robot), tcp_limits(robot, request)
    _require_reach(robot, path, request.start)
    simple, reason = continued(robot, request.start, path, end)
    if simple is not None:
        places = simple.at(np.linspace(0.0, simple.length, PLACES))
        if (
            np.abs(places - places[0]).max() < SAME_RAD
        ):  # the TCP only turns about free axes or by a negligible angle
            return None
    motion = None
    if simple is not None and _is_free(robot, simple):
        try:
            motion = time_optimal(robot, simple, joint_limits, tcp).trajectory
        except (PlanningError, InputError) as exc:
            reason = exc
    if motion is not None and motion.duration_s <= SLOW * _shortest_s(path, tcp):
        return motion
    other, reached = _plan_redundancy(robot, request.start, path, end, motion is not None)
    if other is not None:
        motions = [time_optimal(robot, other, joint_limits, tcp).trajectory]
        return min([*motions, *([] if motion is None else [motion])], key=lambda one: one.duration_s)
    if motion is None and simple is not None:  # the final check reports what it touches
        return time_optimal(robot, simple, joint_limits, tcp).trajectory
    if motion is None:
        assert reason is not None
        raise _unreachable(robot.model.kinematics(path.free), reason, reached, end)
    return motion


def _unreachable(arm: Arm, reason: CobotError, reached: float, end: Array | None) -> UnreachableError:
    """The error for a path that cannot be followed to its end, neither by the simple solution nor, for a
    redundant arm, by any other configuration.
    """
    if not arm.redundant:
        return UnreachableError(str(reason), findings=reason.findings)
    if arm.arm_angle is not None:
        more = f"no arm angle reaches beyond {100 * reached:.0f} % of the path"
        if reached >= 1.0:
            more = "no other arm angles follow the path without a collision"
    else:
        more = f"none of the other joint angles tried reaches beyond {100 * reached:.0f} % of the path"
        if reached >= 1.0:
            more = "the other joint angles tried reach its end only with a jump or a collision"
    if end is not None:
        more += ", with the required joint angles at its end"
    findings = [*reason.findings, Finding("redundancy", "share of the path", reached, 1.0, "", reached)]
    return UnreachableError(f"{reason}; {more}", findings=findings)


def tcp_limits(robot: RobotDescription, request: MotionRequest) -> CartesianLimits:
    speed = request.tcp_speed
    limits = robot.cartesian_limits.scaled(*request.scaling.shares)
    return replace(
        limits,
        max_linear_velocity=min(limits.max_linear_velocity, speed.linear_m_s or np.inf),
        max_angular_velocity=min(limits.max_angular_velocity, speed.angular_rad_s or np.inf),
    )


def _shortest_s(path: TcpPath, limits: CartesianLimits) -> float:
    """The shortest duration that the TCP's own limits allow, ignoring the joint limits."""
    times = []
    for way, velocity, acceleration, jerk in (
        (
            path.length_m,
            limits.max_linear_velocity,
            limits.max_linear_acceleration,
            limits.max_linear_jerk,
        ),
        (
            path.angle_rad,
            limits.max_angular_velocity,
            limits.max_angular_acceleration,
            limits.max_angular_jerk,
        ),
    ):
        short = max(2.0 * math.sqrt(way / acceleration), (32.0 * way / jerk) ** (1.0 / 3.0))
        times.append(max(short, way / velocity + velocity / acceleration + acceleration / jerk))
    return float(max(times))


def _is_free(robot: RobotDescription, joint_path: JointCurve) -> bool:
    return robot.collision.clearance.contact(joint_path.bezier()) is None


def _plan_redundancy(
    robot: RobotDescription, start: Array, path: TcpPath, end: Array | None, possible: bool
) -> tuple[JointCurve | None, float]:
    """A collision-free joint path, found by planning the arm angle from coarse to fine; and the greatest
    share of the path that any attempt reached.

    Args:
        possible: whether a collision-free path is known. Then only the coarsest mesh is tried.
    """
    reached = 0.0
    arm = robot.model.kinematics(path.free)
    if arm.arm_angle is None:
        return _plan_by_particles(robot, start, path, end) if arm.redundant else (None, reached)
    is_open = possible
    for mesh in MESHES[: 1 if possible else len(MESHES)]:
        leading = RedundancyGraph(robot, start, path, mesh, end, leading_on=True)
        if not leading.has_way(free=False):
            reached = reached if reached == 1.0 else leading.reached
            continue
        reached = 1.0
        if not leading.has_way(free=True):
            if not is_open:
                enclosing = RedundancyGraph(robot, start, path, ENCLOSING, end, leading_on=True)
                if not enclosing.has_way(free=True):
                    break
            is_open = True
            continue
        graph = RedundancyGraph(robot, start, path, mesh, end)
        for profile in graph.profiles():
            found = _along(robot, start, path, graph.shares, profile, end)
            if found is not None and _is_free(robot, found):
                return found, 1.0
    return None, reached


def free_share(robot: RobotDescription, start: Array, path: TcpPath) -> float:
    """The share of a path that the joints can follow from `start` without a collision. Collisions are only
    checked at evenly spaced places, so this is a quick estimate, not a proof.
    """
    simple = share_along(robot, start, path)
    if robot.model.kinematics(path.free).arm_angle is None:
        return simple
    graph = RedundancyGraph(robot, start, path, MESHES[0], leading_on=True)
    graph.has_way(free=True)
    return max(simple, graph.reached)


def _plan_by_particles(
    robot: RobotDescription, start: Array, path: TcpPath, end: Array | None
) -> tuple[JointCurve | None, float]:
    """The same result as `_plan_redundancy`, for an arm without an arm angle."""
    reached, first = 0.0, None
    for count, factor in ((FEW, 1), (MANY, 1), (FEW, FINER), (MANY, FINER)):
        if count == MANY and reached < (FAR if factor == 1 else 1.0):
            continue
        if first is not None and reached < 1.0:
            goes_on = first.may_go_on(count, factor)
            reached = max(reached, first.reached)
            if not goes_on:
                continue
        particles = Particles(robot, start, path, count, factor, end)
        first = first or particles
        for rows in particles.ways():
            try:
                found = through(robot, path, particles.shares, rows, joints_at(robot, path))
            except UnreachableError:
                continue
            if _is_free(robot, found):
                return found, 1.0
        reached = max(reached, particles.reached)
    return None, reached


def _along(
    robot: RobotDescription,
    start: Array,
    path: TcpPath,
    shares: Array,
    profile: Profile,
    end: Array | None,
) -> JointCurve | None:
    """The joint path with the arm angles of `profile`; None if it does not reach the end."""
    rows = profile.rows(shares[1:])
    if rows is None:
        return None
    if end is not None:
        if np.abs(rows[-1] - end).max() > SAME_RAD:
            return None
        rows[-1] = end
    try:
        return through(robot, path, shares, np.concatenate([[start], rows]), profile.joints_at)
    except UnreachableError:
        return None


def _require_reach(robot: RobotDescription, path: TcpPath, start: Array) -> None:
    arm = robot.model.kinematics(path.free)
    gap = arm.gap(path.poses(np.ones(1))[0])
    if gap <= MIN_GAP_M:
        return
    shares = np.linspace(0.0, 1.0, 101)
    poses = path.poses(shares)
    place = next(place for place, pose in enumerate(poses) if arm.gap(pose) > MIN_GAP_M)
    end, joints = shares[place], arm.descend(poses[place], start, STEPS)[0]
    joint = int(np.abs(joints - start).argmax())
    name = robot.limits.names[joint]
    raise UnreachableError(
        f"{path.name}: at {100 * end:.0f} % of the path the TCP cannot continue: the goal is out of reach by "
        f"{gap:.3g} m, with {moving(robot.limits, joint)} most, to {joints[joint]:.3f} "
        f"{robot.limits.unit(joint)}",
        findings=[Finding("reach", "distance beyond the reach", float(gap), 0.0, "m", float(end), (name,))],
    )
