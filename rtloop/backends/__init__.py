"""What moves: a simulation or a robot, behind one small protocol."""

from __future__ import annotations

import importlib
from typing import Protocol

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.types import Array, JointLimits


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

    def read(self, measured: Array) -> None:
        """Fill in what is measured, shape (3, dof): rad, rad/s, N·m."""
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
