from collections.abc import Iterable
from typing import ClassVar

from cobot.robot.chain import Chain
from cobot.robot.inverse_kinematics.arm import Arm
from cobot.types import Array, JointLimits

class SrsArm(Arm):
    BRANCHES: ClassVar[int]
    def __init__(
        self,
        chain: Chain,
        limits: JointLimits,
        rest: Array,
        root: Array,
        reach: float,
        slop: float,
        axes: Array,
        shoulder: Array,
        wrist: Array,
        elbow: Array,
    ) -> None: ...
    def joints(self, pose: Array, angle: float, branch: int) -> Array | None: ...
    def of(self, joints: Array) -> tuple[float, int]: ...
    def intervals(self, pose: Array, branch: int) -> Array: ...
    def grid(self, poses: Array, angles: Array, only: Iterable[int] = ...) -> Array: ...
    def leading_on(
        self, poses: Array, angles: Array, start: Array, branch: int, window: int, step_rad: float
    ) -> Array: ...
