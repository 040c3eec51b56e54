from cobot.types import JointLimits
from rtloop.sources.servo_base import ServoSource

class ThroughPoints(ServoSource):
    def __init__(self, limits: JointLimits, period_s: float) -> None: ...
