"""The primitives of `Robot.execute_primitive`. They are the service's motions, under the names that robot
controllers use.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cobot.client.connection import Json
from cobot.client.plans import Run
from cobot.errors import InputError
from cobot.orientations import kuka_angles, normalised
from cobot.types import vector


@dataclass(frozen=True, slots=True)
class Primitive:
    """A motion of the service.

    Attributes:
        method: name of the method of `Client`.
        needed: required parameters.
        fixed: fields of the motion that the primitive sets.
        default: default values of fields.
    """

    method: str
    needed: tuple[str, ...]
    fixed: Mapping[str, str] = field(default_factory=dict)
    default: Mapping[str, str] = field(default_factory=dict)


PRIMITIVES: dict[str, Primitive] = {
    "Home": Primitive("move_named", (), {"name": "home"}),
    "MoveNamed": Primitive("move_named", ("name",)),
    "MoveJ": Primitive("move_joints", ("target",)),
    "MovePTP": Primitive("move_pose", ("target",), {"planner": "ptp"}),
    "MoveL": Primitive("move_pose", ("target",), {"planner": "lin"}),
    "MoveC": Primitive("move_pose", ("target",), {"planner": "circ"}),
    "MovePolyline": Primitive("move_pose", ("target", "through"), {"planner": "polyline"}),
    "MoveArc": Primitive("move_arc", ("centre", "axis", "angle")),
    "MoveFree": Primitive("move_pose", ("target",), default={"planner": "auto"}),
}
"""The primitives by name. For MoveJ, `target` contains joint angles, rad. For all others, it is a pose: x, y,
z (m), w, x, y, z. `through` contains poses. `via`, `centre` and `axis` are x, y, z. All other parameters are
fields of the motion, see docs/motions.md.
"""

_RATES = ("speed", "accel_scale")
_JOINT = (*_RATES, "planner", "budget_s", "algorithm", "synchronization", "constraints")
_TCP = (*_RATES, "speed_m_s", "speed_rad_s", "frame_id", "constraints", "free_axes", "cyclic")
_WAY = (
    *("planner", "budget_s", "algorithm", "synchronization", "via", "centre", "axis", "through", "radius"),
    "end_joints",
)
PARAMETERS = {
    "move_named": ("name", *_JOINT),
    "move_joints": ("target", *_JOINT),
    "move_pose": ("target", *_TCP, *_WAY),
    "move_arc": ("centre", "axis", "angle", *_TCP, "rise", "turn_tool"),
}
"""Parameters that primitives accept in addition to the fixed ones, by the method of `Client`."""


def primitive(name: str, params: Mapping[str, Any], dof: int) -> Run:
    """The method and the arguments that execute a primitive. The service checks the values of the fields.

    Raises:
        InputError: the primitive is unknown or its parameters are wrong; the message lists the valid ones.
    """
    if name not in PRIMITIVES:
        raise InputError(f"there is no primitive {name!r}; valid names: {', '.join(PRIMITIVES)}")
    made = PRIMITIVES[name]
    missing = [key for key in made.needed if key not in params]
    if missing:
        raise InputError(f"{name}: {missing[0]} is missing")
    body: Json = dict(made.default)
    for key, value in params.items():
        valid = [each for each in PARAMETERS[made.method] if each not in made.fixed]
        if key in made.fixed:
            raise InputError(f"{name}: {key} is {made.fixed[key]!r} and cannot be changed")
        if key not in valid:
            raise InputError(f"{name}: there is no parameter {key!r}; valid names: {', '.join(valid)}")
        body |= _fields(f"{name}: {key}", key, value, dof if made.method == "move_joints" else None)
    body |= made.fixed
    return lambda client: getattr(client, made.method)(**body)


def _fields(place: str, key: str, value: Any, dof: int | None) -> Json:
    """Convert a parameter to the form that it has in the body of the motion.

    Args:
        dof: number of joints of a target; None if the target is a pose.
    """
    match key:
        case "target" if dof is not None:
            return {"joints": vector(value, dof, name=place).tolist()}
        case "target":
            return _pose(place, value)
        case "through":
            if isinstance(value, str) or not isinstance(value, Sequence):
                raise InputError(f"{place} must be a list of poses")
            return {key: [_pose(f"{place}[{index}]", each) for index, each in enumerate(value)]}
        case "via" | "centre" | "axis":
            return {key: dict(zip("xyz", vector(value, 3, name=place).tolist(), strict=True))}
        case "speed" | "accel_scale":
            return {key: float(value)}
        case "name":
            return {key: str(value)}
    return {key: value}


def _pose(place: str, value: Any) -> Json:
    x, y, z, *quaternion = vector(value, 7, name=place).tolist()
    if not any(quaternion):
        raise InputError(f"{place}: the quaternion must not be zero")
    a, b, c = kuka_angles(normalised(quaternion))
    return {"x": x, "y": y, "z": z, "a": a, "b": b, "c": c}
