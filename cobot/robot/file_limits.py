"""Speed limits in a robot's file, which MuJoCo ignores, and the check that the joint limits do not exceed
them.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco

from cobot.errors import ConfigError
from cobot.types import JointLimits
from cobot.xml_file import number, parse, where

MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints that a drive can move."""
VELOCITY_OF = "max_velocity "
"""Prefix of the name of a <numeric> element in a model.xml that gives a joint's velocity limit. The joint's
name follows.
"""
TOLERANCE = 1e-4
"""Relative difference below which values are considered equal, because MuJoCo writes six digits."""


def check_velocities(file: Path, mj: mujoco.MjModel, limits: JointLimits) -> None:
    """Reject velocity limits above those in the model's file. If the file contains no velocities, any limit
    is allowed.

    Raises:
        ConfigError: a velocity limit is too high; the message names the joint, both velocities and a remedy.
    """
    allowed = _velocities(file, mj)
    for index, name in enumerate(limits.names):
        velocity, bound = float(limits.max_velocity[index]), allowed.get(name, 0.0)
        if velocity > bound * (1.0 + TOLERANCE) and bound > 0.0:
            unit = limits.unit(index, 1)
            raise ConfigError(
                f"max_velocity of {name} is {velocity:g} {unit}, but {file.name} allows {bound:g} "
                f"{unit}: set max_velocity to {bound:g} or less, or correct {file.name}"
            )


def _velocities(file: Path, mj: mujoco.MjModel) -> dict[str, float]:
    if file.suffix.lower() == ".urdf":
        rates = urdf_rates(file, parse(file)[0])
        return {name: velocity for name, (velocity, _) in rates.items()}
    numbers = [mj.numeric(index) for index in range(mj.nnumeric)]
    return {
        each.name.removeprefix(VELOCITY_OF): float(each.data[0])
        for each in numbers
        if each.name.startswith(VELOCITY_OF)
    }


def urdf_rates(file: Path, root: Element) -> dict[str, tuple[float, float]]:
    """Velocity and effort limit of each joint with a <limit> element; 0 if a value is unknown.

    Raises:
        ConfigError: a limit is not a number, a velocity or effort is negative, or a lower limit is above the
            upper one.
    """
    rates = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if limit is None or joint.get("type") not in MOVING:
            continue
        name = str(joint.get("name"))
        of = f"joint {name!r}"
        low, high = (number(file, limit, end, of, 0.0) for end in ("lower", "upper"))
        if low > high and joint.get("type") != "continuous":
            raise ConfigError(
                f"{where(file, limit)}: {of}: its lower limit {low:g} is above its upper limit {high:g}"
            )
        rates[name] = _rate(file, limit, of, "velocity"), _rate(file, limit, of, "effort")
    return rates


def _rate(file: Path, limit: Element, of: str, what: str) -> float:
    if (value := number(file, limit, what, of, 0.0)) < 0.0:
        raise ConfigError(f"{where(file, limit)}: {of}: {what} is {value:g}; it must be 0 (unknown) or more")
    return value
