"""Following a path of the TCP: what lin and circ have in common.

First the joints go on from where they stand, each pose from the one before. Where that leads to a limit, a
singularity or a collision, or takes much longer than the TCP would need, an S-R-S arm's arm angle is planned
along the path (`cobot/planners/redundancy.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cobot.errors import CobotError, InputError, PlanningError, UnreachableError
from cobot.findings import Finding
from cobot.motions.requests import MotionRequest
from cobot.planners.checks import is_there
from cobot.planners.joint_path import (
    LARGEST_DEVIATION_M,
    LARGEST_DEVIATION_RAD,
    POSE_SHARE,
    SHORTEST_SHARE,
    JointsAt,
    at_limit_of,
    jump_of,
    through,
)
from cobot.planners.null_space import FEW, FINER, MANY, Particles
from cobot.planners.path import Path
from cobot.planners.redundancy import MESHES, Graph, Profile
from cobot.planners.tcp_path import PLACES, TcpPath, angles_between
from cobot.planners.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import MIN_GAP_M, Arm, apart, cause_of
from cobot.trajectory import Trajectory
from cobot.types import Array, CartesianLimits, JointLimits

STANDING_M, STANDING_RAD = 1e-6, 1e-6
FAR = 0.5
"""Where some configurations come beyond this share of a path, more of them may find the rest; at more places
too, where they have come to its end by ways that no smooth one could be made of."""
STEP_RAD = 0.4
"""Where a joint would turn further from one place to the next, there is one more between them."""
STEPS = 60
"""A descent from one place to the next takes no more steps."""
SLOW = 2.5
"""A motion that takes so many times as long as the TCP alone would is compared with one of the graph."""


def follow(robot: RobotDescription, request: MotionRequest, path: TcpPath) -> Trajectory | None:
    """A trajectory whose TCP stays within `LARGEST_DEVIATION_*` of the path; None if the path is a point.

    Raises:
        UnreachableError: saying at what percentage of the path which joint cannot go on.
        CollisionError: what would be touched.
        PlanningError: the joints cannot follow at a useful speed, or not accurately enough.
    """
    if path.length_m < STANDING_M and path.angle_rad < STANDING_RAD:
        return None
    path = replace(path, free=request.free_axes)
    tcp = tcp_limits(robot, request)
    _require_reach(robot, path, request.start)
    simple, reason = _continued(robot, request.start, path)
    if simple is not None and _stands(simple):
        return None
    motion = None
    if simple is not None and _is_free(robot, simple):
        try:
            motion = _timed(robot, request, simple, tcp)
        except (PlanningError, InputError) as exc:
            reason = exc
    if motion is not None and motion.duration_s <= SLOW * _shortest_s(path, tcp):
        return motion
    other, reached = _redundant(robot, request.start, path, len(MESHES) if motion is None else 1)
    if other is not None:
        motions = [_timed(robot, request, other, tcp), *([] if motion is None else [motion])]
        return min(motions, key=lambda one: one.duration_s)
    if motion is None and simple is not None:
        return _timed(robot, request, simple, tcp)  # What it touches is said by the check of all motions.
    if motion is None:
        assert reason is not None
        raise _refused(_arm(robot, path), reason, reached)
    return motion


def _arm(robot: RobotDescription, path: TcpPath) -> Arm:
    return robot.model.kinematics(path.free)


def _stands(joint_path: Path) -> bool:
    """Whether the joints need not move: the TCP only turns where it is free to, or by less than counts."""
    places = joint_path.at(np.linspace(0.0, joint_path.length, PLACES))
    return is_there(places[0], places)


def _refused(arm: Arm, reason: CobotError, reached: float) -> UnreachableError:
    """Why neither the simple way nor any other configuration of a redundant arm leads to the end."""
    if not arm.redundant:
        return UnreachableError(str(reason), findings=reason.findings)
    if arm.arm_angle is not None:
        more = f"no arm angle leads further than {100 * reached:.0f} % of the path"
        if reached >= 1.0:
            more = "no other arm angles lead along the path without touching something"
    else:
        more = f"no other joints that were looked for lead further than {100 * reached:.0f} % of the path"
        if reached >= 1.0:
            more = "the other joints that were looked for lead along it only with a jump or a collision"
    findings = [*reason.findings, Finding("redundancy", "share of the path", reached, 1.0, "", reached)]
    return UnreachableError(f"{reason}; {more}", findings=findings)


def _timed(
    robot: RobotDescription, request: MotionRequest, joint_path: Path, tcp: CartesianLimits
) -> Trajectory:
    return time_optimal(robot, joint_path, request.scaled_limits(robot), tcp).trajectory


def tcp_limits(robot: RobotDescription, request: MotionRequest) -> CartesianLimits:
    scaling, speed = request.scaling, request.tcp_speed
    limits = robot.cartesian_limits.scaled(scaling.speed, scaling.acceleration, scaling.jerk)
    return replace(
        limits,
        max_linear_velocity=min(limits.max_linear_velocity, speed.linear_m_s or np.inf),
        max_angular_velocity=min(limits.max_angular_velocity, speed.angular_rad_s or np.inf),
    )


def _shortest_s(path: TcpPath, limits: CartesianLimits) -> float:
    """How long the TCP's own limits make the path take, whatever the joints do."""
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


