"""Statements of `cobot new-robot` about the drives: whether they can hold the arm, which payload they can
carry, and how much friction they can overcome.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from cobot.robot.collision import CollisionChecker
from cobot.robot.holding import PAYLOAD_SHARE, Holding, HoldingEffort, payload
from cobot.robot.model import RobotModel
from cobot.types import JointLimits

FRICTION_SHARE = 0.3
"""Maximum share of the effort left after holding the arm that friction and damping may take at full speed.
Planned motions use the remaining effort.
"""
MIN_SHARE = 0.05
"""Share of the whole effort that friction and damping may always take, even if holding the arm leaves no
effort.
"""


def report_holding(holding: Holding, assumed: bool) -> list[str]:
    """A sentence for each joint that cannot hold the arm.

    Args:
        assumed: whether the masses of moving links have been assumed.
    """
    said = [
        f"{hold.joint} cannot hold the arm at {_rounded(hold)}: it needs {hold.needed:.4g} {hold.unit}, "
        f"but the file gives {hold.limit:.4g} {hold.unit}; correct its effort or the masses"
        for hold in holding.failing
    ]
    if said:
        said.append(
            f"motions into postures that cannot be held are rejected; {holding.percent} of the postures can "
            "be held"
        )
        if assumed:
            said.append(
                "the masses of some moving links are assumed: give them with --mass LINK=KG, or "
                "another density with --density"
            )
    return said


def payload_left(robot: RobotModel, collision: CollisionChecker) -> tuple[float, str]:
    """The value of `robot.max_payload_kg`, and a sentence that explains it. It is at most the arm's mass,
    because larger efforts in a file are only placeholders.
    """
    moving = float(robot.mj.body_mass[robot.mj.body_weldid != 0].sum())
    found, hold = payload(robot, collision, robot.limits)
    mass = _rounded_down(min(found, moving))
    if found > moving:
        why = "the drives would hold more than the arm weighs"
    elif mass == 0.0:
        why = f"{hold.joint} holds no more at {_rounded(hold)}"
    else:
        why = (
            "the drives hold this payload at the TCP in every posture, with "
            f"{100.0 * (1.0 - PAYLOAD_SHARE):.0f} % in reserve; {hold.joint} limits the payload at "
            f"{_rounded(hold)}"
        )
    return mass, f"robot.max_payload_kg {mass:g}: {why}; prefer the value in the data sheet"


def total_mass(mj: mujoco.MjModel) -> str:
    moving = mj.body_weldid != 0
    return f"total mass {mj.body_mass.sum():.4g} kg, of which {mj.body_mass[moving].sum():.4g} kg move"


def reduce_friction(
    spec: mujoco.MjSpec, robot: RobotModel, limits: JointLimits, holding: Holding
) -> list[str]:
    """Reduce friction and damping that the drives cannot overcome at full speed. Returns notes on the
    changes, for the report.
    """
    mj = robot.mj
    needed = {hold.joint: hold.needed for hold in holding.hardest}
    said = []
    for index, name in enumerate(limits.names):
        friction, damping = float(mj.dof_frictionloss[index]), float(np.ravel(mj.dof_damping[index])[0])
        lost = friction + damping * float(limits.max_velocity[index])
        effort, unit = float(limits.max_effort[index]), limits.effort_unit(index)
        left = max(effort - needed[name], 0.0)
        room = max(FRICTION_SHARE * left, MIN_SHARE * effort)
        if lost <= room:
            continue
        joint, factor, per = spec.joint(name), room / lost, f"{unit} per {limits.unit(index, 1)}"
        joint.frictionloss *= factor
        joint.damping = np.asarray(joint.damping) * factor
        said.append(
            f"{name}: friction reduced from {friction:.3g} to {factor * friction:.3g} {unit}, damping from "
            f"{damping:.3g} to {factor * damping:.3g} {per}: at full speed the values of the file take "
            f"{lost:.3g} "
            f"{unit}, and holding the arm leaves the drive {left:.3g} {unit}"
        )
    kept = [
        name for index, name in enumerate(limits.names) if mj.dof_frictionloss[index] or mj.dof_damping[index]
    ]
    if kept and not said:
        return [f"friction and damping of the file are simulated: {', '.join(kept)}"]
    return said


def _rounded(hold: HoldingEffort) -> str:
    return str(np.round(hold.posture, 2).tolist())


def _rounded_down(value: float) -> float:
    """Round down to two digits."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.6g}")
