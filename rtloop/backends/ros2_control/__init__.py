"""Arms controlled by ros2_control, over DDS. Neither ROS nor rclpy needs to be installed on this computer.

options   the options
link      the process that speaks DDS, and the facts that it reports
words     reasons why the arm cannot be moved, as sentences
path      conversion of a motion to a goal, and of feedback to progress
common    what both backends have in common
backend   the device, which accepts whole motions
rig       a simulated controller in the same process, for the contract checks
stream    the backend that commands a position in each cycle; with stream_link and stream_rig
"""

from __future__ import annotations

from rtloop.backends.ros2_control.backend import Ros2ControlArm
from rtloop.backends.ros2_control.stream import Ros2ControlStream

__all__ = ["Ros2ControlArm", "Ros2ControlStream"]
