"""Smoothing of a polyline in joint space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from cobot.errors import CollisionError, PlanningError
from cobot.planners.held import Held
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.trajectory import Integers, Trajectory
from cobot.types import Array, JointLimits

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 5
FIRST_POINTS, LAST_POINTS = 12, 400
SAMPLES = 192
"""Number of points at which a path is checked for collisions before it is timed. Only the timed motion is
proven collision-free. A second proof before would take longer than the few timings that it saves.
"""
LOOKS = 4
"""Number of samples per piece at which constraints are checked before the path is timed."""


def smooth_motion(
    robot: RobotDescription, corners: Array, limits: JointLimits, held: Held | None = None
) -> Trajectory:
    """A collision-free motion near a polyline of shape (n, dof).

    The points are the control polygon of a clamped B-spline. The path stays within the hull of these points,
    and therefore within the position limits. It begins and ends exactly at the ends of the polyline, with
    four continuous derivatives. Points are added along the polyline until the path touches nothing and keeps
    the constraints as well as the polyline does.

    Raises:
        CollisionError: the path still touches something with `LAST_POINTS` points.
        PlanningError: a collision-free path cannot be timed, see `time_optimal`.
    """
    points = FIRST_POINTS
    while True:
        curve, pieces = smooth_curve(resampled(corners, points))
        is_last = points >= LAST_POINTS
        points *= 2
        if not is_last and (
            not robot.collision.clearance.are_free(curve.at(np.linspace(0.0, 1.0, SAMPLES))).all()
            or (held is not None and held.excess(curve.at(np.linspace(0.0, 1.0, LOOKS * points))).max() > 0.0)
        ):
            continue
        try:
            trajectory = time_optimal(robot, curve, limits).trajectory
            robot.collision.check_trajectory(trajectory)
            return trajectory
        except PlanningError as exc:
            touches = isinstance(exc, CollisionError) or robot.collision.clearance.contact(pieces) is not None
            if is_last or not touches:  # more points do not make a collision-free path possible
                raise


def resampled(corners: Array, count: int) -> Array:
    """`count` control points along a polyline, including its ends. Shape: (count, dof).

    They are at the Greville abscissae, so that the spline of a straight line has constant speed.
    """
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    places = _unit(count).greville * reached[-1]
    return np.stack([np.interp(places, reached, column) for column in corners.T], axis=1)


def control_spline(points: Array) -> BSpline:
    """The clamped uniform B-spline over [0, 1] with the given control points, shape (n, dof)."""
    from scipy.interpolate import BSpline

    return BSpline(_knots(len(points)), points, DEGREE)


def smooth_curve(points: Array) -> tuple[JointCurve, Array]:
    """The curve of `control_spline`, and its pieces as Bezier curves, with control points of shape (n, degree
    + 1, dof).
    """
    unit = _unit(len(points))
    windows = points[unit.windows]
    powers = np.ascontiguousarray((unit.powers @ windows).transpose(0, 2, 1))
    return JointCurve(unit.breakpoints, powers), unit.bezier @ windows


@dataclass(frozen=True, slots=True)
class _Unit:
    """Data that all curves with the same number of control points share.

    Attributes:
        greville: the Greville abscissae, shape (count,).
        breakpoints: parameters at which the pieces begin and end, shape (n + 1,).
        windows: indices of the control points of each piece, shape (n, degree + 1).
        powers, bezier: matrices that convert the control points of a piece to its coefficients and to its
            Bezier control points, shape (n, degree + 1, degree + 1) each.
    """

    greville: Array
    breakpoints: Array
    windows: Integers
    powers: Array
    bezier: Array


@lru_cache(maxsize=16)
def _unit(count: int) -> _Unit:
    knots = _knots(count)
    greville = np.array([knots[i + 1 : i + DEGREE + 1].mean() for i in range(count)])
    each = JointCurve.of_spline(control_spline(np.eye(count)))
    windows = np.arange(count - DEGREE)[:, None] + np.arange(DEGREE + 1)
    places = np.arange(len(windows))[:, None, None], np.arange(DEGREE + 1)[:, None], windows[:, None]
    powers, bezier = each.coefficients.transpose(0, 2, 1)[places], each.bezier()[places]
    return _Unit(greville, each.breakpoints, windows, powers, bezier)


def _knots(points: int) -> Array:
    return np.concatenate([np.zeros(DEGREE), np.linspace(0.0, 1.0, points - DEGREE + 1), np.ones(DEGREE)])
