"""Checks of a robot's file that MuJoCo does not make."""

from __future__ import annotations

from pathlib import Path

import mujoco

from cobot.errors import ConfigError
from cobot.xml_file import is_printable, shown

MAX_NAMED = 10


def check_names(model: mujoco.MjModel) -> None:
    """Check that the names of joints, bodies and sites work as keys, in topics and in messages.

    Raises:
        ConfigError: a name does not work.
    """
    for kind, count, get in (
        ("joint", model.njnt, model.joint),
        ("body", model.nbody, model.body),
        ("site", model.nsite, model.site),
    ):
        for name in (get(index).name for index in range(count)):
            if name and not is_printable(name):
                raise ConfigError(
                    f"a {kind} has the name {shown(name)}; give it a printable name of 1 to 200 characters "
                    "without spaces at its ends"
                )


def require_inertials(file: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Check that MuJoCo has not invented the mass of a moving link.

    For a URDF link without `<inertial>`, MuJoCo silently computes a mass from the collision shapes, with a
    density of 1000 kg/m³. `cobot new-robot` also assumes masses, but reports each of them.

    Args:
        model: the model that was compiled from `spec`.

    Raises:
        ConfigError: a mass is invented; the message names the link and a remedy.
    """
    if file.suffix.lower() != ".urdf":
        return  # MJCF defines the density of shapes
    missing = [
        body.name
        for body in spec.bodies[1:]
        if not body.explicitinertial and model.body_weldid[body.id] != 0 and model.body_mass[body.id] > 0.0
    ]
    if missing:
        names = ", ".join(missing[:MAX_NAMED])
        more = f" and {len(missing) - MAX_NAMED} more" if len(missing) > MAX_NAMED else ""
        raise ConfigError(
            f"no <inertial> in {names}{more}: the masses of these links are not known. Add it, or let "
            f"`cobot new-robot {file.name}` make a model of the file: it lists the masses that it assumes, "
            "and takes yours (--mass)"
        )
