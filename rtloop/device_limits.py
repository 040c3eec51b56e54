"""The limits of a device, in addition to the model's. The tighter of the two applies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot.types import JointLimits

RATES = ("max_velocity", "max_acceleration", "max_jerk")


def device_limits(backend: object, model: JointLimits) -> JointLimits | None:
    """Return a backend's attribute `limits`. None if it has none, or if its number of joints differs from the
    model's.
    """
    limits = getattr(backend, "limits", None)
    return limits if isinstance(limits, JointLimits) and limits.dof == model.dof else None


def narrowed(model: JointLimits, device: JointLimits) -> JointLimits:
    """Return the tighter of the model's limit and the device's limit, for each value."""
    least = {
        name: np.minimum(getattr(model, name), getattr(device, name))
        for name in ("max_position", "max_effort", *RATES)
    }
    return replace(model, min_position=np.maximum(model.min_position, device.min_position), **least)


def slowed(model: JointLimits, device: JointLimits) -> float:
    """Return the share of the planned speed at which a motion within the model's limits is also within the
    device's limits. At the share s, velocities are multiplied by s, accelerations by s² and jerks by s³.
    """
    both = narrowed(model, device)
    shares = [
        float((getattr(both, name) / getattr(model, name)).min() ** (1.0 / order))
        for order, name in enumerate(RATES, start=1)
    ]
    return float(min(1.0, *shares))


def differences(model: JointLimits, device: JointLimits) -> list[str]:
    """Describe in words the device limits that are tighter than the model's."""
    found = []
    for name in ("min_position", "max_position", *RATES, "max_effort"):
        ours, theirs = getattr(model, name), getattr(device, name)
        less = theirs > ours if name == "min_position" else theirs < ours
        found += [
            f"{name} of {model.names[joint]} {theirs[joint]:g} instead of {ours[joint]:g}"
            for joint in np.flatnonzero(less)
        ]
    return found
