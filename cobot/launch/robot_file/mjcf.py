"""MJCF as a MuJoCo specification."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from cobot.errors import ConfigError


def read_mjcf(file: Path, named: Path | None = None) -> mujoco.MjSpec:
    """Args:
        named: what messages call it.

    Raises:
        ConfigError: MuJoCo's reason.
    """
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as exc:
        raise ConfigError(f"{named or file}: MuJoCo cannot read it: {' '.join(str(exc).split())}") from exc


def mjcf_rates(spec: mujoco.MjSpec) -> dict[str, tuple[float, float]]:
    """What `urdf_rates` is, by a MJCF file's actuators, which know no velocity: what the strongest of a joint
    can do, by its range of forces, or of a motor's commands.
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


def has_bounds(flag: int, bounds: np.ndarray) -> bool:
    """Whether a range counts: with `auto`, if there is one."""
    return flag == mujoco.mjtLimited.mjLIMITED_TRUE or (
        flag == mujoco.mjtLimited.mjLIMITED_AUTO and bool(bounds[0] < bounds[1])
    )
