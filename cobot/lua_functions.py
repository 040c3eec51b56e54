"""The functions that a Lua program can call, with their parameters, for editors.

docs/lua.md explains the functions. `[]` marks optional parameters. `{}` marks a table with named fields,
which are the fields of the request.
"""

from __future__ import annotations

from pydantic import BaseModel

from cobot.motions.force_bodies import FollowMotion, InsertMotion, PressMotion, SearchMotion
from cobot.motions.gripper_bodies import GripperGrasp, GripperMove, GripperRelease


def _table(model: type[BaseModel]) -> str:
    """The fields of a request as a Lua table."""
    fields = model.model_fields.items()
    needed = ", ".join(f"{name} = ..." for name, field in fields if field.is_required())
    rest = ", ".join(name for name, field in fields if not field.is_required())
    return f"{{ {needed} [{', ' if needed else ''}{rest}] }}" if rest else f"{{ {needed} }}"


FUNCTIONS: dict[str, str] = {
    "call": "(file)",
    "clock": "()",
    "follow": _table(FollowMotion),
    "from_json": "(text)",
    "getJointPositions": "()",
    "getTcpPose": "()",
    "get_joint_positions": "()",
    "get_tcp_pose": "()",
    "gripper.grasp": _table(GripperGrasp),
    "gripper.home": "()",
    "gripper.move": _table(GripperMove),
    "gripper.release": _table(GripperRelease),
    "gripper.stop": "()",
    "insert": _table(InsertMotion),
    "move": "(target [, target ...])",
    "moveCircle": "(via, pose [, speed [, accel_scale]])",
    "moveJoint": "(q [, speed [, accel_scale]])",
    "moveLine": "(pose [, speed [, accel_scale]])",
    "move_named": "(name [, speed [, accel_scale]])",
    "movec": "(via, pose [, speed [, accel_scale]])",
    "movej": "(q [, speed [, accel_scale]])",
    "movel": "(pose [, speed [, accel_scale]])",
    "on_error": "(work [, { retry = ..., run = ..., go_on = ... }])",
    "pallet": "(origin, counts, offsets)",
    "press": _table(PressMotion),
    "print": "(...)",
    "require": '("ros_bind")',
    "robot.call": '("Class", "method" [, { name = value }])',
    "search": _table(SearchMotion),
    "set": "(output, value)",
    "sleep": "(s)",
    "textmsg": "(...)",
    "to_json": "(value)",
    "wait_for": "(condition [, timeout_s])",
    "wait_s": "(s)",
}
