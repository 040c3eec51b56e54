"""Leaving out of a specification the joints that do not move."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path

import mujoco

from cobot.errors import ConfigError


def keep_joints(file: Path, spec: mujoco.MjSpec, kept: Container[str]) -> list[str]:
    """Take away all other joints, and what names them; returns their names. Actuators, sensors and keys go
    altogether.

    Raises:
        ConfigError: a joint that stays is no hinge or slide, or has no name.
    """
    for element in (*spec.actuators, *spec.sensors, *spec.keys):
        spec.delete(element)
    gone = [joint.name for joint in spec.joints if joint.name not in kept]
    for joint in list(spec.joints):
        if joint.name in gone:
            spec.delete(joint)
        elif joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            raise ConfigError(
                f"{file}: joint {joint.name!r} is a free or ball joint: an arm has a base that "
                "stands, and hinges and slides; take the joint out of the file, or name the arm's with "
                "--actuators: all others then stay at 0"
            )
        elif not joint.name:
            raise ConfigError(f"{file}: a joint has no name of its own; each needs one")
    lost = set(gone)
    for tendon in list(spec.tendons):
        if any(wrap.target is None or wrap.target.name in gone for wrap in tendon.path):
            lost.add(tendon.name)
            spec.delete(tendon)
    for equality in list(spec.equalities):
        if {equality.name1, equality.name2} & lost:
            spec.delete(equality)
    return gone
