from cobot.ipc.layout import ServoMode
from cobot.types import Array, JointLimits
from rtloop.sources.servo_base import ServoSource

class Newest(ServoSource):
    def __init__(
        self, limits: JointLimits, safe_velocity: Array, period_s: float, *, planned: bool
    ) -> None: ...

class Buffered(ServoSource):
    def __init__(
        self, limits: JointLimits, safe_velocity: Array, period_s: float, fixed_s: float
    ) -> None: ...

def make_servo(
    mode: ServoMode, limits: JointLimits, safe_velocity: Array, period_s: float
) -> ServoSource | None: ...
