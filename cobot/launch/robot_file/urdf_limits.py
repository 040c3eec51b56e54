"""The limits of a URDF's joints: with the format's defaults, never wider than stated."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element

from cobot.errors import ConfigError
from cobot.robot.limits import MAX_POSITION, MAX_RATE
from cobot.types import JointLimits
from cobot.xml_file import number, where

DERIVED = {
    "max_acceleration": " (it follows from the velocity)",
    "max_jerk": " (it follows from the velocity)",
}
WAYS_OUT = {
    "revolute": "give it limits, or make it continuous",
    "prismatic": "give it limits",
}


def state_limits(file: Path, root: Element) -> None:
    """Write out what the format means: 0 for a missing `lower` or `upper`, no range for continuous joints.

    MuJoCo would ignore a range of which one end is missing.
    """
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if limit is None:
            continue
        ends = [number(file, limit, end, f"joint {joint.get('name')!r}", 0.0) for end in ("lower", "upper")]
        bounded = joint.get("type") != "continuous" and ends[0] < ends[1]
        for end, value in zip(("lower", "upper"), ends, strict=True):
            limit.attrib.pop(end, None)
            if bounded:
                limit.set(end, repr(value))


def check_driven(file: Path, root: Element, driven: Iterable[str]) -> None:
    """Reject the joints of the arm whose limits in the file leave them no range.

    Raises:
        ConfigError: names the line, the joint and the ways out.
    """
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    for name in driven:
        joint = joints.get(name)
        way_out = WAYS_OUT.get("" if joint is None else joint.get("type", ""))
        if joint is None or way_out is None:
            continue
        limit = joint.find("limit")
        if limit is not None and "lower" in limit.attrib:
            continue
        told = "no <limit>" if limit is None else "a range of 0, because lower and upper are equal or missing"
        raise ConfigError(
            f"{where(file, joint if limit is None else limit)}: joint {name!r} is {joint.get('type')} and "
            f"has {told}; {way_out}, or leave it out with --without {name}"
        )


def check_supported(file: Path, root: Element, limits: JointLimits) -> None:
    """Reject limits beyond what cobot supports.

    Raises:
        ConfigError: names the line, the joint, the value and the bound.
    """
    elements = {joint.get("name"): joint for joint in root.iter("joint")}
    for index, name in enumerate(limits.names):
        for quantity in limits.QUANTITIES:
            value = float(getattr(limits, quantity)[index])
            bound = MAX_POSITION if quantity.endswith("position") else MAX_RATE
            if not abs(value) < bound:
                raise ConfigError(
                    f"{where(file, elements.get(name))}: joint {name!r}: {quantity} is {value:g}, cobot "
                    f"supports less than {bound:.0f}{DERIVED.get(quantity, '')}; correct it in the file, or "
                    f"leave the joint out with --without {name}"
                )
