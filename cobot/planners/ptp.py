"""Point to point: all joints start and stop together, in the shortest time or straight in joint space."""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.motions.requests import MotionRequest
from cobot.planners.path import Path
from cobot.planners.profile import fastest_profile
from cobot.planners.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import effort_samples, stretch_to_limits
from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array, JointLimits, Synchronization

SHORTEST_PIECE_S = 1e-9


def plan_ptp(robot: RobotDescription, request: MotionRequest, goal: Array) -> Trajectory:
    """Time-optimal under velocity, acceleration and jerk limits, or straight in joint space: as the request's
    `synchronization` says. Where that needs more than a drive's effort, the same path is run more slowly.

    Ruckig's profiles are piecewise cubics; they are taken over exactly, not sampled.

    Raises:
        PlanningError: there is no profile, or a drive cannot even hold the arm on the way.
    """
    limits = request.scaled_limits(robot)
    if request.synchronization is Synchronization.PHASE:
        motion = _in_phase(request.start, goal, limits)
    else:
        motion = _in_time(request.start, goal, limits)
    motion = stretch_to_limits(motion, limits)
    if (np.abs(effort_samples(robot.model, motion)[1]) <= limits.max_effort).all():
        return motion
    straight = request.synchronization is Synchronization.PHASE
    path = Path.straight(request.start, goal) if straight else Path.of_trajectory(motion)
    return time_optimal(robot, path, limits).trajectory


def _in_phase(start: Array, goal: Array, limits: JointLimits) -> Trajectory:
    """One profile for the share of the way, which all joints follow."""
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
    """Each joint as the slowest one lets it; in proportion where that costs no time."""
    problem = ruckig.InputParameter(limits.dof)
    problem.current_position = start.tolist()
    problem.target_position = goal.tolist()
    problem.max_velocity = limits.max_velocity.tolist()
    problem.max_acceleration = limits.max_acceleration.tolist()
    problem.max_jerk = limits.max_jerk.tolist()
    problem.synchronization = ruckig.Synchronization.Phase
    solution = fastest_profile(problem)
    return from_profiles(solution.profiles[0], solution.duration)


def from_profiles(profiles: list[ruckig.Profile], duration_s: float) -> Trajectory:
    """Ruckig's per-joint profiles of one motion from rest, as one trajectory of cubics."""
    starts = [np.concatenate([[0.0], np.cumsum(profile.t)]) for profile in profiles]
    times = np.unique(np.concatenate([*starts, [0.0, duration_s]]).clip(0.0, duration_s))
    keep = np.concatenate([[True], np.diff(times) > SHORTEST_PIECE_S])
    times = times[keep]
    times[-1] = duration_s
    coefficients = np.zeros((len(times) - 1, len(profiles), ORDER))
    for joint, (profile, begin) in enumerate(zip(profiles, starts, strict=True)):
        middle = 0.5 * (times[:-1] + times[1:])
        piece = np.clip(np.searchsorted(begin, middle, side="right") - 1, 0, 7)
        jerk = np.append(profile.j, 0.0)[piece]
        state = np.array([profile.p, profile.v, profile.a])[:, piece]
        since = times[:-1] - begin[piece]
        acceleration = state[2] + jerk * since
        velocity = state[1] + state[2] * since + jerk * since**2 / 2
        position = state[0] + state[1] * since + state[2] * since**2 / 2 + jerk * since**3 / 6
        coefficients[:, joint, :4] = np.stack([position, velocity, acceleration / 2, jerk / 6], axis=-1)
    return Trajectory(times, coefficients)
