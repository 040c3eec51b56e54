"""The limits of a device in addition to those of the model. For each value the tighter limit applies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot.types import JointLimits

RATES = ("max_velocity", "max_acceleration", "max_jerk")


def device_limits(backend: object, model: JointLimits) -> JointLimits | None:
    """A backend's attribute `limits`; None if it has none for the model's number of joints."""
    limits = getattr(backend, "limits", None)
    return limits if isinstance(limits, JointLimits) and limits.dof == model.dof else None


def narrowed(model: JointLimits, device: JointLimits) -> JointLimits:
    """For each value, the tighter of both limits."""
    least = {
        name: np.minimum(getattr(model, name), getattr(device, name))
        for name in ("max_position", "max_effort", *RATES)
    }
    return replace(model, min_position=np.maximum(model.min_position, device.min_position), **least)


def slowed(model: JointLimits, device: JointLimits) -> float:
    """The share of the speed at which motions within the model's limits keep the device's limits. At a share
    s, velocities are s times the planned ones, accelerations s² and jerks s³ times.
    """
    both = narrowed(model, device)
    shares = [
        float((getattr(both, name) / getattr(model, name)).min() ** (1.0 / order))
        for order, name in enumerate(RATES, start=1)
    ]
    return float(min(1.0, *shares))


def differences(model: JointLimits, device: JointLimits) -> list[str]:
    """The limits of the device that are tighter than the model's, in words."""
    found = []
    for name in ("min_position", "max_position", *RATES, "max_effort"):
        ours, theirs = getattr(model, name), getattr(device, name)
        less = theirs > ours if name == "min_position" else theirs < ours
        found += [
            f"{name} of {model.names[joint]} {theirs[joint]:g} instead of {ours[joint]:g}"
            for joint in np.flatnonzero(less)
        ]
    return found
