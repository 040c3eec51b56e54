"""Arms behind ros2_control: a joint trajectory controller and joint states, over ROS 2, without ROS here.

options   the options
link      the process that speaks DDS, and what it has seen
words     reasons why the arm cannot be moved, in words
path      the way from a motion to a goal, and from feedback to progress
backend   the device that takes whole motions
rig       a controller in the same process, for the contract
"""

from __future__ import annotations

from rtloop.backends.ros2_control.backend import Ros2ControlArm

__all__ = ["Ros2ControlArm"]
