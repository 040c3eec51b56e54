"""What `rtloop.sources.torque` computes, in numpy: the arm's equation of motion within its limits."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import Intervention
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits


class TorqueSource:
    """M(q) q'' = torque + what the surroundings exert - damping."""

    def __init__(self, model: RobotModel, limits: JointLimits, period_s: float) -> None:
        self._model, self._limits, self._period_s = model, limits, period_s
        self._damping = model.mj.dof_damping.copy()
        self.reference = np.zeros((3, limits.dof))
        self.heading = np.zeros(limits.dof)

    def begin(self, command: Array) -> None:
        self.reference[:] = command
        self.heading[:] = 0.0

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        if not np.isfinite(setpoint["joints"]).all():
            return Intervention.NOT_FINITE
        self.heading[:] = np.clip(setpoint["joints"], -self._limits.max_effort, self._limits.max_effort)
        return None

    def advance(self, external_effort: Array, wrench: Array) -> None:
        limits, period_s = self._limits, self._period_s
        position, velocity, acceleration = self.reference
        torque = self.heading + external_effort - self._damping * velocity
        wanted = np.linalg.solve(self._model.mass_matrix(position), torque)
        # So that the acceleration can be back at zero when the velocity has reached its limit.
        room = limits.max_velocity - np.sign(wanted) * velocity
        most = np.minimum(limits.max_acceleration, np.sqrt(2.0 * limits.max_jerk * np.maximum(room, 0.0)))
        step = limits.max_jerk * period_s
        acceleration += np.clip(np.clip(wanted, -most, most) - acceleration, -step, step)
        velocity += period_s * acceleration
        position += period_s * velocity

    def follow(self, command: Array) -> None:
        self.reference[:] = command
