from cobot.config import StreamingSection
from cobot.ipc.shm import RobotMemory
from cobot.robot.model import RobotModel
from cobot.types import Array, LoopMode
from rtloop.backends import Backend
from rtloop.inboxes.stream import StreamInbox
from rtloop.safety.limiter import Safety

class Session:
    def __init__(
        self,
        section: StreamingSection,
        model: RobotModel,
        memory: RobotMemory,
        backend: Backend,
        safety: Safety,
        period_s: float,
    ) -> None: ...
    @property
    def box(self) -> StreamInbox: ...
    @property
    def session(self) -> int: ...
    @property
    def mode(self) -> LoopMode: ...
    @property
    def move_running(self) -> bool: ...
    @property
    def problem(self) -> str: ...
    @property
    def not_finite(self) -> str: ...
    def open(self, command: Array, mode: LoopMode, stops: int) -> str: ...
    def close(self) -> None: ...
