import mujoco

from cobot.cell.plant import Plant
from cobot.robot.io_points import IoPoint

class CellDevices:
    """The hand, the belts and the switches of a plant, and their inputs and outputs.

    Args:
        data: the data in which the plant is stepped.
    """

    def __init__(self, plant: Plant, data: mujoco.MjData, period_s: float) -> None: ...
    def reset(self) -> None:
        """Give all outputs and counters their first values."""

    def io(self) -> tuple[IoPoint, ...]:
        """All inputs and outputs."""

    def read_input(self, name: str) -> float:
        """The current value of an input or output."""

    def set_output(self, name: str, value: float) -> None:
        """Set an output.

        Raises:
            BackendError: there is none of this name, or the value is out of its range.
        """