def _is_free(robot: RobotDescription, joint_path: Path) -> bool:
    return robot.collision.clearance.contact(joint_path.bezier()) is None


def _redundant(
    robot: RobotDescription, start: Array, path: TcpPath, meshes: int
) -> tuple[Path | None, float]:
    """A free path of the joints by planning the arm angle, from coarse to fine, and how far any leads."""
    reached = 0.0
    arm = _arm(robot, path)
    if arm.arm_angle is None:
        return _by_particles(robot, start, path) if arm.redundant else (None, reached)
    for mesh in MESHES[:meshes]:
        graph = Graph(robot, start, path, mesh)
        for free in (False, True):
            for profile in graph.profiles(free):
                found = _along(robot, start, path, graph.shares, profile)
                if found is not None and _is_free(robot, found):
                    return found, 1.0
            if graph.reached < 1.0:
                break
        reached = max(reached, graph.reached)
        if graph.is_cut():
            break
    return None, reached


def _by_particles(robot: RobotDescription, start: Array, path: TcpPath) -> tuple[Path | None, float]:
    """The same for an arm without an arm angle."""
    reached = 0.0
    for count, factor in ((FEW, 1), (MANY, 1), (FEW, FINER), (MANY, FINER)):
        if count == MANY and reached < (FAR if factor == 1 else 1.0):
            continue
        particles = Particles(robot, start, path, count, factor)
        for rows in particles.ways():
            try:
                found = through(robot, path, particles.shares, rows, _joints_at(robot, path))
            except UnreachableError:
                continue
            if _is_free(robot, found):
                return found, 1.0
        reached = max(reached, particles.reached)
    return None, reached


def _along(
    robot: RobotDescription, start: Array, path: TcpPath, shares: Array, profile: Profile
) -> Path | None:
    """The joints' path with these arm angles, if they lead to the end."""
    rows = profile.rows(shares[1:])
    if rows is None:
        return None
    try:
        return through(robot, path, shares, np.concatenate([[start], rows]), profile.joints_at)
    except UnreachableError:
        return None


def _require_reach(robot: RobotDescription, path: TcpPath, start: Array) -> None:
    arm = _arm(robot, path)
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
        f"{path.name}: at {100 * end:.0f} % of the path the TCP cannot go on: the goal is out of reach by "
        f"{gap:.3g} m, with {_moving(robot.limits, joint)} most, to {joints[joint]:.3f} "
        f"{robot.limits.unit(joint)}",
        findings=[Finding("reach", "distance beyond the reach", float(gap), 0.0, "m", float(end), (name,))],
    )


def _continued(robot: RobotDescription, start: Array, path: TcpPath) -> tuple[Path | None, CobotError | None]:
    """The joints by inverse kinematics at even places, each from the one before, or why they cannot go on."""
    try:
        shares, rows = _chain(robot, start, path)
        return through(robot, path, shares, rows, _joints_at(robot, path)), None
    except UnreachableError as exc:
        return None, exc


def _joints_at(robot: RobotDescription, path: TcpPath) -> JointsAt:
    """Joints at a share of the path, from near ones."""
    descend = _arm(robot, path).descend

    def joints_at(share: float, near: Array) -> Array | None:
        joints, solved, _, _ = descend(path.poses(np.array([share]))[0], near, STEPS, share=POSE_SHARE)
        return joints if solved else None

    return joints_at


