"""The checks that every planned motion must pass: joint and drive limits, and collisions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot.errors import LimitError
from cobot.findings import Finding
from cobot.polynomials import greatest_rates, pieces_at
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

RELATIVE_TOLERANCE = 1e-6
"""A value may exceed its limit by this share of the limit, because clients round their motions."""
PLANNED_TOLERANCE = 1e-9
"""Rounding may make a planned motion exceed a limit by this share of the limit."""

EFFORT_SAMPLES, EFFORT_STEP_S = 2, 0.008
MAX_EFFORT_STEPS = 2000
"""Sampling of efforts, which are not polynomials: minimum number of samples per segment, and maximum step, s.
The steps are longer if there would be more than `MAX_EFFORT_STEPS` of them.
"""
EFFORT_TOLERANCE = 1e-3
"""Between two samples an effort may exceed its limit by this share of the limit, if accelerations take 0.1
s to build up.
"""

PLACES = 33
"""Number of samples that locate the extremum in the segment that exceeds a limit. Only the error message uses
them.
"""

QUANTITIES = ("position", "velocity", "acceleration", "jerk")


def check_motion(
    robot: RobotDescription, trajectory: Trajectory, limits: JointLimits, labels: list[str] | None = None
) -> None:
    """Reject a planned motion that does not stay within its limits at the true extrema, needs more effort
    than its drives have, or leads to a collision of the arm with itself or its surroundings.

    An arm that was pushed beyond a limit may move back, but not further out.

    Raises:
        LimitError: see `check_limits` and `check_efforts`.
        CollisionError: the arm touches itself or its surroundings; see the collision checker.
    """
    check_limits(trajectory, limits.including(trajectory.start), labels, PLANNED_TOLERANCE)
    check_efforts(robot.model, trajectory, limits)
    robot.collision.check_trajectory(trajectory)


def check_limits(
    trajectory: Trajectory,
    limits: JointLimits,
    labels: Sequence[str] | None = None,
    tolerance: float = RELATIVE_TOLERANCE,
) -> None:
    """Reject a trajectory if its exact extrema exceed the limits.

    Args:
        labels: the caller's names of the breakpoints, for the message.
        tolerance: share of a limit (of the range, for positions) that it may be exceeded by.

    Raises:
        LimitError: a limit is exceeded; reports the earliest violation with its position, joint, quantity,
            value and limit.
    """
    if _keeps(trajectory, limits, tolerance):
        return
    found: list[tuple[int, int, int, float]] = []
    for derivative, (low, high) in enumerate(_bounds(limits, tolerance)):
        segments, joints, values = trajectory.excesses(derivative, low, high)
        if len(segments):
            found.append((int(segments[0]), derivative, int(joints[0]), float(values[0])))
    if not found:
        return
    segment, derivative, joint, value = min(found)
    low, high = _bounds(limits, tolerance)[derivative]
    limit = low[joint] if value < low[joint] else high[joint]
    begin, end = trajectory.breakpoints_s[segment : segment + 2]
    share = _worst_share(trajectory, derivative, segment, joint, value < low[joint])
    place = f"from {begin:.3f} s to {end:.3f} s"
    if labels is not None:
        place = f"between {labels[segment]} and {labels[segment + 1]} ({place})"
    name, quantity, unit = limits.names[joint], QUANTITIES[derivative], limits.unit(joint, derivative)
    raise LimitError(
        f"{place} the {quantity} of {name} reaches {value:.6g} {unit}, but its limit is {limit:.6g} "
        f"{unit}, at {100.0 * share:.0f} % of the motion",
        findings=[Finding("limit", quantity, value, float(limit), unit, share, (name,))],
    )


def _worst_share(trajectory: Trajectory, derivative: int, segment: int, joint: int, below: bool) -> float:
    """The point in a segment where a joint exceeds a limit most, as a share of the motion's duration."""
    begin, end = trajectory.breakpoints_s[segment : segment + 2]
    times = np.linspace(begin, end, PLACES)
    # The end belongs to the next segment, whose jerk may differ.
    inside = np.append(times[:-1], np.nextafter(times[-1], 0.0))
    values = trajectory.sample(inside, derivative)[:, joint]
    return float(times[int(values.argmin() if below else values.argmax())] / trajectory.duration_s)


def _keeps(trajectory: Trajectory, limits: JointLimits, tolerance: float) -> bool:
    """Whether a motion stays within all limits. This is checked with the exact extrema of all its pieces."""
    rates = np.array([limits.max_velocity, limits.max_acceleration, limits.max_jerk]) * (1.0 + tolerance)
    durations = np.diff(trajectory.breakpoints_s)
    if not (greatest_rates(trajectory.coefficients, durations, rates[:, None]) <= rates[:, None]).all():
        return False
    return in_range(trajectory, limits, tolerance)


def in_range(trajectory: Trajectory, limits: JointLimits, tolerance: float = RELATIVE_TOLERANCE) -> bool:
    """Whether all joints stay within their position limits."""
    segments, _, _ = trajectory.excesses(0, *_bounds(limits, tolerance)[0])
    return len(segments) == 0


