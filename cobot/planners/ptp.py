"""Point to point: all joints start and stop together. The motion takes the shortest time, or is straight in
joint space.
"""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.errors import PlanningError
from cobot.motions.requests import MotionRequest
from cobot.planners.effort_reserve import PLANNED_EFFORT
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.profile import fastest_profile
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import keeps_effort, stretch_to_limits
from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array, JointLimits, Synchronization

MIN_PIECE_S = 1e-9
MAX_DURATION_S = 3600.0
"""If Ruckig finds no profile and the motion in phase would take longer than this, in seconds, the motion is
rejected: its limits are close to 0.
"""


def plan_ptp(robot: RobotDescription, request: MotionRequest, goal: Array) -> Trajectory:
    """Plan a ptp motion. Depending on the request's `synchronization`, it is either time-optimal within the
    velocity, acceleration and jerk limits, or straight in joint space. A motion that needs more than
    `PLANNED_EFFORT` of a drive is slowed down.

    Ruckig's profiles are piecewise cubics, which are converted exactly, not sampled.

    Raises:
        PlanningError: no profile exists, or a drive cannot even hold the arm along the path.
    """
    limits = request.scaled_limits(robot)
    if request.synchronization is Synchronization.PHASE:
        motion = _in_phase(request.start, goal, limits)
    else:
        motion = _in_time(request.start, goal, limits)
    motion = stretch_to_limits(motion, limits)
    if keeps_effort(robot.model, motion, limits, PLANNED_EFFORT):
        return motion
    straight = request.synchronization is Synchronization.PHASE
    path = JointCurve.straight(request.start, goal) if straight else JointCurve.of_trajectory(motion)
    return time_optimal(robot, path, limits).trajectory


def fastest_s(start: Array, goal: Array, limits: JointLimits) -> float:
    """The time that the slowest joint needs alone, s. No motion from rest to rest is faster."""
    return _in_time(start, goal, limits).duration_s


def _in_phase(start: Array, goal: Array, limits: JointLimits) -> Trajectory:
    """Time the share of the path with one profile, which all joints follow."""
    way = goal - start
    moved = np.abs(way) > 0.0
    amounts = np.abs(way[moved])
    problem = ruckig.InputParameter(1)
    problem.target_position = [1.0]
    problem.max_velocity = [float((limits.max_velocity[moved] / amounts).min())]
    problem.max_acceleration = [float((limits.max_acceleration[moved] / amounts).min())]
    problem.max_jerk = [float((limits.max_jerk[moved] / amounts).min())]
    solution = fastest_profile(problem)
    share = from_profiles(solution.profiles[0], solution.duration)
    coefficients = share.coefficients * way[:, None]
    coefficients[:, :, 0] += start
    return Trajectory(share.breakpoints_s, coefficients)


def _in_time(start: Array, goal: Array, limits: JointLimits) -> Trajectory:
    """Move all joints in the time that the slowest one needs, and in proportion to each other if that takes
    no longer.
    """
    problem = ruckig.InputParameter(limits.dof)
    problem.current_position = start.tolist()
    problem.target_position = goal.tolist()
    problem.max_velocity = limits.max_velocity.tolist()
    problem.max_acceleration = limits.max_acceleration.tolist()
    problem.max_jerk = limits.max_jerk.tolist()
    problem.synchronization = ruckig.Synchronization.Phase
    try:
        solution = fastest_profile(problem)
    except PlanningError:
        # Ruckig finds no profile for some motions in which a joint turns by a small part of a degree.
        motion = _in_phase(start, goal, limits)
        if motion.duration_s > MAX_DURATION_S:
            raise
        return motion
    return from_profiles(solution.profiles[0], solution.duration)


def from_profiles(profiles: list[ruckig.Profile], duration_s: float) -> Trajectory:
    """One trajectory of cubics, made from Ruckig's profiles of all joints for a motion from rest."""
    # For each joint, the start times, positions, velocities, accelerations and jerks of its pieces, shape
    # (dof, 5, 8).
    rows = np.array([[[0.0, *each.t], each.p, each.v, each.a, [*each.j, 0.0]] for each in profiles])
    begins = rows[:, 0] = rows[:, 0].cumsum(axis=1)
    times = np.sort(np.minimum(np.append(begins, duration_s), duration_s))
    keep = np.append(True, times[1:] - times[:-1] > MIN_PIECE_S)
    times = times[keep]
    times[-1] = duration_s
    middles = 0.5 * (times[:-1] + times[1:])
    joints = np.arange(len(profiles))[:, None]
    pieces = (begins[:, None, :] <= middles[:, None]).sum(axis=2) - 1
    begun, p, v, a, jerk = rows[joints, :, pieces].transpose(2, 0, 1)
    since = times[:-1] - begun
    coefficients = np.zeros((len(times) - 1, len(profiles), ORDER))
    acceleration = a + jerk * since
    velocity = v + a * since + jerk * since**2 / 2
    position = p + v * since + a * since**2 / 2 + jerk * since**3 / 6
    coefficients[:, :, :4] = np.array([position, velocity, acceleration / 2, jerk / 6]).T
    return Trajectory(times, coefficients)
