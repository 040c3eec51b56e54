from typing import ClassVar

from cobot.cell.plant import Plant
from cobot.config import Settings
from cobot.robot.io_points import IoPoint
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits
from rtloop.backends.mujoco import MujocoBackend

class CellBackend(MujocoBackend):
    """`MujocoBackend` in the cell of `robot.cell`: also `HasIo` and `HasCell`.

    Attributes:
        plant: what is stepped.
    """

    report_period_s: ClassVar[float]
    plant: Plant
    part_names: tuple[str, ...]

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        """Raises ConfigError: the cell file is invalid, or does not fit the arm."""

    def io(self) -> tuple[IoPoint, ...]: ...
    def set_output(self, name: str, value: float) -> None: ...
    def read_input(self, name: str) -> float: ...
    def mount(self, tool: Tool) -> None: ...
    def part_poses(self, poses: Array) -> None: ...
    def reset_cell(self) -> None: ...
