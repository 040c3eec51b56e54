"""Forces on an arm other than those of its drives, gravity, friction and damping: springs, tendons and drag.

cobot ignores them when it plans and holds an arm, so in a simulation they would push the arm off its path.
"""

from __future__ import annotations

import mujoco
import numpy as np

MEDIUM = ("density", "viscosity", "wind")


def remove_passive_forces(spec: mujoco.MjSpec) -> list[str]:
    """Remove passive forces, such as springs, from the specification of an arm without its gripper. Returns
    a sentence for each kind of force that was found.
    """
    found = {
        "springs": [joint.name for joint in spec.joints if np.any(joint.stiffness)],
        "tendons": [tendon.name or "one without a name" for tendon in spec.tendons if _has_effect(tendon)],
        "gravity compensation (gravcomp)": [body.name for body in spec.bodies if body.gravcomp],
        "margins of joint limits": [joint.name for joint in spec.joints if joint.margin],
    }
    said = [f"{kind} of the file removed, because planning ignores them: {', '.join(names)}"
            for kind, names in found.items() if names]  # fmt: skip
    for joint in spec.joints:
        joint.stiffness, joint.margin = np.zeros_like(joint.stiffness), 0.0
    for body in spec.bodies:
        body.gravcomp = 0.0
    for equality in list(spec.equalities):
        if equality.type == mujoco.mjtEq.mjEQ_TENDON:
            spec.delete(equality)
    for tendon in list(spec.tendons):
        spec.delete(tendon)
    return said + _remove_margins(spec) + _remove_medium(spec)


def _has_effect(tendon: mujoco.MjsTendon) -> bool:
    """Whether a tendon pulls, brakes or limits joints."""
    forces = (tendon.stiffness, tendon.damping, tendon.frictionloss)
    return any(map(np.any, forces)) or bool(tendon.range[0] < tendon.range[1])


def _remove_margins(spec: mujoco.MjSpec) -> list[str]:
    """Set the margins of contacts to 0, so that contact forces act only where shapes touch. The settings
    define the distances that cobot keeps.
    """
    overrides = int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    shapes = [*spec.geoms, *spec.pairs]
    had = any(shape.margin or shape.gap for shape in shapes) or bool(spec.option.enableflags & overrides)
    for shape in shapes:
        shape.margin = shape.gap = 0.0
    spec.option.enableflags &= ~overrides
    return ["margins of contacts in the file are set to 0: cobot keeps its own distances"] if had else []


def _remove_medium(spec: mujoco.MjSpec) -> list[str]:
    if not any(np.any(getattr(spec.option, name)) for name in MEDIUM):
        return []
    spec.option.density = spec.option.viscosity = 0.0
    spec.option.wind = np.zeros(3)
    return ["the medium of the file (density, viscosity, wind) is removed: cobot does not simulate its drag"]
