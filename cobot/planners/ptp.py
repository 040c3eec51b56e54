"""Point to point: all joints start and stop together, each as fast as its jerk limit lets it."""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.motions.requests import MotionRequest
from cobot.planners.profile import fastest_profile
from cobot.robot.description import RobotDescription
from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array

SHORTEST_PIECE_S = 1e-9


def plan_ptp(robot: RobotDescription, request: MotionRequest, goal: Array) -> Trajectory:
    """Time-optimal under velocity, acceleration and jerk limits; straight in joint space.

    Ruckig's profiles are piecewise cubics; they are taken over exactly, not sampled. Its phase
    synchronisation keeps the joints in proportion from rest to rest.

    Raises:
        PlanningError: there is no profile.
    """
    limits = request.scaled_limits(robot)
    problem = ruckig.InputParameter(limits.dof)
    problem.current_position = request.start.tolist()
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
