"""What the scenarios begin with: planned motions, postures and poses, made once and kept beside the traces.

They are stored, so that another planner or another inverse kinematics does not touch the traces.
"""

from __future__ import annotations

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.planners import WaypointRequest, plan, plan_waypoints
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling, Waypoint

MOVE = np.array([0.6, 0.2, -0.3, 0.4, 0.2, -0.3, 0.5])


def make(robot: RobotDescription) -> dict[str, Array]:
    """Plan and solve all of it."""
    home = np.array(robot.positions["home"].joints)
    made = _places(robot, home)
    for name, trajectory in _motions(robot, home).items():
        made[f"{name}.times"], made[f"{name}.coefficients"] = (
            trajectory.breakpoints_s,
            trajectory.coefficients,
        )
    return made


def _places(robot: RobotDescription, home: Array) -> dict[str, Array]:
    pose = robot.model.forward(home)
    made = {"home_pose": np.concatenate([pose.position, pose.quaternion])}
    before = home
    for name, place in (
        ("over_the_floor", [0.5, 0.0, 0.25]),
        ("in_the_floor", [0.5, 0.0, 0.0]),
        ("above_floor", [0.5, 0.0, 0.15]),
        ("near_floor", [0.5, 0.0, 0.01]),
        ("near_floor_aside", [0.5, 0.05, 0.01]),
    ):
        before = inverse(robot.model, Pose(np.array(place), pose.quaternion), before)
        reached = robot.model.forward(before)
        made[name] = before
        made[f"{name}_pose"] = np.concatenate([reached.position, reached.quaternion])
    posture = home.copy()
    for _ in range(300):
        null = np.linalg.svd(robot.model.jacobian(posture))[2][-1]
        posture = posture + 1e-3 * null * np.sign(null[2])
    made["posture"] = posture
    made["near_limits"] = home.copy()
    made["near_limits"][[0, 6]] = robot.limits.max_position[0] - 0.2, robot.limits.min_position[6] + 0.2
    made["tucked"] = home + np.array([0.0, 0.7, 0.0, -0.2, 0.0, 0.0, 0.0])
    return made


def _motions(robot: RobotDescription, home: Array) -> dict[str, Trajectory]:
    def planned(planner: PlannerName, goal: Array | Pose, speed: float) -> Trajectory:
        found = plan(robot, MotionRequest(home, goal, planner, Scaling(speed), seed=1))
        assert found is not None
        return found

    pose = robot.model.forward(home)
    ptp = planned(PlannerName.PTP, home + MOVE, 0.5)
    shifted = ptp.coefficients.copy()
    shifted[:, 0, 0] += 0.01
    curve = _curve(robot, home)
    swing = planned(PlannerName.PTP, home + 2.9 * np.eye(7)[0], 0.5)
    beyond = ptp.coefficients.copy()
    beyond[:, 1] *= 12.0
    return {
        "ptp": ptp,
        "lin": planned(
            PlannerName.LIN, Pose(pose.position + np.array([-0.1, 0.2, 0.1]), pose.quaternion), 0.5
        ),
        "ompl": planned(PlannerName.OMPL, home + MOVE, 0.6),
        "curve": curve,
        "curve_too_fast": curve.stretched(0.5),
        "swing_too_fast": swing.stretched(0.02),
        "zigzag_small": _zigzag(robot, home, 0.01, 0.1, 60),
        "zigzag_large": _zigzag(robot, home, 0.3, 0.3, 30),
        "elsewhere": Trajectory(ptp.breakpoints_s, shifted),
        "beyond_a_stop": Trajectory(ptp.breakpoints_s, beyond),
        "no_rest": Trajectory(ptp.breakpoints_s[:4], ptp.coefficients[:3]),
    }


def _curve(robot: RobotDescription, home: Array) -> Trajectory:
    """A smooth detour through four points, timed at the limits."""
    random = np.random.default_rng(5)
    points = np.vstack([home, home + random.uniform(-0.3, 0.3, (4, 7))])
    limits = robot.limits.scaled(0.8, 0.8, 1.0)
    return time_optimal(robot, JointCurve.through(np.linspace(0.0, 1.0, 5), points), limits).trajectory


def _zigzag(
    robot: RobotDescription, home: Array, amplitude_rad: float, step_s: float, turns: int
) -> Trajectory:
    corners = [home + amplitude_rad * (-1) ** i * (i > 0) for i in range(turns)]
    points = [Waypoint(corner.tolist(), step_s * i, None, None, str(i)) for i, corner in enumerate(corners)]
    return plan_waypoints(
        robot, WaypointRequest(home, points, 0.01, check_limits=False, retime=False, approach=None)
    )
