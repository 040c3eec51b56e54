"""Options of a simulated cabinet."""

from __future__ import annotations

from dataclasses import dataclass, field

from rtloop.backends.fri.messages import CommandMode, ControlMode, IoValue, OperationMode
from rtloop.backends.simulators.arm import Springs

NEEDED_CONTROL = {
    CommandMode.WRENCH: ControlMode.CARTESIAN_IMPEDANCE,
    CommandMode.TORQUE: ControlMode.JOINT_IMPEDANCE,
}
"""Control mode of the drives that an overlay requires. Positions work in any mode."""
SPRINGS: dict[ControlMode, Springs] = {
    ControlMode.CARTESIAN_IMPEDANCE: "cartesian",
    ControlMode.JOINT_IMPEDANCE: "joint",
}
MIN_PERIOD_MS, MAX_PERIOD_MS = 1, 100


@dataclass(frozen=True, slots=True)
class CabinetOptions:
    """
    Attributes:
        period_ms: interval between two monitoring messages, 1 to 100.
        multiplier: number of monitoring messages after which an answer is expected.
        version: "1.x", "2.x" or "2.7". It determines the fields of the messages and whether they are framed.
        command_mode: commands that the overlay of its program accepts: positions, wrenches or torques.
        control_mode: control mode of the drives: position, or an impedance.
        io: inputs and outputs that its program has registered.
    """

    period_ms: int = 5
    multiplier: int = 1
    version: str = "1.x"
    operation_mode: OperationMode = OperationMode.AUT
    command_mode: CommandMode = CommandMode.POSITION
    control_mode: ControlMode = ControlMode.POSITION
    io: tuple[IoValue, ...] = field(default=())

    @property
    def springs(self) -> Springs | None:
        """Return the impedance of the drives; None in position control."""
        return SPRINGS.get(self.control_mode)

    def __post_init__(self) -> None:
        if not MIN_PERIOD_MS <= self.period_ms <= MAX_PERIOD_MS:
            raise ValueError(
                f"the send period is {self.period_ms} ms; FRI allows {MIN_PERIOD_MS} to {MAX_PERIOD_MS} ms"
            )
        if self.multiplier < 1:
            raise ValueError(f"the receive multiplier is {self.multiplier}; it must be 1 or more")
