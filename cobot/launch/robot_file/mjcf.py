"""MJCF as a MuJoCo specification."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np

from cobot.errors import ConfigError
from cobot.launch.robot_file.worker import Worker, absolute

MOTOR_FIELDS = ("gear", "ctrlrange", "forcerange", "actrange", "armature", "damping", "delay", "nsample")
LINE = re.compile(r",? line \d+(, column \d+)?")


def load_spec(file: Path, copy: Path) -> mujoco.MjSpec:
    """The specification of a file that MuJoCo reads: MJCF, or a copy of a URDF.

    Args:
        file: the user's file, for messages.

    Raises:
        ConfigError: MuJoCo cannot read the file; the message gives MuJoCo's reason.
    """
    try:
        return mujoco.MjSpec.from_file(str(copy))
    except ValueError as exc:
        raise ConfigError(f"{file}: MuJoCo cannot read it: {reason(exc, file == copy)}") from exc


def reason(exc: Exception, lines: bool = True) -> str:
    """MuJoCo's message in one line. Without `lines`, line numbers are removed, because they refer to a file
    that the user does not know.
    """
    said = " ".join(str(exc).split())
    return said if lines else LINE.sub("", said)


def read_mjcf(file: Path, worker: Worker) -> mujoco.MjSpec:
    """The specification of an MJCF file, without textures.

    Raises:
        ConfigError: MuJoCo cannot read the file, or the model is too large.
    """
    try:
        worker.ask("mjcf", file=absolute(file))
    except ConfigError as exc:
        raise ConfigError(f"{file}: {exc}") from exc
    spec = load_spec(file, file)
    remove_textures(spec)
    return spec


def remove_textures(spec: mujoco.MjSpec) -> None:
    """Remove textures, because nothing draws them. Materials keep their colours."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


def mjcf_rates(spec: mujoco.MjSpec) -> dict[str, tuple[float, float]]:
    """The velocity and the effort limit of each joint, found from the actuators in an MJCF file. `urdf_rates`
    does the same for a URDF.

    Actuators do not define a velocity, so it is 0. The effort is the effort of the joint's strongest
    actuator. It is read from the actuator's range of forces, or for a motor from its range of commands.
    """
    rates: dict[str, tuple[float, float]] = {}
    for actuator in spec.actuators:
        if actuator.trntype not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            continue
        effort = 0.0
        if has_bounds(actuator.forcelimited, actuator.forcerange):
            effort = float(np.abs(actuator.forcerange).min())
        elif actuator.biastype == mujoco.mjtBias.mjBIAS_NONE and has_bounds(
            actuator.ctrllimited, actuator.ctrlrange
        ):
            effort = float(np.abs(actuator.ctrlrange).min() * abs(actuator.gainprm[0]))
        effort *= abs(float(actuator.gear[0]))
        rates[actuator.target] = (0.0, max(effort, rates.get(actuator.target, (0.0, 0.0))[1]))
    return rates


def add_motor(spec: mujoco.MjSpec, joint: str) -> None:
    """Add a motor of gear 1 for a joint. The file's defaults for actuators are not used, because they would
    limit or scale the motor's torque.
    """
    motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_motor()
    plain = mujoco.MjSpec().add_actuator()
    plain.set_to_motor()
    for name in MOTOR_FIELDS:
        setattr(motor, name, getattr(plain, name))
    for what in ("ctrl", "force", "act"):
        setattr(motor, f"{what}limited", mujoco.mjtLimited.mjLIMITED_FALSE)


def has_bounds(flag: int, bounds: np.ndarray) -> bool:
    """Whether a range applies. With the flag `auto` it applies if it is not empty."""
    return flag == mujoco.mjtLimited.mjLIMITED_TRUE or (
        flag == mujoco.mjtLimited.mjLIMITED_AUTO and bool(bounds[0] < bounds[1])
    )
