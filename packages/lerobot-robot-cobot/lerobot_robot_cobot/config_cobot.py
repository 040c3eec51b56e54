"""What LeRobot's command line says of the arm: `--robot.type=cobot --robot.url=...`."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("cobot")
@dataclass(kw_only=True)
class CobotRobotConfig(RobotConfig):
    """
    Attributes:
        url: of the service, or of one of its robots: http://HOST:8007/robots/NAME.
        token: if it asks for one; without it COBOT_TOKEN counts.
        joints: the names of its joints, in their order.
        gripper: its gripper is observed and moved, too; a robot without one cannot be connected then.
        rate_hz: of LeRobot's loop, 1 to 1000.
        interpolation: between two actions: quintic, ruckig or linear.
        cameras: of LeRobot's own kinds, by name.
    """

    url: str = "http://localhost:8007"
    token: str | None = None
    joints: list[str] = field(default_factory=lambda: [f"joint{number}" for number in range(1, 8)])
    gripper: bool = False
    rate_hz: float = 30.0
    interpolation: str = "quintic"
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
