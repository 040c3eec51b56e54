"""The configurations on LeRobot's command line: `--robot.type=cobot --robot.url=...` for one arm,
`--robot.type=bi_cobot --robot.left_arm_config.url=...` for two.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig


@dataclass(kw_only=True)
class CobotArmConfig:
    """
    Attributes:
        url: URL of the service, or of one of its robots: http://HOST:8007/robots/NAME.
        token: access token, if the service requires one. Default: the environment variable COBOT_TOKEN.
        joints: the robot's joint names, in their order.
        gripper: whether to observe and move the gripper, too. If true, the robot must have a gripper.
        rate_hz: rate of LeRobot's loop, 1 to 1000 Hz.
        interpolation: interpolation between two actions: quintic, ruckig or linear.
        cameras: LeRobot's camera configurations, by name.
    """

    url: str = "http://localhost:8007"
    token: str | None = None
    joints: list[str] = field(default_factory=lambda: [f"joint{number}" for number in range(1, 8)])
    gripper: bool = False
    rate_hz: float = 30.0
    interpolation: str = "quintic"
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@RobotConfig.register_subclass("cobot")
@dataclass(kw_only=True)
class CobotRobotConfig(CobotArmConfig, RobotConfig):
    """One arm. The attributes are those of `CobotArmConfig`."""


@RobotConfig.register_subclass("bi_cobot")
@dataclass(kw_only=True)
class BiCobotRobotConfig(RobotConfig):
    """Two arms as one robot.

    Attributes:
        left_arm_config: the arm whose observations and actions begin with `left_`.
        right_arm_config: the arm whose observations and actions begin with `right_`.
        cameras: LeRobot's configurations of cameras that belong to neither arm, by name. Their names have no
            prefix.
    """

    left_arm_config: CobotArmConfig
    right_arm_config: CobotArmConfig
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
