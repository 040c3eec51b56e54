from collections.abc import Callable

from cobot.config import Settings
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.shm import RobotMemory
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array
from rtloop.backends import Backend, Measured
from rtloop.clock import CycleClock
from rtloop.controller import Controller

class ControlLoop:
    @property
    def controller(self) -> Controller: ...
    @property
    def _measured(self) -> Measured: ...
    def __init__(
        self,
        settings: Settings,
        model: RobotModel,
        memory: RobotMemory,
        backend: Backend,
        clock: CycleClock,
        recording: RecordingMemory | None = None,
    ) -> None: ...
    def open(
        self, start_position: Array, tool: Tool = ..., before: Callable[[], None] | None = None
    ) -> None: ...
    def beat(self) -> int: ...
    def step(self, late_ns: int = 0) -> None: ...
    def run(self, ending: list[str]) -> None: ...
    def close(self) -> None: ...
