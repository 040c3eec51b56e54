import numpy as np

from cobot.robot.model import RobotModel
from cobot.types import CartesianLimits, JointLimits
from rtloop.sources.cartesian import CartesianSource
from rtloop.sources.servo_base import ServoSource

class ForceServo(CartesianSource):
    def __init__(
        self,
        points: ServoSource,
        model: RobotModel,
        limits: JointLimits,
        within: CartesianLimits,
        period_s: float,
        request: np.ndarray,
    ) -> None: ...
