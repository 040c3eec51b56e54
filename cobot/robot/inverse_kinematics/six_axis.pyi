from cobot.robot.chain import Chain
from cobot.robot.inverse_kinematics.arm import Arm
from cobot.types import Array, JointLimits

class SixAxisArm(Arm):
    def __init__(
        self,
        chain: Chain,
        limits: JointLimits,
        rest: Array,
        root: Array,
        reach: float,
        slop: float,
        axes: Array,
        points: Array,
        wrist: Array,
        kind: str,
    ) -> None: ...
