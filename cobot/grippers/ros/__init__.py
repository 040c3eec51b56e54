"""Grippers that already have a ROS 2 driver. cobot uses the action and the joint states of that driver.

driver  the gripper
link    the process that speaks DDS, and the data that it has received
rig     a simulated driver, for the contract
"""

from __future__ import annotations

from cobot.grippers.ros.driver import RosGripper, RosOptions

__all__ = ["RosGripper", "RosOptions"]
