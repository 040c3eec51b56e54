"""Reading joint_limits.yaml in MoveIt's format, and checking joint positions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cobot.config import StreamingSection
from cobot.errors import ConfigError, LimitError
from cobot.findings import Finding
from cobot.types import Array, JointLimits, vector
from cobot.units import DEGREES, DEGREES_FROM_RAD, DEGREES_TO_RAD, MILLIMETRES_FROM_M
from cobot.yaml_file import read_yaml

_RATES = ("velocity", "acceleration", "jerk", "effort")
_KEYS = (
    "has_position_limits",
    "min_position",
    "max_position",
    *(key for rate in _RATES for key in (f"has_{rate}_limits", f"max_{rate}")),
)

MAX_POSITION, MAX_RATE = 1e3, 1e6
"""Upper bounds for the values in a file: for positions, rad or m, and for velocities, accelerations, jerks
and efforts.
"""


def load_joint_limits(path: Path) -> JointLimits:
    """Read the joint limits, in file order.

    Every joint needs all limits: without an acceleration limit the stopping distance of a robot is unknown.

    Raises:
        ConfigError: a value is missing or invalid; the message names the file, the joint, the key and the
            valid values.
    """
    content = read_yaml(path)
    joints = content.get("joint_limits") if isinstance(content, dict) else None
    if not isinstance(joints, dict) or not joints or set(content) != {"joint_limits"}:
        raise ConfigError(f"{path}: must contain joint_limits: with an entry per joint, and nothing else")
    rows = [_joint(path, str(name), entry) for name, entry in joints.items()]
    low, high, velocity, acceleration, jerk, effort = (vector(column) for column in zip(*rows, strict=True))
    names = tuple(str(name) for name in joints)
    return JointLimits(names, low, high, velocity, acceleration, jerk, effort)


def streamed(limits: JointLimits, section: StreamingSection) -> JointLimits:
    """The limits of joints that follow streamed joint positions."""
    return replace(
        limits,
        max_velocity=np.minimum(limits.max_velocity, section.joint_velocity),
        max_acceleration=np.minimum(limits.max_acceleration, section.joint_acceleration),
    )


def check_positions(
    limits: JointLimits, joints: Array, what: str = "joint angle", share: float | None = None
) -> None:
    """Reject joint positions beyond the limits.

    Args:
        share: position of these positions in a motion: 0 at the start, 1 at the goal.

    Raises:
        LimitError: a joint is beyond its limits; the message names every such joint with its value and its
            range.
    """
    ranges = zip(limits.names, joints, limits.min_position, limits.max_position, strict=True)
    beyond = [
        (name, float(value), float(low), float(high), limits.unit(index))
        for index, (name, value, low, high) in enumerate(ranges)
        if not low <= value <= high
    ]
    if beyond:
        nouns = {"rad": what, "m": what.replace("angle", "position")}
        said = [
            f"{nouns[unit]} of {name} is {value:.6g} {unit}, allowed: {low:g} to {high:g} {unit}"
            for name, value, low, high, unit in beyond
        ]
        raise LimitError(
            "; ".join(said) + _mistaken(limits, joints),
            findings=[
                Finding("limit", "position", value, low if value < low else high, unit, share, (name,))
                for name, value, low, high, unit in beyond
            ],
        )


def _mistaken(limits: JointLimits, joints: Array) -> str:
    """Advice if the values look as if they were in a different unit; otherwise ""."""
    slides = np.array(limits.slides or (False,) * limits.dof)
    angles, ways = np.abs(joints[~slides]), np.abs(joints[slides])
    if len(ways) and ways.max() > MILLIMETRES_FROM_M:
        return "; these look like millimetres; positions of slides are in m"
    if len(angles) and DEGREES_FROM_RAD < angles.max() <= DEGREES_TO_RAD:
        return f"; {DEGREES}"
    return ""


def _joint(path: Path, name: str, entry: Any) -> tuple[float, ...]:
    """The limits of one entry: min position, max position, max velocity, acceleration, jerk and effort."""
    where = f"{path}: joint_limits.{name}"
    if not isinstance(entry, dict):
        raise ConfigError(f"{where}: must contain {', '.join(_KEYS)}")
    for key in entry:
        if key not in _KEYS:
            raise ConfigError(f"{where}: unknown key {key!r}; valid keys: {', '.join(_KEYS)}")
    for key in _KEYS:
        if key not in entry:
            raise ConfigError(f"{where}.{key}: is missing")
        if key.startswith("has_"):
            if entry[key] is not True:
                raise ConfigError(f"{where}.{key}: must be true, got {entry[key]!r}: cobot needs every limit")
        elif isinstance(entry[key], bool) or not isinstance(entry[key], int | float):
            raise ConfigError(f"{where}.{key}: must be a number, got {entry[key]!r}")
    low, high = float(entry["min_position"]), float(entry["max_position"])
    if not -MAX_POSITION < low < high < MAX_POSITION:
        raise ConfigError(
            f"{where}: min_position {low:g} must be below max_position {high:g}, both between "
            f"-{MAX_POSITION:g} and {MAX_POSITION:g}"
        )
    rates = tuple(float(entry[f"max_{rate}"]) for rate in _RATES)
    for rate, value in zip(_RATES, rates, strict=True):
        if not 0.0 < value < MAX_RATE:
            raise ConfigError(f"{where}.max_{rate}: must be above 0 and below 1e6, got {value:g}")
    return low, high, *rates
