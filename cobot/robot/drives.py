"""Checks that a model's actuators and ranges match the joint limits, which the simulation requires."""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.errors import ConfigError
from cobot.types import JointLimits
from cobot.units import MILLIMETRES_FROM_M

TOLERANCE = 1e-6
"""Tolerance for positions rounded in files, rad or m."""
MILLIMETRES_PER_S_FROM = 20.0
"""Speed limit of a linear joint, m/s, above which the value was probably written in mm/s, because no arm
is that fast.
"""
MILLIMETRES_FROM_RATIO = 100.0
"""Factor by which limits may exceed those of the model. Beyond it, they were probably written in a
different unit.
"""
UNITS_OF_SLIDES = "limits of a prismatic joint are in m, m/s, m/s², m/s³ and N"


def check_drives(mj: mujoco.MjModel, limits: JointLimits) -> None:
    """Reject a model that does not have exactly one motor per joint, in joint order.

    Raises:
        ConfigError: the motors do not match the joints; the message names the actuator and a remedy.
    """
    for index in range(mj.nu):
        name = mj.actuator(index).name or f"number {index}"
        if (
            mj.actuator_gaintype[index] != mujoco.mjtGain.mjGAIN_FIXED
            or mj.actuator_biastype[index] != mujoco.mjtBias.mjBIAS_NONE
            or mj.actuator_dyntype[index] != mujoco.mjtDyn.mjDYN_NONE
            or mj.actuator_gainprm[index, 0] != 1.0
            or mj.actuator_gear[index, 0] != 1.0
        ):
            raise ConfigError(
                f"actuator {name} is not a <motor> of gear 1 (perhaps a position or velocity actuator): the "
                "simulation commands torques; make it <motor joint=...>, or let `cobot new-robot` do so"
            )
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    driven = [
        mj.joint(mj.actuator_trnid[index, 0]).name if mj.actuator_trntype[index] in kinds else "no joint"
        for index in range(mj.nu)
    ]
    if tuple(driven) != limits.names:
        raise ConfigError(
            f"the actuators move {', '.join(driven) or 'nothing'}, but must move {', '.join(limits.names)}; "
            "write one <motor> for each joint in this order, or let `cobot new-robot` write them"
        )


def check_passive_forces(mj: mujoco.MjModel) -> None:
    """Reject a model with springs, tendons, gravity compensation or drag. These forces would push the arm off
    its path, because planning and drives ignore them.

    Raises:
        ConfigError: there is such a force; the message names the first one and a remedy.
    """
    found = [f"stiffness of joint {mj.joint(each).name}" for each in np.flatnonzero(mj.jnt_stiffness)]
    found += [f"tendon {mj.tendon(each).name}" for each in range(mj.ntendon)]
    found += [f"gravcomp of body {mj.body(each).name}" for each in np.flatnonzero(mj.body_gravcomp)]
    found += [f"margin of joint {mj.joint(each).name}" for each in np.flatnonzero(mj.jnt_margin)]
    if mj.opt.density or mj.opt.viscosity:
        found.append("density or viscosity of the option")
    if found:
        raise ConfigError(
            f"{found[0]}: it would push the simulated arm off its path, because planning ignores it; "
            "remove it, or let `cobot new-robot` do so"
        )


def check_forces(mj: mujoco.MjModel, limits: JointLimits) -> None:
    """Reject effort limits beyond those of the model's drives, because the simulation would silently clip the
    efforts.

    Raises:
        ConfigError: an effort limit is too high; the message names the joint, both efforts and a remedy.
    """
    for index, (name, effort) in enumerate(zip(limits.names, limits.max_effort.tolist(), strict=True)):
        bounds = [
            (what, float(np.abs(span[index]).min()))
            for what, limited, span in (
                ("ctrlrange", mj.actuator_ctrllimited, mj.actuator_ctrlrange),
                ("forcerange", mj.actuator_forcelimited, mj.actuator_forcerange),
                ("actuatorfrcrange", mj.jnt_actfrclimited, mj.jnt_actfrcrange),
            )
            if limited[index]
        ]
        for what, bound in bounds:
            if effort > bound + TOLERANCE * max(1.0, bound):
                unit = limits.effort_unit(index)
                raise ConfigError(
                    f"max_effort of {name} is {effort:g} {unit}, but the model's {what} allows "
                    f"{bound:g} {unit}: set max_effort to {bound:g} or less, or widen {what}"
                )


def check_ranges(mj: mujoco.MjModel, limits: JointLimits) -> None:
    """Reject position limits wider than the model's, and limits of linear joints in millimetres.

    Raises:
        ConfigError: a range is too wide; the message names the joint, both ranges and a remedy.
    """
    for index, name in enumerate(limits.names):
        low, high = limits.min_position[index], limits.max_position[index]
        slides = mj.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE
        unit = "m" if slides else "rad"
        lowest, highest = mj.jnt_range[index]
        longest = MILLIMETRES_FROM_M
        if mj.jnt_limited[index]:
            longest = min(longest, MILLIMETRES_FROM_RATIO * max(abs(lowest), abs(highest)))
        if slides and max(abs(low), abs(high)) > longest:
            raise ConfigError(
                f"{name} slides from {low:g} to {high:g} m, which looks like millimetres: {UNITS_OF_SLIDES}"
            )
        if slides and limits.max_velocity[index] > MILLIMETRES_PER_S_FROM:
            raise ConfigError(
                f"max_velocity of {name} is {limits.max_velocity[index]:g} m/s, which looks like mm/s: "
                f"{UNITS_OF_SLIDES}"
            )
        if mj.jnt_limited[index] and (low < lowest - TOLERANCE or high > highest + TOLERANCE):
            raise ConfigError(
                f"{name} may move from {low:g} to {high:g} {unit}, but the model allows {lowest:g} to "
                f"{highest:g} {unit}: set min_position to {np.ceil(lowest * 1e6) / 1e6:g} and "
                f"max_position to {np.floor(highest * 1e6) / 1e6:g}, or less"
            )
