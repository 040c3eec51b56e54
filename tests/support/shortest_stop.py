"""The shortest stops within the limits of the joints, by Ruckig and numpy."""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

SHARES = np.linspace(1.0, 0.05, 951)
"""Shares of the jerk and acceleration of an even stop that are tried."""
COARSE, FINE = np.linspace(0.0, 1.0, 100), np.linspace(0.0, 1.0, 3000)
"""Places in each phase of a stop on the path where the limits are checked: first, and then."""


def rest_of_joints(state: Array, limits: JointLimits) -> Array:
    """Where each joint rests that brakes as fast as it may, shape (dof,), rad.

    Args:
        state: position, velocity and acceleration, shape (3, dof).
    """
    return _end(_stop(state, limits.max_acceleration, limits.max_jerk))


def rest_on_path(path: Trajectory, path_time_s: float, limits: JointLimits) -> Array | None:
    """Where the arm rests, shape (dof,), rad, that brakes on its path from full rate, by the shortest stop
    of path time with one bound for its jerk with which every joint keeps its limits all along; None if there
    is no such stop.
    """
    velocity = np.abs(path.sample([path_time_s], 1)[0]) + 1e-12
    acceleration, jerk = (
        np.array([(bound / velocity).min()]) for bound in (limits.max_acceleration, limits.max_jerk)
    )
    start = np.array([[path_time_s], [1.0], [0.0]])
    for share in SHARES:
        stop = _stop(start, share * acceleration, share * jerk)
        if _keeps(stop, path, limits, COARSE) and _keeps(stop, path, limits, FINE):
            return path.sample(_end(stop))[0]
    return None


def _stop(state: Array, acceleration: Array, jerk: Array) -> ruckig.Trajectory:
    """Ruckig's fastest stop of each axis, from position, velocity and acceleration."""
    axes = state.shape[1]
    problem = ruckig.InputParameter(axes)
    problem.control_interface = ruckig.ControlInterface.Velocity
    problem.synchronization = ruckig.Synchronization.No
    problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
    problem.max_velocity = [10.0] * axes  # not used by this interface
    problem.max_acceleration, problem.max_jerk = acceleration.tolist(), jerk.tolist()
    problem.target_velocity = [0.0] * axes
    stop = ruckig.Trajectory(axes)
    ruckig.Ruckig(axes).calculate(problem, stop)
    return stop


def _end(stop: ruckig.Trajectory) -> Array:
    end, _, _ = stop.at_time(stop.duration)
    return np.array(end)


def _keeps(stop: ruckig.Trajectory, path: Trajectory, limits: JointLimits, places: Array) -> bool:
    """Whether each joint keeps its acceleration and jerk during a stop of path time."""
    profile = stop.profiles[0][0]
    t = np.array(profile.t)[:, None] * places
    s, r, a, j = (np.array(values)[: len(t), None] for values in (profile.p, profile.v, profile.a, profile.j))
    times_s = (s + t * (r + t * (a / 2 + t * j / 6))).ravel()
    rate = (r + t * (a + t * j / 2)).reshape(-1, 1)
    slope, bend = (a + t * j).reshape(-1, 1), np.broadcast_to(j, t.shape).reshape(-1, 1)
    first, second, third = (path.sample(times_s, derivative) for derivative in (1, 2, 3))
    acceleration = second * rate**2 + first * slope
    jerk = third * rate**3 + 3.0 * second * rate * slope + first * bend
    return bool(
        (np.abs(acceleration) <= limits.max_acceleration).all() and (np.abs(jerk) <= limits.max_jerk).all()
    )
