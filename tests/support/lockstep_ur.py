"""A simulated controller of Universal Robots and the backend in one process, as the tests drive them."""

from __future__ import annotations

import numpy as np

from rtloop.backends.ur import UrBackend
from rtloop.backends.ur.simulator.lockstep import UrLockStep


def hold(backend: UrBackend, way: UrLockStep, cycles: int) -> None:
    """Cycles in which the arm is commanded to where the controller holds it."""
    command = np.zeros((3, 6))
    for _ in range(cycles):
        backend.wait(0.1)
        command[0] = way.controller.arm.setpoint
        backend.write(command)
