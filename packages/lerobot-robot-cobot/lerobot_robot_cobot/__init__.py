"""Arms served by cobot as LeRobot robots: `--robot.type=cobot` for one arm, `bi_cobot` for two."""

from lerobot_robot_cobot.bimanual import BiCobotRobot
from lerobot_robot_cobot.config_cobot import BiCobotRobotConfig, CobotArmConfig, CobotRobotConfig
from lerobot_robot_cobot.robot import CobotRobot

__all__ = ["BiCobotRobot", "BiCobotRobotConfig", "CobotArmConfig", "CobotRobot", "CobotRobotConfig"]
