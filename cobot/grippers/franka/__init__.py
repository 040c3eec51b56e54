"""The Franka Hand, through Franka Robotics' library pylibfranka.

Its commands block until the fingers are there, and hold Python's lock meanwhile. So they run in a process of
their own. A command that is to end early loses that process, and with it the connection; another process,
which waits for that, connects and stops the fingers.

driver   the gripper
link     the processes, as the driver uses them
helper   what each process runs
rig      a simulated hand for the contract
"""

from __future__ import annotations

from cobot.grippers.franka.driver import FrankaHand

__all__ = ["FrankaHand"]
