from typing import ClassVar

import mujoco

from cobot.config import Settings
from cobot.robot.device import Capabilities
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits
from rtloop.backends import Impedance, Measured
from rtloop.backends.compiled import CompiledBackend

class MujocoBackend(CompiledBackend):
    """The `Backend` that needs no robot, `ImpedanceControlled`.

    Attributes:
        nominal_stiffness, nominal_cartesian_stiffness: see `ImpedanceControlled`.
        fail_read, fail_write: error that the device reports from now on; "" for none.
        drive_fault: what the drives complain of: no reading and no `enable` until it is "" again.
        push: what the surroundings exert at the TCP, shape (6,), N and N·m, base frame; it may be written in
            place.
        jump: by how much the position is misread, shape (dof,), rad; likewise.
        stale: whether the readings stay what they are while the arm moves on.
        not_finite: whether the torque sensors report no number.
    """

    capabilities: ClassVar[Capabilities]
    nominal_stiffness: Array
    nominal_cartesian_stiffness: Array
    fail_read: str
    fail_write: str
    drive_fault: str
    push: Array
    jump: Array
    stale: bool
    not_finite: bool
    _model: mujoco.MjModel
    _data: mujoco.MjData
    _position: Array
    _transition: Array

    def __init__(self, settings: Settings, limits: JointLimits) -> None: ...
    def open(self, initial_position: Array) -> None: ...
    def enable(self) -> None:
        """The simulated drives are always on, but for a fault of theirs."""

    def set_tool(self, tool: Tool) -> None: ...
    def set_impedance(self, impedance: Impedance | None) -> None: ...
    def read(self, measured: Measured) -> None: ...
    def write(self, command: Array) -> None: ...
    def disable(self) -> None: ...
    def close(self) -> None: ...
    def restart(self, initial_position: Array) -> None: ...
    def pull(self, link: str, point: Array, target: Array) -> None: ...
    def let_go(self) -> None: ...
