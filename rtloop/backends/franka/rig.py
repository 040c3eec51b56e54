"""The backend with a stand-in for the robot, for the contract tests."""

from __future__ import annotations

from cobot.config import Settings
from cobot.types import Array, JointLimits
from rtloop.backends.franka.backend import FrankaBackend
from rtloop.backends.franka.stand_in import FrankaStandIn
from rtloop.backends.franka.stand_in_library import RobotMode
from rtloop.contract import FAULTS

LASTING = "joint_position_limits_violation"
"""A reflex from which the robot recovers only after a person has moved the arm back."""


class FrankaRig:
    """A `ContractRig` with a stand-in for the robot. It lacks faults that do not exist on a Franka: there are
    no modes T1, T2 and AUT, and libfranka drops packets that are out of order or have accumulated.
    """

    faults = frozenset(FAULTS) - {"operation_mode"}

    def __init__(self, settings: Settings, limits: JointLimits, arm: FrankaStandIn | None = None) -> None:
        self._settings, self._limits = settings, limits
        self._arm = arm or FrankaStandIn()

    @property
    def wire(self) -> list[Array]:
        return self._arm.wire

    def backend(self) -> FrankaBackend:
        arm = self._arm
        return FrankaBackend(self._settings, self._limits, library=arm.library, knock=arm.knock)

    def inject(self, fault: str) -> None:
        self._arm.faults.add(fault)
        if fault == "e_stop":
            self._arm.press_stop()
        elif fault == "protective_stop":
            self._arm.stop_by(LASTING)

    def clear(self, fault: str) -> None:
        self._arm.faults.discard(fault)
        if fault == "e_stop":
            self._arm.mode = RobotMode.Idle
