"""How fast a robot's file says that its joints may be, which MuJoCo does not keep, and whether the limits are
within that.
"""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco

from cobot.errors import ConfigError
from cobot.types import JointLimits

VELOCITY_OF = "max_velocity "
"""What the <numeric> of a joint's velocity is called in a model.xml, before the joint's name."""
TOLERANCE = 1e-4
"""Values that differ by this share are the same: MuJoCo writes six digits."""


def check_velocities(file: Path, mj: mujoco.MjModel, limits: JointLimits) -> None:
    """Refuse velocities that the model's file does not allow. A file that says nothing allows any.

    Raises:
        ConfigError: names the joint, both velocities and the way out.
    """
    allowed = _velocities(file, mj)
    for index, name in enumerate(limits.names):
        velocity, bound = float(limits.max_velocity[index]), allowed.get(name, 0.0)
        if velocity > bound * (1.0 + TOLERANCE) and bound > 0.0:
            unit = limits.unit(index, 1)
            raise ConfigError(
                f"max_velocity of {name} is {velocity:g} {unit}, {file.name} allows {bound:g} {unit}: set "
                f"max_velocity to {bound:g} or less, or correct {file.name}"
            )


def _velocities(file: Path, mj: mujoco.MjModel) -> dict[str, float]:
    if file.suffix.lower() == ".urdf":
        rates = urdf_rates(file, ElementTree.parse(file).getroot())
        return {name: velocity for name, (velocity, _) in rates.items()}
    numbers = [mj.numeric(index) for index in range(mj.nnumeric)]
    return {
        each.name.removeprefix(VELOCITY_OF): float(each.data[0])
        for each in numbers
        if each.name.startswith(VELOCITY_OF)
    }


def urdf_rates(file: Path, root: Element) -> dict[str, tuple[float, float]]:
    """Velocity and effort of each joint that has a limit; 0 for unknown.

    Raises:
        ConfigError: one is no number from 0 on, or a joint's range is upside down.
    """
    rates = {}
    for joint in root.iter("joint"):
        if (limit := joint.find("limit")) is None:
            continue
        name = str(joint.get("name"))
        low, high = float(limit.get("lower", 0)), float(limit.get("upper", 0))
        if low > high:
            raise ConfigError(f"{file}: joint {name!r}: its lower limit {low:g} is above its upper {high:g}")
        rates[name] = _rate(file, name, limit, "velocity"), _rate(file, name, limit, "effort")
    return rates


def _rate(file: Path, joint: str, limit: Element, what: str) -> float:
    text = limit.get(what, "0")
    with contextlib.suppress(ValueError):
        if 0.0 <= (value := float(text)) < math.inf:
            return value
    raise ConfigError(f"{file}: joint {joint!r}: {what} {text!r} must be a number from 0 on; 0 is unknown")
