"""The joint limits in a URDF. Missing values get the defaults of the format, and no limit is wider than in
the file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

from cobot.errors import ConfigError
from cobot.launch.robot_file.typed import typed
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
    """Write the format's default values into the file. A missing `lower` or `upper` becomes 0, and continuous
    joints get no range.

    MuJoCo would ignore a range of which only one end is given.
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


def check_driven(file: Path, root: Element, driven: Sequence[str], without: Sequence[str]) -> None:
    """Reject an arm with a joint whose limits in the file leave no range.

    Args:
        without: joints that are already left out. The option that the message suggests must repeat them.

    Raises:
        ConfigError: there is such a joint; the message names the line, the first joint and the remedies.
    """
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    rangeless = [name for name in driven if name in joints and _is_rangeless(joints[name])]
    if not rangeless:
        return
    name, joint = rangeless[0], joints[rangeless[0]]
    limit = joint.find("limit")
    told = "no <limit>" if limit is None else "a range of 0, because lower and upper are equal or missing"
    raise ConfigError(
        f"{where(file, joint if limit is None else limit)}: joint {name!r} is {joint.get('type')} and "
        f"has {told}; {WAYS_OUT[str(joint.get('type'))]}{_leave_out(rangeless, driven, without)}"
    )


def check_supported(file: Path, root: Element, limits: JointLimits, without: Sequence[str]) -> None:
    """Reject limits beyond what cobot supports.

    Args:
        without: see `check_driven`.

    Raises:
        ConfigError: there is such a limit; the message names the line, the first joint, the value and the
            bound.
    """
    elements = {joint.get("name"): joint for joint in root.iter("joint")}
    found = list(_unsupported(limits))
    if not found:
        return
    name, what = found[0]
    failing = list(dict.fromkeys(name for name, _ in found))
    raise ConfigError(
        f"{where(file, elements.get(name))}: joint {name!r}: {what}; correct it in the file"
        f"{_leave_out(failing, limits.names, without)}"
    )


def soft_limits(file: Path, root: Element) -> dict[str, str]:
    """A sentence for each joint whose <safety_controller> gives a narrower range than <limit>, by joint name.

    cobot does not apply this range, because it is the range beyond which the controller of a different
    program slows the joint down.
    """
    found = {}
    for joint in root.findall("joint"):
        name, soft, limit = str(joint.get("name")), joint.find("safety_controller"), joint.find("limit")
        if soft is None or limit is None or joint.get("type") == "continuous":
            continue
        of = f"joint {name!r}"
        hard = number(file, limit, "lower", of, 0.0), number(file, limit, "upper", of, 0.0)
        low = number(file, soft, "soft_lower_limit", of, hard[0])
        high = number(file, soft, "soft_upper_limit", of, hard[1])
        if low < high and (low > hard[0] or high < hard[1]):
            found[name] = (
                f"{name}: <safety_controller> has soft limits of {low:.6g} to {high:.6g}, which are not "
                "applied; to keep them, narrow min_position and max_position in joint_limits.yaml"
            )
    return found


def _is_rangeless(joint: Element) -> bool:
    limit = joint.find("limit")
    return joint.get("type") in WAYS_OUT and (limit is None or "lower" not in limit.attrib)


def _unsupported(limits: JointLimits) -> Iterator[tuple[str, str]]:
    """The joints with limits beyond what cobot supports, and a sentence on each limit."""
    for index, name in enumerate(limits.names):
        for quantity in limits.QUANTITIES:
            value = float(getattr(limits, quantity)[index])
            bound = MAX_POSITION if quantity.endswith("position") else MAX_RATE
            if not abs(value) < bound:
                supported = f"cobot supports less than {bound:.0f}{DERIVED.get(quantity, '')}"
                yield name, f"{quantity} is {value:g}, {supported}"


def _leave_out(failing: Sequence[str], driven: Sequence[str], without: Sequence[str]) -> str:
    """The option that leaves out all failing joints; "" if no joint would be left."""
    if len(failing) == len(driven):
        return ""
    it = "it" if len(failing) == 1 else f"all {len(failing)} such joints"
    return f", or leave {it} out with {typed('--without', *without, *failing)}"
