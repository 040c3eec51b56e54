"""An arm of cobot as a robot of LeRobot: `--robot.type=cobot`."""

from lerobot_robot_cobot.config_cobot import CobotRobotConfig
from lerobot_robot_cobot.robot import CobotRobot

__all__ = ["CobotRobot", "CobotRobotConfig"]
