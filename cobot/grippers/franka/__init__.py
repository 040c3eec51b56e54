"""The Franka Hand, through Franka Robotics' library pylibfranka.

A library command blocks until the motion ends and holds the GIL, so commands run in a separate process. To
end a command early, that process and its connection are ended. A standby process then connects and stops the
fingers.

driver   the gripper
link     the processes and their interface for the driver
helper   the program that each process runs
rig      a simulated hand for the contract
"""

from __future__ import annotations

from cobot.grippers.franka.driver import FrankaHand

__all__ = ["FrankaHand"]
