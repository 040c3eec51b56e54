"""Arms behind ros2_control: a joint trajectory controller and joint states, over ROS 2, without ROS here.

options   the options
link      the process that speaks DDS, and what it has seen
words     reasons why the arm cannot be moved, in words
path      the way from a motion to a goal, and from feedback to progress
common    what both backends have in common
backend   the device that takes whole motions
rig       its controller in the same process, for the contract
stream    the backend that commands a position in each cycle; with stream_link and stream_rig
"""

from __future__ import annotations

from rtloop.backends.ros2_control.backend import Ros2ControlArm
from rtloop.backends.ros2_control.stream import Ros2ControlStream

__all__ = ["Ros2ControlArm", "Ros2ControlStream"]
