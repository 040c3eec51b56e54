"""Smoothing of a polyline in joint space."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from cobot.errors import CollisionError
from cobot.planners.held import Held
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import time_optimal
from cobot.polynomials import control_points
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 5
FIRST_POINTS, LAST_POINTS = 12, 400
LOOKS = 4
"""Samples per piece at which constraints are checked before the path is timed."""


def smooth_motion(
    robot: RobotDescription, corners: Array, limits: JointLimits, held: Held | None = None
) -> Trajectory:
    """A motion near a polyline, shape (n, dof), that is free of collisions.

    The points are the control polygon of a clamped B-spline. The path stays within their hull, therefore
    within the position limits. It has the exact start and end, and four continuous derivatives. Points are
    added along the polyline until the path touches nothing and keeps the constraints as well as the polyline
    does.

    Raises:
        CollisionError: it still touches something with `LAST_POINTS` points.
    """
    points = FIRST_POINTS
    while True:
        spline = control_spline(resampled(corners, points))
        is_last = points >= LAST_POINTS
        points *= 2
        if not is_last and (
            robot.collision.clearance.contact(pieces_of(spline)) is not None
            or (held is not None and held.excess(spline(np.linspace(0.0, 1.0, LOOKS * points))).max() > 0.0)
        ):
            continue
        trajectory = time_optimal(robot, JointCurve.of_spline(spline), limits).trajectory
        try:
            robot.collision.check_trajectory(trajectory)
        except CollisionError:
            if is_last:
                raise
        else:
            return trajectory


def resampled(corners: Array, count: int) -> Array:
    """`count` control points along a polyline, shape (count, dof), including its ends.

    They are at the Greville abscissae, so that the spline of a straight line has constant speed.
    """
    knots = _knots(count)
    greville = np.array([knots[i + 1 : i + DEGREE + 1].mean() for i in range(count)])
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    return np.stack([np.interp(greville * reached[-1], reached, column) for column in corners.T], axis=1)


def control_spline(points: Array) -> BSpline:
    """The clamped uniform B-spline over [0, 1] with the given control points, shape (n, dof)."""
    from scipy.interpolate import BSpline

    return BSpline(_knots(len(points)), points, DEGREE)


def pieces_of(spline: BSpline) -> Array:
    """A spline as Bezier curves, for `Clearance.contact`: control points, shape (n, degree + 1, dof)."""
    borders = np.unique(spline.t)
    orders = np.arange(spline.k + 1)
    factorials = np.array([factorial(int(order)) for order in orders])
    derivatives = np.array([spline(borders[:-1], nu=int(order)) for order in orders])
    return control_points((derivatives / factorials[:, None, None]).transpose(1, 2, 0), np.diff(borders))


def _knots(points: int) -> Array:
    return np.concatenate([np.zeros(DEGREE), np.linspace(0.0, 1.0, points - DEGREE + 1), np.ones(DEGREE)])
