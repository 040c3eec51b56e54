import numpy as np

from cobot.ipc.layout import Phase
from cobot.ipc.shm import RobotMemory
from cobot.robot.model import RobotModel
from cobot.types import Array

STATISTICS_CYCLES: int
EFFORT_RATE_S: float

class StatePublisher:
    """Writes the state block. Real-time safe."""

    def __init__(self, memory: RobotMemory, model: RobotModel) -> None: ...
    def publish_values(self, scalars: np.ndarray, measured: Array, command: Array) -> None: ...

class Statistics:
    """Histograms of the cycle's phases, in the statistics block. Real-time safe."""

    def __init__(self, memory: RobotMemory) -> None: ...
    def count(self, phase: Phase, duration_ns: int) -> None: ...
    def end_cycle(self) -> None: ...
