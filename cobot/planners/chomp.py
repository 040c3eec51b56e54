"""CHOMP: covariant Hamiltonian optimisation (Zucker et al. 2013, doi 10.1177/0278364913488805).

Starts from the straight line in joint space and bends it: the gradient of the obstacle cost pushes
points of the path away from what they touch, and the covariant step, A⁻¹ times the gradient,
spreads every push smoothly over the whole path.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from cobot.errors import PlanningError, PlanningTimeout
from cobot.motions.requests import MotionRequest
from cobot.planners.spline import smooth_motion
from cobot.robot.collision import Proximity
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

POINTS = 40
ITERATIONS = 300
CLEARANCE_M = 0.04
"""ε of the paper's equation 21: obstacles push from this distance on."""
SMOOTHNESS_WEIGHT = 0.05
STEP_RAD = 0.03
"""The largest change of a joint in one iteration."""


def plan_chomp(robot: RobotDescription, request: MotionRequest, goal: Array) -> Trajectory:
    """A smooth motion near the straight line in joint space.

    Raises:
        PlanningError: the descent ended in a path that still touches something; with what, and how deep.
        PlanningTimeout: it took longer than the request allows.
    """
    points = _optimised(robot, request, goal)
    return smooth_motion(robot, points, request.scaled_limits(robot))


def _optimised(robot: RobotDescription, request: MotionRequest, goal: Array) -> Array:
    """The path's points, shape (POINTS, dof), ends included, free of collisions."""
    points = np.linspace(request.start, goal, POINTS)
    stiffness, pull = _smoothness(request.start, goal)
    factor = cho_factor(stiffness)
    limits = robot.limits
    deadline_s = time.monotonic() + request.timeout_s
    for _ in range(ITERATIONS):
        if time.monotonic() > deadline_s:
            raise PlanningTimeout(f"chomp: not done within {request.timeout_s:.1f} s")
        push, deepest = _obstacle_gradient(robot, points)
        if deepest is None:
            return points
        inner = points[1:-1]
        gradient = SMOOTHNESS_WEIGHT * (stiffness @ inner + pull) + push[1:-1]
        step = cho_solve(factor, gradient)
        largest = float(np.abs(step).max())
        if largest < 1e-9:
            break
        inner -= step * min(STEP_RAD / largest, 1.0 / SMOOTHNESS_WEIGHT)
        _into_limits(inner, limits.min_position, limits.max_position, factor, stiffness)
    push, deepest = _obstacle_gradient(robot, points)
    if deepest is None:
        return points
    first, second = (robot.collision.body_name(body) for body in deepest.bodies)
    raise PlanningError(
        f"chomp: found no free path near the straight one: {first} and {second} still at "
        f"{1e3 * deepest.distance_m:.0f} mm; try ompl"
    )


def _smoothness(start: Array, goal: Array) -> tuple[Array, Array]:
    """A and b of the paper's equation 16 for squared accelerations: gradient = A q + b."""
    inner = POINTS - 2
    difference = np.zeros((inner + 2, inner))
    for row in range(inner + 2):
        for column, weight in ((row - 2, 1.0), (row - 1, -2.0), (row, 1.0)):
            if 0 <= column < inner:
                difference[row, column] = weight
    ends = np.zeros((inner + 2, len(start)))
    ends[0], ends[1] = -start, start
    ends[-2], ends[-1] = goal, -goal
    # Rows 0 and -1 see the end points twice: at rest there, the point beyond equals the end.
    return difference.T @ difference, difference.T @ ends


def _obstacle_gradient(robot: RobotDescription, points: Array) -> tuple[Array, Proximity | None]:
    """The gradient of the obstacle cost, shape of `points`, and the deepest violation of the margin.

    Every pair of geoms is a body point with the other one as its obstacle; the cost of a distance d
    is that of equation 21, weighted by how fast the point moves along the path (equation 20, without
    its curvature term, which vanishes on nearly straight paths).
    """
    gradient = np.zeros_like(points)
    velocity = np.gradient(points, axis=0) * (len(points) - 1)
    deepest: Proximity | None = None
    margin_m = robot.collision.margin_m
    for row, joints in enumerate(points):
        for near in robot.collision.proximities(joints, margin_m + CLEARANCE_M):
            distance = near.distance_m - margin_m
            if distance < 0.0 and (deepest is None or near.distance_m < deepest.distance_m):
                deepest = near
            slope = 1.0 if distance < 0.0 else 1.0 - distance / CLEARANCE_M
            away = near.points[0] - near.points[1]
            length = float(np.linalg.norm(away))
            if length < 1e-9:
                continue
            normal = away / length * (1.0 if near.distance_m > 0.0 else -1.0)
            relative = robot.collision.point_jacobian(near.bodies[0], near.points[0])
            relative = relative - robot.collision.point_jacobian(near.bodies[1], near.points[1])
            speed = float(np.linalg.norm(relative @ velocity[row]))
            gradient[row] -= slope * (0.1 + speed) * (normal @ relative)
    return gradient, deepest


def _into_limits(inner: Array, low: Array, high: Array, factor: tuple[Array, bool], stiffness: Array) -> None:
    """Joint limits by the paper's section 4.3: the violation is smoothed by A⁻¹ and taken off, in place."""
    for _ in range(20):
        violation = np.where(inner > high, inner - high, np.where(inner < low, inner - low, 0.0))
        if not violation.any():
            return
        correction = cho_solve(factor, violation)
        for joint in np.flatnonzero(violation.any(axis=0)):
            row = int(np.abs(violation[:, joint]).argmax())
            inner[:, joint] -= correction[:, joint] * violation[row, joint] / correction[row, joint]
    np.clip(inner, low, high, out=inner)
