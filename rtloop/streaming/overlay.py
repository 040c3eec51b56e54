"""What a session has a robot exert on top of its positions, where the robot's own drives give way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.ipc.layout import Stream
from cobot.types import Array, JointLimits
from rtloop.backends import Backend, ImpedanceControlled, TorqueControlled, WrenchControlled

RISE_S = 0.1
"""A force goes from nothing to the most in this time, and back, so that it does not jump."""
MAX_WRENCH = np.array([150.0] * 3 + [30.0] * 3)
"""N and N·m. Nothing but the surroundings ends the push of a force on drives that give way."""


class Overlay:
    """Attributes:
    exerted: what is asked of the robot now, shape (dof,) or (6,).
    """

    def __init__(self, write: Callable[[Array], None], most: Array, period_s: float) -> None:
        """
        Args:
            write: the backend's method.
            most: that it may be, each row.
        """
        self._write, self._most, self._step = write, most, most * period_s / RISE_S
        self.exerted = np.zeros(len(most))

    def follow(self, wanted: Array) -> None:
        """One period on towards what the client wants."""
        within = np.clip(wanted, -self._most, self._most)
        self.exerted += np.clip(within - self.exerted, -self._step, self._step)
        self._write(self.exerted)

    def end(self) -> None:
        self.exerted[:] = 0.0
        self._write(self.exerted)


def overlay_of(request: np.ndarray, backend: Backend, limits: JointLimits, period_s: float) -> Overlay | None:
    """Of a session, `cobot.ipc.layout.session_dtype`; None where positions and an impedance do all of it."""
    if isinstance(backend, ImpedanceControlled):
        return None
    if request["stream"] == Stream.JOINT_TORQUE and isinstance(backend, TorqueControlled):
        return Overlay(backend.write_torque, limits.max_effort, period_s)
    if request["force_axes"].any() and isinstance(backend, WrenchControlled):
        return Overlay(backend.write_wrench, MAX_WRENCH, period_s)
    return None
