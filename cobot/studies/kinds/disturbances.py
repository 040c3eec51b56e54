"""The differences between a real cell and its model, applied to a simulated arm."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array
from rtloop.backends.mujoco import MujocoBackend

PARAMETERS = (
    "payload_kg",
    "friction_nm",
    "joint_offset_rad",
    "encoder_noise_rad",
    "part_x_m",
    "part_y_m",
    "part_z_m",
    "speed",
)
"""Names of the parameters of a robustness study."""
STEP_S = 1e-3
"""Time step for the acceleration of the payload, in seconds."""


@dataclass(slots=True)
class UnknownLoad:
    """Forces and errors that the cycle does not know; see `rtloop.rehearsal.Disturbance`.

    Attributes:
        payload_kg: mass at the TCP, in addition to the tool.
        friction_nm: dry friction of each joint, N·m; N for linear joints.
        noise_rad: standard deviation of each reading.
        joints: the true position in the last cycle, shape (dof,).
    """

    robot: RobotDescription
    trajectory: Trajectory
    payload_kg: float
    friction_nm: float
    noise_rad: float
    random: np.random.Generator
    joints: Array = field(default_factory=lambda: np.zeros(0))
    _forces: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def prepare(self, backend: MujocoBackend) -> None:
        backend._model.dof_frictionloss[:] = self.friction_nm
        if self.payload_kg:
            times = np.arange(0.0, self.trajectory.duration_s, STEP_S)
            places = self.robot.model.poses(self.trajectory.sample(times))[:, :3]
            acceleration = np.zeros_like(places)
            if len(places) > 2:
                acceleration[1:-1] = np.diff(places, 2, axis=0) / STEP_S**2
            gravity = self.robot.model.gravity
            self._forces = self.payload_kg * np.vstack([gravity - acceleration, gravity])

    def act(self, backend: MujocoBackend, time_s: float) -> None:
        if self.payload_kg:
            step = int(time_s / STEP_S + 0.5)
            backend.push[:3] = self._forces[min(step, len(self._forces) - 1)]  # the last one: force at rest
        if self.noise_rad:
            backend.jump[:] = self.random.normal(0.0, self.noise_rad, len(backend.jump))
        self.joints = backend._position.copy()
