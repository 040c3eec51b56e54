"""Conversion of a request's path constraints into the type that planners take."""

from __future__ import annotations

import numpy as np

from cobot.errors import InputError
from cobot.motions.bodies import KeptBox, KeptOrientation, MotionConstraints, PathPoint
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.fields import Direction
from cobot.strict import shown
from cobot.types import Array, JointLimits


def constraints_of(asked: MotionConstraints | None, limits: JointLimits) -> Constraints | None:
    """The path constraints of a request; None if there are none.

    Raises:
        InputError: a direction without length, an empty box or range, or an unknown joint.
    """
    if asked is None or not asked.model_dump(exclude_defaults=True):
        return None
    return Constraints(
        None if asked.orientation is None else _cone(asked.orientation),
        None if asked.box is None else _box(asked.box),
        tuple(_range(name, low, high, limits) for name, (low, high) in asked.joints.items()),
    )


def _cone(asked: KeptOrientation) -> Cone:
    direction = asked.direction
    return Cone(
        _unit("tool_axis", asked.tool_axis),
        asked.within_rad,
        None if direction is None else _unit("direction", direction),
    )


def _unit(name: str, given: Direction) -> Array:
    axis = np.array([given.x, given.y, given.z])
    length = float(np.linalg.norm(axis))
    if not 1e-9 < length < np.inf:
        field = f"constraints.orientation.{name}"
        raise InputError(f"{field}: has a length of {length:g}, so it has no direction")
    return np.asarray(axis / length)


def _box(asked: KeptBox) -> Box:
    for name in "xyz":
        low, high = getattr(asked.min, name), getattr(asked.max, name)
        if not low < high:
            raise InputError(
                f"constraints.box: min.{name} is {low:g} m, it must be below max.{name}, {high:g} m"
            )
    return Box(_point(asked.min), _point(asked.max))


def _point(given: PathPoint) -> Array:
    return np.array([given.x, given.y, given.z])


def _range(name: str, low: float, high: float, limits: JointLimits) -> tuple[int, float, float]:
    place = f"constraints.joints.{shown(name)[1:-1]}"
    if name not in limits.names:
        raise InputError(f"{place}: there is no such joint; valid are: {', '.join(limits.names)}")
    joint = limits.names.index(name)
    unit = limits.unit(joint)
    what = "angle" if unit == "rad" else "position"
    least, most = float(limits.min_position[joint]), float(limits.max_position[joint])
    if not low <= high:
        raise InputError(f"{place}: is {low:g} to {high:g} {unit}, the smaller {what} must come first")
    if high < least or low > most:
        raise InputError(
            f"{place}: is {low:g} to {high:g} {unit}, beyond the limits of {least:.4f} to {most:.4f} {unit}"
        )
    return joint, low, high
