"""Forces or torques that a session adds to its position commands, for drives with their own compliance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.ipc.layout import Stream
from cobot.types import Array, JointLimits
from rtloop.backends import Backend, ImpedanceControlled, TorqueControlled, WrenchControlled

RISE_S = 0.1
"""Time in which a force or torque rises from zero to its maximum or falls back to zero, s, to avoid jumps."""
MAX_WRENCH = np.array([150.0] * 3 + [30.0] * 3)
"""Maximum force and torque, N and N·m. It is needed because, with compliant drives, only the surroundings
limit the motion that a force causes.
"""


class Overlay:
    """Ramps the force or torque that a session adds.

    Attributes:
        exerted: the current torques, shape (dof,), or the current wrench, shape (6,).
    """

    def __init__(self, write: Callable[[Array], None], most: Array, period_s: float) -> None:
        """
        Args:
            write: the backend's method that sets the force or torque.
            most: maximum of each value.
        """
        self._write, self._most, self._step = write, most, most * period_s / RISE_S
        self.exerted = np.zeros(len(most))

    def follow(self, wanted: Array) -> None:
        """Advance by one period towards the client's target."""
        within = np.clip(wanted, -self._most, self._most)
        self.exerted += np.clip(within - self.exerted, -self._step, self._step)
        self._write(self.exerted)

    def end(self) -> None:
        self.exerted[:] = 0.0
        self._write(self.exerted)


def overlay_of(request: np.ndarray, backend: Backend, limits: JointLimits, period_s: float) -> Overlay | None:
    """Return the overlay for a session request of the type `cobot.ipc.layout.session_dtype`; None if the
    session needs none.
    """
    if isinstance(backend, ImpedanceControlled):
        return None
    if request["stream"] == Stream.JOINT_TORQUE and isinstance(backend, TorqueControlled):
        return Overlay(backend.write_torque, limits.max_effort, period_s)
    if request["force_axes"].any() and isinstance(backend, WrenchControlled):
        return Overlay(backend.write_wrench, MAX_WRENCH, period_s)
    return None
