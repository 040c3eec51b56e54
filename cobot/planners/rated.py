"""Motions whose velocity and acceleration are given in units, not as shares of the limits.

The robot's limits apply too: for each joint, the lower limit applies.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot.errors import InputError, LimitError
from cobot.motions.planners import Way
from cobot.motions.requests import Envelope, RatedMove
from cobot.motions.stretches import Leg
from cobot.planners import plan
from cobot.planners.blending.joined import leg_of
from cobot.robot.description import RobotDescription
from cobot.types import CartesianLimits, JointLimits

MAX_DURATION_S = 86_400.0
MIN_SHARE, PLACES = 1e-4, 200
ROUNDING = 1e-6
"""Relative tolerance for a duration below the shortest possible one, because of rounding."""


def plan_rated(robot: RobotDescription, move: RatedMove) -> Leg | None:
    """Plan and validate a motion, and return it with its limits; None if the arm is already at the goal.

    The limits of a motion with a duration are chosen so that it takes about as long when it is blended.

    Raises:
        InputError: a velocity or an acceleration is not above 0, or the duration is too short; the message
            then gives the shortest possible duration. Also the errors of `plan`.
        LimitError: the duration is beyond `MAX_DURATION_S`.
        PlanningError: see `plan`.
    """
    request, joint_space = move.request, move.request.traits.way is not Way.PATH
    timed = move.duration_s > 0.0
    if move.duration_s > MAX_DURATION_S:
        raise LimitError(f"duration is {move.duration_s:g} s, allowed: up to {MAX_DURATION_S:g} s")
    if not timed:
        for name, value in (("v", move.velocity), ("a", move.acceleration)):
            if value <= 0.0:
                raise InputError(f"{name} must be above 0, got {value:g}")
    joint_rates = (move.velocity, move.acceleration) if joint_space and not timed else (np.inf, np.inf)
    tcp_rates = (np.inf, np.inf) if joint_space or timed else (move.velocity, move.acceleration)
    slower = replace(
        with_envelope(robot, move.envelope),
        limits=slowed_joints(move.envelope.limits, *joint_rates),
        cartesian_limits=slowed_tcp(move.envelope.cartesian, *tcp_rates),
    )
    trajectory = plan(slower, request)
    if trajectory is None:
        return None
    leg = leg_of(slower, request, trajectory)
    if not timed:
        return leg
    factor = move.duration_s / trajectory.duration_s
    if factor < 1.0 - ROUNDING:
        raise InputError(
            f"duration is {move.duration_s:g} s; the shortest possible duration is "
            f"{trajectory.duration_s:.4g} s"
        )
    stretched = trajectory.stretched(max(factor, 1.0))
    if leg.tcp is None:
        way = np.abs(stretched.end - stretched.start) / stretched.duration_s
        share = float(np.clip((way / leg.limits.max_velocity).max(), MIN_SHARE, 1.0))
        return Leg(stretched, leg.limits.scaled(share, 1.0, 1.0), None)
    places = robot.model.poses(stretched.sample(np.linspace(0.0, stretched.duration_s, PLACES)))
    length_m = float(np.linalg.norm(np.diff(places[:, :3], axis=0), axis=1).sum())
    turns = np.abs((places[1:, 3:] * places[:-1, 3:]).sum(axis=1))
    angle_rad = float(2.0 * np.arccos(np.minimum(turns, 1.0)).sum())
    shares = length_m / leg.tcp.max_linear_velocity, angle_rad / leg.tcp.max_angular_velocity
    share = float(np.clip(max(shares) / stretched.duration_s, MIN_SHARE, 1.0))
    return Leg(stretched, leg.limits, leg.tcp.scaled(share, 1.0, 1.0))


def with_envelope(robot: RobotDescription, envelope: Envelope) -> RobotDescription:
    """The same robot with the limits of `envelope`."""
    return replace(robot, limits=envelope.limits, cartesian_limits=envelope.cartesian)


def slowed_joints(limits: JointLimits, velocity: float, acceleration: float) -> JointLimits:
    """Limit each joint to `velocity` (rad/s) and `acceleration` (rad/s²), and reduce the jerk in
    proportion.
    """
    share = np.minimum(1.0, acceleration / limits.max_acceleration)
    return replace(
        limits,
        max_velocity=np.minimum(limits.max_velocity, velocity),
        max_acceleration=limits.max_acceleration * share,
        max_jerk=limits.max_jerk * share,
    )


def slowed_tcp(limits: CartesianLimits, velocity: float, acceleration: float) -> CartesianLimits:
    """Limit the TCP to `velocity` (m/s) and `acceleration` (m/s²). The limits of jerk and rotation are
    reduced in proportion.
    """
    faster = min(1.0, velocity / limits.max_linear_velocity)
    harder = min(1.0, acceleration / limits.max_linear_acceleration)
    return limits.scaled(faster, harder, harder)
