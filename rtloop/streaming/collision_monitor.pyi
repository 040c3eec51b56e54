import mujoco

from cobot.config import StreamingSection
from cobot.robot.model import RobotModel
from cobot.types import Array

class CollisionMonitor:
    share: float
    blocked: bool
    inside: bool
    def __init__(
        self,
        model: RobotModel,
        section: StreamingSection,
        period_s: float,
        mj: mujoco.MjModel | None = None,
        apart: set[frozenset[str]] | frozenset[frozenset[str]] = ...,
    ) -> None: ...
    def blocking(self) -> tuple[tuple[str, str], ...]: ...
    def begin(self, command: Array, *, touching: bool) -> None: ...
    def look(self, command: Array) -> None: ...
    def leads_away(self, position: Array, heading: Array) -> bool: ...
    def leads_deeper(self, position: Array, heading: Array) -> bool: ...
