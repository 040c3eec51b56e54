"""What moves: a simulation or a robot, behind one small protocol."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.types import Array, JointLimits

JOINT_ROWS = 5
"""Of `Measured.joints`."""


class BackendError(Exception):
    """A device does not answer, refuses or reports a fault; the text goes to the user as the reason."""


class Measured:
    """What a robot reports in one cycle, in one buffer: a single product finds what is not finite.

    External means: what the surroundings do to the arm, as far as the device can tell it from its
    own weight and motion; zeros if it cannot.

    Attributes:
        values: all of it, shape (5 dof + 12,).
        joints: the five rows that follow, shape (5, dof).
        position, velocity: rad, rad/s.
        effort: torques of the drives, N·m.
        desired_effort: torques that the drives were told to produce, N·m.
        external_effort: torques that the surroundings exert on the joints, N·m.
        wrench: force and torque that the surroundings exert at the TCP, shape (6,), N and N·m, in the base
            frame.
        external: the external torques and the wrench, shape (dof + 6,).
        sensor: raw readings of a force-torque sensor at the flange, shape (6,), N and N·m, in the TCP's
            frame: tool weight and inertia are in them.
    """

    def __init__(self, dof: int) -> None:
        self.values = np.zeros(JOINT_ROWS * dof + 12)
        self.joints = self.values[: JOINT_ROWS * dof].reshape(JOINT_ROWS, dof)
        self.position, self.velocity, self.effort, self.desired_effort, self.external_effort = self.joints
        self.wrench = self.values[JOINT_ROWS * dof :][:6]
        self.external = self.values[(JOINT_ROWS - 1) * dof : JOINT_ROWS * dof + 6]
        self.sensor = self.values[JOINT_ROWS * dof :][6:]


class Backend(Protocol):
    """A robot arm that takes a joint command each cycle.

    The constructor is called with (settings, limits). `open`, `enable`, `disable` and `close` may block;
    `read` and `write` are called each cycle and must be real-time safe: bounded, no allocation on
    purpose, no I/O but the device's own. Each method may raise BackendError.
    """

    def open(self, initial_position: Array) -> None:
        """Connect. A simulation stands at `initial_position`, shape (dof,), rad; a robot is where it is."""
        ...

    def enable(self) -> None:
        """Switch the drives on, holding the position; also after a fault, once its cause is gone."""
        ...

    def read(self, measured: Measured) -> None:
        """Fill in what is measured."""
        ...

    def write(self, command: Array) -> None:
        """Command where the joints should be now, shape (3, dof): rad, rad/s, rad/s²."""
        ...

    def disable(self) -> None:
        """Switch the drives off, brakes on."""
        ...

    def close(self) -> None:
        """Let go of the device."""
        ...


@dataclass(frozen=True, slots=True)
class Impedance:
    """How the arm gives way around its commanded position: springs and dampers.

    Attributes:
        cartesian: whether they act on the TCP along the base frame's axes (then 6 each, N/m and N·m/rad;
            the null space is held by the joints' own springs) or on the joints (dof each, N·m/rad).
        stiffness: of the springs.
        damping_ratio: of each spring with the inertia that it moves; 1 is critical.
    """

    cartesian: bool
    stiffness: Array
    damping_ratio: Array


@runtime_checkable
class ImpedanceControlled(Protocol):
    """A backend whose drives control torque: it can be told how to give way.

    Attributes:
        nominal_stiffness: of the joints at their stiffest, shape (dof,), N·m/rad.
        nominal_cartesian_stiffness: of the TCP at its stiffest, shape (6,), N/m and N·m/rad.
    """

    nominal_stiffness: Array
    nominal_cartesian_stiffness: Array

    def set_impedance(self, impedance: Impedance | None) -> None:
        """From the next cycle on; None for position control. Real-time safe."""
        ...


def make_backend(settings: Settings, limits: JointLimits) -> Backend:
    """The backend that `rt.backend` names: "mujoco", or a class as "package.module:Class".

    Raises:
        ConfigError: there is no such class, or it cannot be made.
        BackendError: its own reason.
    """
    name = settings.rt.backend
    location = "rtloop.backends.mujoco:MujocoBackend" if name == "mujoco" else name
    module, _, attribute = location.partition(":")
    if not attribute:
        raise ConfigError(f"rt.backend: {name!r} is neither mujoco nor package.module:Class")
    try:
        backend: Backend = getattr(importlib.import_module(module), attribute)(settings, limits)
    except BackendError:
        raise
    except Exception as exc:  # somebody else's module may raise anything
        raise ConfigError(f"rt.backend: cannot load {name!r}: {type(exc).__name__}: {exc}") from exc
    return backend