def _chain(robot: RobotDescription, start: Array, path: TcpPath) -> tuple[Array, Array]:
    """Shares, and the joints there, from one to the next."""
    arm = _arm(robot, path)
    descend = partial(arm.descend, steps=STEPS, share=POSE_SHARE)
    even = np.linspace(0.0, 1.0, path.places + 1)
    targets = path.poses(even[1:])
    carried = arm.carried(targets, start, STEPS, STEP_RAD, POSE_SHARE)
    shares, rows = even[: len(carried) + 1].tolist(), [start, *carried]
    ahead = even[: len(carried) : -1].tolist()
    poses = dict(zip(even[1:].tolist(), targets, strict=True))
    while ahead:
        share = ahead[-1]
        pose = poses[share] if share in poses else path.poses(np.array([share]))[0]
        joints, solved, _, _ = descend(pose, rows[-1])
        step = np.abs(joints - rows[-1])
        at_limit = _at_limit(robot.limits, joints, step)
        if solved and not at_limit and step.max() <= STEP_RAD:
            shares.append(ahead.pop())
            rows.append(joints)
        elif share - shares[-1] > SHORTEST_SHARE and not (solved and at_limit):
            ahead.append(0.5 * (shares[-1] + share))
        else:
            beyond = next(place for place in reversed(ahead) if place in poses)
            if not solved and arm.lacking:
                beyond = _farthest(
                    descend, {place: poses[place] for place in ahead if place in poses}, rows[-1]
                )
            if not solved:  # At the next even place it is as far off as a person would call it.
                joints = descend(poses[beyond], rows[-1])[0]
            raise _failure(robot, path, (share, beyond), joints, rows[-1], at_limit, solved)
    return np.array(shares), np.array(rows)


def _farthest(descend: Callable[..., Any], poses: dict[float, Array], near: Array) -> float:
    """At which share of these poses an arm with few joints stays furthest away, by lin's tolerance."""

    def excess(share: float) -> float:
        _, _, distance_m, angle_rad = descend(poses[share], near)
        return float(max(distance_m / LARGEST_DEVIATION_M, angle_rad / LARGEST_DEVIATION_RAD))

    return max(poses, key=excess)


def _at_limit(limits: JointLimits, joints: Array, step: Array) -> list[int]:
    """The joints that this step has driven into a limit."""
    stuck = ((joints <= limits.min_position) | (joints >= limits.max_position)) & (step > 1e-9)
    return [int(joint) for joint in stuck.nonzero()[0]] if stuck.any() else []


def _moving(limits: JointLimits, joint: int) -> str:
    return f"{limits.names[joint]} {'sliding' if limits.unit(joint) == 'm' else 'turning'}"


def _failure(
    robot: RobotDescription,
    path: TcpPath,
    shares: tuple[float, float],
    joints: Array,
    before: Array,
    at_limit: list[int],
    solved: bool,
) -> UnreachableError:
    """Why it ends at the first of these shares; `joints` are those of the second if they are not solved."""
    share, next_share = shares
    place = f"{path.name}: at {100 * share:.0f} % of the path"
    limits = robot.limits
    for joint in at_limit:
        low, high = limits.min_position[joint], limits.max_position[joint]
        limit = low if joints[joint] - low < high - joints[joint] else high
        return at_limit_of(place, limits, joint, float(joints[joint]), float(limit), share)
    joint = int(np.abs(joints - before).argmax())
    name = limits.names[joint]
    if solved:
        return jump_of(place, limits, joint, abs(float(joints[joint] - before[joint])), share)
    pose, target = robot.model.forward(joints), path.pose_at(next_share)
    missing = float(np.linalg.norm(pose.position - target.position))
    angle = float(angles_between(pose.quaternion[None], target.quaternion[None], path.free)[0])
    cause = cause_of(robot.model, target, joints, path.free, share)
    if cause.finding is not None and cause.finding.check == "limit":
        beyond = limits.names.index(cause.finding.of[0])
        return at_limit_of(place, limits, beyond, cause.finding.value, cause.finding.limit, share)
    allowed = ""
    if robot.model.inverse_kinematics.lacking:
        allowed = f" after {100 * next_share:.0f} %, allowed are 0.05 mm and 0.01 degrees"
    return UnreachableError(
        f"{place} the TCP cannot go on: {cause.says}; it stays {apart(missing, angle)} away{allowed}, "
        f"with {_moving(limits, joint)} most, to {joints[joint]:.3f} {limits.unit(joint)}",
        findings=[
            *([] if cause.finding is None else [cause.finding]),
            Finding("reach", "distance to the path", missing, 0.0, "m", share, (name,)),
            Finding("reach", "angle to the path", angle, 0.0, "rad", share, (name,)),
        ],
    )
