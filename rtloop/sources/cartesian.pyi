import numpy as np

from cobot.ipc.layout import Interpolation, Intervention
from cobot.robot.model import RobotModel
from cobot.types import Array, CartesianLimits, JointLimits
from rtloop.sources.source import Source

FORCE_RATE_RAD_S: float

class CartesianSource(Source):
    def __init__(
        self,
        kind: Interpolation,
        model: RobotModel,
        limits: JointLimits,
        within: CartesianLimits,
        period_s: float,
        command_s: float,
        request: np.ndarray,
    ) -> None: ...
    @property
    def move_running(self) -> bool: ...
    def press(self, wrench: Array) -> None: ...
    def start_move(self, pose: Array, duration_s: float) -> Intervention | None: ...
    def cancel_move(self) -> None: ...
