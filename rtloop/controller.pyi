from cobot.config import Settings
from cobot.ipc.shm import RobotMemory
from cobot.robot.model import RobotModel
from cobot.types import Array
from rtloop.backends import Backend, Measured
from rtloop.clock import CycleClock
from rtloop.device import DeviceWatch
from rtloop.mode_machine import ModeMachine
from rtloop.tool_and_scene import ToolAndScene

class Controller(ModeMachine):
    stale: bool
    start_position: Array | None
    cycle_clock: CycleClock

    def __init__(
        self,
        settings: Settings,
        model: RobotModel,
        memory: RobotMemory,
        backend: Backend,
        device: DeviceWatch,
    ) -> None: ...
    @property
    def tool_and_scene(self) -> ToolAndScene: ...
    @property
    def slot(self) -> int: ...
    def acknowledge(self) -> None: ...
    def update(self, measured: Measured, now_ns: int, robot_time_s: float, *, fresh: bool) -> None: ...
