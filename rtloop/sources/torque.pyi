from cobot.robot.model import RobotModel
from cobot.types import JointLimits
from rtloop.sources.source import Source

class TorqueSource(Source):
    def __init__(self, model: RobotModel, limits: JointLimits, period_s: float) -> None: ...