def stretch_to_limits(trajectory: Trajectory, limits: JointLimits) -> Trajectory:
    """The trajectory, slowed down evenly just enough to keep all rate limits."""
    bounds = np.array([limits.max_velocity, limits.max_acceleration, limits.max_jerk])
    durations = np.diff(trajectory.breakpoints_s)
    peaks = greatest_rates(trajectory.coefficients, durations, bounds[:, None]).max(axis=1)
    factor = float(((peaks / bounds).max(axis=1) ** (1.0 / np.arange(1, 4))).max())
    return trajectory if factor <= 1.0 else trajectory.stretched(factor)


def _bounds(
    limits: JointLimits, tolerance: float = RELATIVE_TOLERANCE
) -> list[tuple[np.ndarray, np.ndarray]]:
    slack = 1.0 + tolerance
    rates = [bound * slack for bound in (limits.max_velocity, limits.max_acceleration, limits.max_jerk)]
    span = tolerance * (limits.max_position - limits.min_position)
    return [(limits.min_position - span, limits.max_position + span), *((-rate, rate) for rate in rates)]


def effort_samples(model: RobotModel, trajectory: Trajectory) -> tuple[Array, Array]:
    """The drives' efforts without friction, N·m, sampled over the motion, and the times of the samples, s.
    The times come first. Shapes: (n,) and (n, dof).

    The model keeps the samples of the last trajectory, because a planner and the check after it need the same
    samples. In between, only the note of the trajectory may change; its arrays are read-only.
    """
    if model.last_efforts is not None:
        last, times, efforts = model.last_efforts
        if last.coefficients is trajectory.coefficients and last.breakpoints_s is trajectory.breakpoints_s:
            return times, efforts
    knots = trajectory.breakpoints_s
    durations = np.diff(knots)
    step_s = max(EFFORT_STEP_S, trajectory.duration_s / MAX_EFFORT_STEPS)
    counts = np.maximum(EFFORT_SAMPLES, np.ceil(durations / step_s)).astype(int)
    segment = np.arange(len(durations)).repeat(counts)
    number = np.arange(len(segment)) - (counts.cumsum() - counts)[segment]
    times = np.append(knots[segment] + (durations / counts)[segment] * number, knots[-1])
    joints, velocity, acceleration, _ = pieces_at(knots, trajectory.coefficients, times)
    efforts = model.dynamics.inverse(joints, velocity, acceleration)
    times.flags.writeable = efforts.flags.writeable = False
    model.last_efforts = trajectory, times, efforts
    return times, efforts


def keeps_effort(model: RobotModel, motion: Trajectory, limits: JointLimits, share: float) -> bool:
    """Whether a motion needs no more than a given share of any effort limit."""
    _, efforts = effort_samples(model, motion)
    return bool((np.abs(efforts) <= share * limits.max_effort).all())


def check_efforts(model: RobotModel, trajectory: Trajectory, limits: JointLimits) -> None:
    """Reject a motion that needs more effort than a drive can provide. The model's load is included.

    Raises:
        LimitError: a drive's effort is not enough; the message names the position, the joint, the needed
            effort and the limit.
    """
    times, efforts = effort_samples(model, trajectory)
    share = np.abs(efforts) / limits.max_effort
    if share.max() <= 1.0 + EFFORT_TOLERANCE:
        return
    sample, joint = np.unravel_index(int(share.argmax()), share.shape)
    place = float(times[sample] / trajectory.duration_s)
    name, needed = limits.names[int(joint)], float(abs(efforts[sample, joint]))
    unit = limits.effort_unit(int(joint))
    limit = float(limits.max_effort[joint])
    raise LimitError(
        f"after {100.0 * place:.0f} % of the motion ({times[sample]:.3f} s) {name} needs {needed:.4g} "
        f"{unit}, but its limit is {limit:.4g} {unit}",
        findings=[Finding("effort", "effort", needed, limit, unit, place, (name,))],
    )


def stretch_to_efforts(model: RobotModel, trajectory: Trajectory, limits: JointLimits) -> Trajectory | None:
    """The trajectory, slowed down evenly just enough for all drives.

    The effort for moving falls with the square of the duration; the effort for holding does not change.

    Returns:
        None if slowing down does not help, because somewhere on the path the drives cannot even hold the arm.
    """
    limit = limits.max_effort
    while True:
        times, efforts = effort_samples(model, trajectory)
        if (np.abs(efforts) <= limit * (1.0 + EFFORT_TOLERANCE)).all():
            return trajectory
        joints = trajectory.sample(times)
        still = np.zeros_like(joints)
        held = model.dynamics.inverse(joints, still, still)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.array([-limit - held, limit - held]) / (efforts - held)
        square = float(np.nanmin(ends.max(axis=0)))
        if square <= max(float(np.nanmax(ends.min(axis=0))), 0.0):
            return None
        trajectory = trajectory.stretched(square**-0.5)
