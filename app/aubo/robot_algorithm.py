"""RobotAlgorithm: kinematics and dynamics of the model; nothing moves.

Results with several parts are JSON, [value, 0], like the vendor's tuples. The second part is always 0,
because the answer to a failed call contains the error code and no value.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from app.aubo.poses import as_list, numbers_of, place_of
from app.aubo.registry import Json, service
from cobot.errors import InputError
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse, inverse_all
from cobot.types import Array, Pose

if TYPE_CHECKING:
    from app.robot_services import Services

TIMEOUT_S = 20.0
MIN_POSES = 3
ALIKE = 1e-3
"""Lower bound of the smallest singular value. Below it, the orientations of the poses are too similar to
determine the tool's tip.
"""


@service("RobotAlgorithm")
def forward_kinematics(robot: Services, q: list[float]) -> Json:
    """Forward kinematics: the pose of the tool's tip at joint angles.

    Args:
        q: joint angles, rad, one for each joint.

    Returns:
        JSON: [[x, y, z, rx, ry, rz], 0] in the base frame, m and rad.
    """
    return [numbers_of(_forward(robot, q)), 0]


@service("RobotAlgorithm")
def forward_tool_kinematics(robot: Services, q: list[float]) -> Json:
    """Forward kinematics: the flange pose at joint angles.

    Args:
        q: joint angles, rad, one for each joint.

    Returns:
        JSON: [[x, y, z, rx, ry, rz], 0] in the base frame, m and rad.
    """
    return [numbers_of(robot.settings.flange(_forward(robot, q))), 0]


@service("RobotAlgorithm")
async def inverse_kinematics(robot: Services, qnear: list[float], pose: list[float]) -> Json:
    """Inverse kinematics: joint angles for a pose of the tool's tip. If there are several solutions, the one
    nearest to qnear is returned.

    Args:
        qnear: joint angles, rad, one for each joint.
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.

    Returns:
        JSON: [[q1, q2, ...], 0], rad.
    """
    return [await _inverse(robot, place_of(pose), qnear), 0]


@service("RobotAlgorithm")
async def inverse_tool_kinematics(robot: Services, qnear: list[float], pose: list[float]) -> Json:
    """Inverse kinematics: joint angles for a pose of the flange. If there are several solutions, the one
    nearest to qnear is returned.

    Args:
        qnear: joint angles, rad, one for each joint.
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.

    Returns:
        JSON: [[q1, q2, ...], 0], rad.
    """
    return [await _inverse(robot, robot.settings.tcp_of_flange(place_of(pose)), qnear), 0]


@service("RobotAlgorithm")
async def inverse_kinematics_all(robot: Services, pose: list[float]) -> Json:
    """All branches of the inverse kinematics for a pose of the tool's tip. With seven joints, each branch is
    a circle of the elbow.

    Args:
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.

    Returns:
        JSON: [[[q1, q2, ...], ...], 0], rad. For each branch, the solution nearest to the middle of the
            limits; with seven joints, one for each interval of the elbow's circle that the limits permit.
    """
    work = partial(_inverse_all, pose=place_of(pose))
    return [[as_list(joints) for joints in await robot.planning.compute(work, TIMEOUT_S)], 0]


@service("RobotAlgorithm")
def inverse_dynamics(robot: Services, q: list[float], qd: list[float], qdd: list[float]) -> list[float]:
    """Inverse dynamics: the torques for a motion, without friction.

    Args:
        q: joint angles, rad, one for each joint.
        qd: joint velocities, rad/s.
        qdd: joint accelerations, rad/s².

    Returns:
        the torques, N·m, one for each joint, including gravity and the drives' own inertia.
    """
    joints, velocity, acceleration = (
        _joints(robot, values, name) for values, name in ((q, "q"), (qd, "qd"), (qdd, "qdd"))
    )
    model = robot.robot.model
    return as_list(model.mass_matrix(joints) @ acceleration + model.bias_torques(joints, velocity))


@service("RobotAlgorithm")
def forward_dynamics(robot: Services, q: list[float], qd: list[float], torques: list[float]) -> list[float]:
    """Forward dynamics: the accelerations that torques cause, without friction.

    Args:
        q: joint angles, rad, one for each joint.
        qd: joint velocities, rad/s.
        torques: joint torques, N·m.

    Returns:
        the accelerations, rad/s², one for each joint.
    """
    joints, velocity, efforts = (
        _joints(robot, values, name) for values, name in ((q, "q"), (qd, "qd"), (torques, "torques"))
    )
    model = robot.robot.model
    rest = efforts - model.bias_torques(joints, velocity)
    return [float(value) for value in np.linalg.solve(model.mass_matrix(joints), rest)]


@service("RobotAlgorithm")
def calibrate_tcp_position(robot: Services, poses: Json) -> Json:
    """Calculate the position of the tool's tip from poses of the flange in which the tip touched the same
    point.

    Args:
        poses: JSON: three or more poses [x, y, z, rx, ry, rz] of the flange in the base frame, as from
            getToolPose, m and rad. They must be rotated about at least two axes.

    Returns:
        JSON: [[x, y, z] of the tip in the flange's frame, m; the largest distance of the tip from the touched
            point, m].
    """
    if not isinstance(poses, list) or len(poses) < MIN_POSES:
        raise InputError(f"poses must be a list of {MIN_POSES} poses or more")
    flanges = [_pose(values, f"poses[{index}]") for index, values in enumerate(poses)]
    turns = np.array([flange.rotation for flange in flanges])
    places = np.array([flange.position for flange in flanges])
    # R tip + p is the same point for all poses, so the differences from the mean are linear in the tip.
    spread = np.concatenate(turns - turns.mean(axis=0))
    tip, _, _, singular = np.linalg.lstsq(spread, -np.concatenate(places - places.mean(axis=0)), rcond=None)
    if singular[-1] < ALIKE:
        raise InputError(
            "poses: the flange is rotated too little, or about only one axis, to determine the tip"
        )
    touched = turns @ tip + places
    return [tip.tolist(), float(np.linalg.norm(touched - touched.mean(axis=0), axis=1).max())]


def _forward(robot: Services, q: list[float]) -> Pose:
    return robot.robot.model.forward(_joints(robot, q, "q"))


async def _inverse(robot: Services, tcp: Pose, qnear: list[float]) -> list[float]:
    work = partial(_nearest, pose=tcp, near=_joints(robot, qnear, "qnear"))
    return as_list(await robot.planning.compute(work, TIMEOUT_S))


def _nearest(robot: RobotDescription, pose: Pose, near: Array) -> Array:
    return inverse(robot.model, pose, near)


def _inverse_all(robot: RobotDescription, pose: Pose) -> list[Array]:
    return inverse_all(robot.model, pose)


def _joints(robot: Services, values: list[float], name: str) -> Array:
    dof = robot.robot.limits.dof
    if len(values) != dof:
        raise InputError(f"{name} must have {dof} numbers, one for each joint, got {len(values)}")
    return np.array(values)


def _pose(values: object, name: str) -> Pose:
    numbers = isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in values
    )
    if not isinstance(values, list) or not numbers:
        raise InputError(f"{name} must be a list of numbers")
    return place_of(values, name)
