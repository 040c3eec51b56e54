"""rtloop's cycle over FRI, without a network or processes: its cycles are a simulated cabinet's packets."""

from __future__ import annotations

from lockstep_fri import LockStep, fri_settings, joined
from rig import Rig

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode
from rtloop.backends.fri import FriBackend
from rtloop.backends.fri.messages import CommandMode, ControlMode, OperationMode
from rtloop.backends.fri.simulator.options import CabinetOptions

PERIOD_S = 0.005
CONTROL = {
    "position": ControlMode.POSITION,
    "torque": ControlMode.JOINT_IMPEDANCE,
    "wrench": ControlMode.CARTESIAN_IMPEDANCE,
}
"""What the cabinet's program has to be for each overlay."""


class FriStream(Rig):
    """The arm is held, and can be streamed to."""

    def __init__(
        self,
        settings: Settings,
        robot: RobotDescription,
        overlay: str = "position",
        mode: OperationMode = OperationMode.AUT,
    ) -> None:
        cell = CabinetOptions(
            period_ms=round(PERIOD_S * 1e3),
            operation_mode=mode,
            command_mode=CommandMode[overlay.upper()],
            control_mode=CONTROL[overlay],
        )
        self.arm: FriBackend
        self.channel: LockStep
        self.arm, self.channel = joined(settings, robot, cell, overlay=overlay, silence_s=1.0)
        super().__init__(fri_settings(settings, cell.period_ms, overlay=overlay), robot, backend=self.arm)
        self.step(400)
        assert self.mode is LoopMode.HOLD, self.reason

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            self.loop.beat()
            super().step()
