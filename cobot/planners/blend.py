"""Motions joined without a stop: the end of each overlaps the beginning of the next.

Both are from rest to rest, so their sum, q(t) = first(t) + next(t − s) − corner, is as smooth as they are,
and leaves the corner out. How long they overlap follows from how near to it the tool's tip has to be.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product
from math import comb

import numpy as np

from cobot.errors import CollisionError, LimitError
from cobot.motions.requests import Blended, Envelope
from cobot.planners.rated import with_envelope
from cobot.planners.time_law import retimed
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_limits
from cobot.trajectory import ORDER, Trajectory
from cobot.types import PLANNED_JERK, Array, JointLimits

SAMPLES = 100
CANDIDATES = np.linspace(1.0, 0.1, 10)
"""Overlaps are tried in this order, each as a share of the longest possible one."""
SHORTEST_S = 0.005
SAME_S = 1e-9
"""Breakpoints that are nearer to each other, s, are taken for one."""
_CHOOSE = np.array([[comb(p, j) if p >= j else 0 for p in range(ORDER)] for j in range(ORDER)], dtype=float)


def blend(
    robot: RobotDescription, motions: Sequence[Trajectory], radii_m: Sequence[float], envelope: Envelope
) -> Blended:
    """One motion through all of them; it slows down at a corner that cannot be rounded within the limits as
    fast as the motions are, and stops at one that cannot be rounded at all.

    Args:
        motions: each begins where the one before ends.
        radii_m: one less: how far from each corner the tool's tip may leave its path.
    """
    robot = with_envelope(robot, envelope)
    overlaps, used_s = [], 0.0
    for index, (first, second) in enumerate(pairwise(motions)):
        free_s = second.duration_s * (0.5 if index + 2 < len(motions) else 1.0)
        overlaps.append(overlap(robot, first, second, radii_m[index], min(first.duration_s - used_s, free_s)))
        used_s = overlaps[-1]
    starts = np.cumsum([0.0, *(m.duration_s - o for m, o in zip(motions, overlaps, strict=False))])
    timed = retimed(robot, superposed(motions, starts), _limits(robot.limits, motions))
    corners = [float(s + 0.5 * o) for s, o in zip(starts[1:], overlaps, strict=True)]
    total, progress = timed.trajectory, timed.progress
    ends = np.interp(corners, progress.sample(progress.breakpoints_s)[:, 0], progress.breakpoints_s).tolist()
    return Blended(total, (*ends, total.duration_s), tuple(o > 0.0 for o in overlaps))


def overlap(
    robot: RobotDescription, first: Trajectory, second: Trajectory, radius_m: float, longest_s: float
) -> float:
    """The longest time, s, that two motions may overlap; 0 if the arm has to stop in between.

    Where they overlap, no joint uses a larger share of its velocity limit than the motions do elsewhere, and
    none more of its acceleration limit than both together, nor more than all of it, and the jerk limits hold;
    if that allows none, they overlap as far as they can, to be slowed down there. The tool's tip stays within
    the radius, and nothing is touched.
    """
    corner = robot.model.forward(first.end).position

    def away(trajectory: Trajectory, times_s: Array) -> Array:
        places = robot.model.poses(trajectory.sample(times_s))[:, :3]
        return np.asarray(np.linalg.norm(places - corner, axis=1))

    into = np.linspace(0.0, longest_s, SAMPLES + 1)
    outside = (away(first, first.duration_s - into) > radius_m) | (away(second, into) > radius_m)
    if outside.any():
        longest_s = float(into[max(int(outside.argmax()) - 1, 0)])
    limits = _limits(robot.limits, (first, second))
    for bound, duration_s in product((limits, None), CANDIDATES * longest_s):
        if duration_s < SHORTEST_S:
            continue
        joined = superposed([first, second], np.array([0.0, first.duration_s - duration_s]))
        both = cut(joined, first.duration_s - duration_s, first.duration_s)
        try:
            if bound is not None:
                check_limits(both, bound)
            robot.collision.check_trajectory(both)
        except (LimitError, CollisionError):
            continue
        if away(both, np.linspace(0.0, both.duration_s, SAMPLES)).max() <= radius_m:
            return float(duration_s)
    return 0.0


def superposed(motions: Sequence[Trajectory], starts_s: Array) -> Trajectory:
    """The sum of all displacements, each from its start time on, from where the first one begins."""
    ends_s = [start + motion.duration_s for start, motion in zip(starts_s, motions, strict=True)]
    times = _distinct(
        np.concatenate([s + m.breakpoints_s for s, m in zip(starts_s, motions, strict=True)]), max(ends_s)
    )
    total = np.zeros((len(times) - 1, motions[0].dof, ORDER))
    total[:, :, 0] = motions[0].start
    middles = 0.5 * (times[:-1] + times[1:])
    for start, end, motion in zip(starts_s, ends_s, motions, strict=True):
        running = (middles > start) & (middles < end)
        total[running] += _expanded(motion, times[:-1][running] - start, middles[running] - start)
        total[running, :, 0] -= motion.start
        total[middles >= end, :, 0] += motion.end - motion.start
    return Trajectory(times, total)


def cut(trajectory: Trajectory, begin_s: float, end_s: float) -> Trajectory:
    """The part between two times."""
    inner = trajectory.breakpoints_s[
        (trajectory.breakpoints_s > begin_s + SAME_S) & (trajectory.breakpoints_s < end_s - SAME_S)
    ]
    times = np.concatenate([[begin_s], inner, [end_s]])
    middles = 0.5 * (times[:-1] + times[1:])
    return Trajectory(times - begin_s, _expanded(trajectory, times[:-1], middles))


def _expanded(trajectory: Trajectory, origins_s: Array, inside_s: Array) -> Array:
    """Coefficients of the segments that contain `inside_s`, (n, dof, 6), in the time since `origins_s`."""
    index = np.searchsorted(trajectory.breakpoints_s, inside_s, side="right") - 1
    since = origins_s - trajectory.breakpoints_s[index]
    power = np.maximum(np.arange(ORDER)[None, :] - np.arange(ORDER)[:, None], 0)
    shift = _CHOOSE * since[:, None, None] ** power
    return np.asarray(np.einsum("ndp,njp->ndj", trajectory.coefficients[index], shift))


def _distinct(times_s: Array, end_s: float) -> Array:
    ordered = np.sort(times_s)
    kept = ordered[np.concatenate([[True], np.diff(ordered) > SAME_S])]
    kept[-1] = end_s
    return np.asarray(kept)


def _limits(limits: JointLimits, motions: Sequence[Trajectory]) -> JointLimits:
    """The largest share of the velocity limits that motions use, and the sum of those of acceleration."""
    speeds, accelerations = (
        [float((np.maximum(*np.abs(motion.extrema(order))) / bound).max()) for motion in motions]
        for order, bound in ((1, limits.max_velocity), (2, limits.max_acceleration))
    )
    return limits.scaled(min(max(speeds), 1.0), min(sum(accelerations), 1.0), PLANNED_JERK)
