"""The limits of several motions, each as a share of the largest limit among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from cobot.motions.stretches import Leg
from cobot.planners.timing.coordinates import PARTS
from cobot.planners.timing.time_law import with_room
from cobot.robot.description import RobotDescription
from cobot.types import Array, CartesianLimits, JointLimits

UNLIMITED = 1e9
RATES = ("max_velocity", "max_acceleration", "max_jerk")


def rates(robot: RobotDescription, leg: Leg) -> Array:
    """Velocity, acceleration and jerk limits of a motion: joints, then TCP, shape (3, dof + 2)."""
    limits = with_room(robot, leg.limits)
    of_joints = np.array([getattr(limits, name) for name in RATES])
    of_tcp = np.full((3, PARTS), UNLIMITED)
    if leg.tcp is not None:
        values = [getattr(leg.tcp, item.name) for item in fields(CartesianLimits)]
        of_tcp = np.array(values).reshape(PARTS, 3).T
    return np.concatenate([of_joints, of_tcp], axis=1)


def largest_rates(robot: RobotDescription, legs: Sequence[Leg]) -> Array:
    """The largest value of each limit. For the TCP, only motions with TCP limits are considered."""
    largest = np.max([rates(robot, leg) for leg in legs], axis=0)
    with_tcp = [rates(robot, leg) for leg in legs if leg.tcp is not None]
    if with_tcp:
        largest[:, -PARTS:] = np.max(with_tcp, axis=0)[:, -PARTS:]
    return np.asarray(largest)


def largest(robot: RobotDescription, legs: Sequence[Leg]) -> tuple[JointLimits, CartesianLimits | None]:
    """The limits to which the shares of the zones refer."""
    greatest = largest_rates(robot, legs)
    dof = robot.limits.dof
    limits = replace(legs[0].limits, **dict(zip(RATES, greatest[:, :dof], strict=True)))
    if not any(leg.tcp for leg in legs):
        return limits, None
    return limits, CartesianLimits(*greatest[:, dof:].T.ravel().tolist())
