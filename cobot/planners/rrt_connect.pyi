from cobot.robot.clearance import Clearance
from cobot.types import Array

def connect(
    clearance: Clearance,
    start: Array,
    goals: Array,
    low: Array,
    high: Array,
    seed: int,
    timeout_s: float,
    range_rad: float,
    shorter_than_rad: float = ...,
    attempts: int = ...,
) -> Array | None: ...
