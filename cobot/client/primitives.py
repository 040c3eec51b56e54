"""What `Robot.execute_primitive` can do: motions of the service, by the names that controllers use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cobot.client.connection import Json
from cobot.client.orientations import kuka_angles, normalised
from cobot.client.plans import Run
from cobot.errors import InputError
from cobot.types import vector


def primitive(name: str, params: Mapping[str, Any], dof: int) -> Run:
    """The call that executes a primitive.

    Raises:
        InputError: no such primitive, or wrong parameters; with the valid ones.
    """
    if name not in PRIMITIVES:
        raise InputError(f"there is no primitive {name!r}; valid are: {', '.join(PRIMITIVES)}")
    needed = PRIMITIVES[name]
    valid = (*needed, "speed", "accel_scale")
    for key in params:
        if key not in valid:
            raise InputError(f"{name}: unknown parameter {key!r}; valid are: {', '.join(valid)}")
    missing = [key for key in needed if key not in params]
    if missing:
        raise InputError(f"{name}: {missing[0]} is missing")
    rates: dict[str, Any] = {key: float(params[key]) for key in ("speed", "accel_scale") if key in params}
    if name == "Home":
        return lambda client: client.move_named("home", **rates)
    if name == "MoveNamed":
        return lambda client: client.move_named(str(params["name"]), **rates)
    if name == "MoveJ":
        joints = vector(params["target"], dof, name="MoveJ: target").tolist()
        return lambda client: client.move_joints(joints, **rates)
    x, y, z, *quaternion = vector(params["target"], 7, name=f"{name}: target").tolist()
    if not any(quaternion):
        raise InputError(f"{name}: the quaternion of target must not be zero")
    a, b, c = kuka_angles(normalised(quaternion))
    pose: Json = {"x": x, "y": y, "z": z, "a": a, "b": b, "c": c, "planner": PLANNERS[name], **rates}
    if name == "MoveC":
        pose["via"] = dict(zip("xyz", vector(params["via"], 3, name="MoveC: via").tolist(), strict=True))
    return lambda client: client.move_pose(**pose)


PRIMITIVES: dict[str, tuple[str, ...]] = {
    "Home": (),
    "MoveNamed": ("name",),
    "MoveJ": ("target",),
    "MovePTP": ("target",),
    "MoveL": ("target",),
    "MoveC": ("target", "via"),
}
"""Each primitive's parameters. `target`: joint angles, rad, of MoveJ; else x, y, z (m), w, x, y, z."""
PLANNERS = {"MovePTP": "ptp", "MoveL": "lin", "MoveC": "circ"}
