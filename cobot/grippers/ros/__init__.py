"""Grippers behind an existing ROS 2 driver, through its action and its joint states.

driver  the gripper
link    the process that speaks DDS, and the data that it has received
rig     a simulated driver, for the contract
"""

from __future__ import annotations

from cobot.grippers.ros.driver import RosGripper, RosOptions

__all__ = ["RosGripper", "RosOptions"]
