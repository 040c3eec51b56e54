from cobot.ipc.layout import Interpolation, Intervention
from cobot.ipc.seqlock import Block
from cobot.types import Array, JointLimits
from rtloop.sources.source import Source

class JointSource(Source):
    def __init__(
        self,
        kind: Interpolation,
        limits: JointLimits,
        safe_velocity: Array,
        period_s: float,
        command_s: float,
    ) -> None: ...
    @property
    def late(self) -> int: ...
    @property
    def starved(self) -> int: ...
    def take_chunk(self, chunk: Block, robot_time_s: float) -> Intervention | None: ...
