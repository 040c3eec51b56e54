"""What moves: a simulation or a robot, behind one small protocol."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot import mujoco_library as mujoco_library
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits
from rtloop.backends.compiled import JOINT_ROWS, Measured

__all__ = [
    "JOINT_ROWS",
    "Backend",
    "BackendError",
    "CarriesTool",
    "Impedance",
    "ImpedanceControlled",
    "Measured",
    "make_backend",
]


class BackendError(Exception):
    """A device does not answer, refuses or reports a fault; the text goes to the user as the reason."""


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


@runtime_checkable
class CarriesTool(Protocol):
    """A backend whose drives have to know what they carry, as those that make up for gravity themselves."""

    def set_tool(self, tool: Tool) -> None:
        """From the next cycle on. Called before `open`, if there is a tool then, and while the arm rests: it
        may take some cycles, and the arm must not move.

        Raises:
            BackendError: the robot cannot carry it; nothing has changed.
        """
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
