"""Forecasts: the properties of a planned motion before it runs."""

from __future__ import annotations

import numpy as np

from cobot.motions.forecast import Closest, Forecast
from cobot.motions.rehearsal import Flaw, Rehearsal, SimulatedRun
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.polynomials import greatest_rates
from cobot.reasons import Reason, ReasonCode
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import effort_samples
from cobot.robot.nearest import Nearest
from cobot.trajectory import Trajectory
from cobot.types import Array

DISTANCE_SAMPLES = 200
TOUCH_M = 1e-3
"""Maximum distance that is computed for a simulated run. It is small because only contacts matter."""


def forecast(robot: RobotDescription, request: MotionRequest, samples: int) -> Forecast:
    """Plan like `plan` and describe the motion. Raises the same errors."""
    return describe(robot, plan(robot, request), request.start, samples)


def describe(robot: RobotDescription, trajectory: Trajectory | None, start: Array, samples: int) -> Forecast:
    """The forecast of a planned motion.

    Args:
        trajectory: the motion; None if the arm is already at the goal.
        start: the arm's joint positions, shape (dof,), rad.
        samples: number of points of the path, evenly spaced in time, with both ends.
    """
    if trajectory is None:
        times, joints = np.zeros(1), np.array(start)[None]
        looked_at = joints
    else:
        times = np.linspace(0.0, trajectory.duration_s, samples)
        joints = trajectory.sample(times)
        looked_at = trajectory.sample(np.linspace(0.0, trajectory.duration_s, DISTANCE_SAMPLES))
    peaks = _peaks(robot, trajectory, start)
    limits = robot.limits
    most = (limits.max_velocity, limits.max_acceleration, limits.max_jerk, limits.max_effort)
    return Forecast(
        trajectory,
        times,
        joints,
        robot.model.poses(joints),
        peaks,
        {name: peak / bound for (name, peak), bound in zip(peaks.items(), most, strict=True)},
        *_closest(robot, looked_at),
    )


def _peaks(robot: RobotDescription, trajectory: Trajectory | None, start: Array) -> dict[str, Array]:
    if trajectory is None:
        rest = np.zeros(robot.limits.dof)
        torque = np.abs(robot.model.gravity_torques(start))
        return {"velocity": rest, "acceleration": rest, "jerk": rest, "torque": torque}
    coefficients = trajectory.coefficients
    begins = np.abs(coefficients[:, :, 1:4]).max(axis=0).T * [[1.0], [2.0], [6.0]]
    # Leave out pieces whose speeds are all lower than the initial speed of another piece.
    durations = np.diff(trajectory.breakpoints_s)
    rates = greatest_rates(coefficients, durations, begins[:, None]).max(axis=1)
    torque = np.abs(effort_samples(robot.model, trajectory)[1]).max(axis=0)
    return {"velocity": rates[0], "acceleration": rates[1], "jerk": rates[2], "torque": torque}


def evaluate_run(robot: RobotDescription, run: SimulatedRun) -> Rehearsal:
    """The shortest distances during a simulated run; a contact is reported as a flaw."""
    distances = robot.collision.nearest.distances(run.positions, TOUCH_M)
    flaw = run.flaw
    touching = np.flatnonzero((distances <= 0.0).any(axis=1))
    if len(touching) and (flaw is None or run.times_s[touching[0]] < flaw.time_s):
        first = int(touching[0])
        pair = robot.collision.names(int(distances[first].argmin()))
        says = Reason(f"{' and '.join(pair)} touch", ReasonCode.OBSTACLE, of=pair)
        flaw = Flaw(float(run.times_s[first]), None, says)
    return Rehearsal(run, flaw, *_closest(robot, run.positions))


def _closest(robot: RobotDescription, rows: Array) -> tuple[Closest | None, Closest | None]:
    """The closest pair among the robot's own bodies, and the closest pair of the robot and its
    surroundings.
    """
    last = max(len(rows) - 1, 1)

    def along(nearest: Nearest | None) -> Closest | None:
        if nearest is None:
            return None
        share = nearest.row / last
        return Closest(nearest.first, nearest.second, nearest.distance_m, share, nearest.points)

    own, around = robot.collision.nearest.among(rows)
    return along(own), along(around)
