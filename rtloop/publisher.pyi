import numpy as np

from cobot.ipc.layout import Phase
from cobot.ipc.shm import RobotMemory
from cobot.robot.model import RobotModel
from cobot.types import Array
from rtloop.backends import Measured
from rtloop.clock import Clock
from rtloop.controller import Controller

STATISTICS_CYCLES: int
EFFORT_RATE_S: float

class StatePublisher:
    """Writes the state block. Real-time safe."""

    def __init__(
        self, memory: RobotMemory, model: RobotModel, controller: Controller, clock: Clock
    ) -> None: ...
    def publish(self, cycle: int, robot_time_s: float, measured: Measured, measured_ns: int) -> None: ...
    def set_reason(self, reason: str) -> None: ...
    def publish_values(self, scalars: np.ndarray, measured_values: Array, command: Array) -> None: ...

class Statistics:
    """Histograms of the cycle's phases, in the statistics block. Real-time safe."""

    def __init__(self, memory: RobotMemory) -> None: ...
    def count(self, phase: Phase, duration_ns: int) -> None: ...
    def cycle_done(self) -> None: ...
