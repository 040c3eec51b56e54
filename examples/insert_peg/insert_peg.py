"""Picks the peg and inserts it into a hole. The position of the hole is known to within 2 mm and 2 degrees.

Start `cobot run --cell examples/insert_peg` in another terminal, then:

.venv/bin/python examples/insert_peg/insert_peg.py
"""

from __future__ import annotations

import math
import os
from typing import Any

from cobot.client import Client

DOWN = math.pi
"""Angle b of poses in which the tool points down."""

with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:
    robot.move_named("home", speed=0.5)
    robot.set_tool(tcp={"z": 0.155})  # the TCP is at the lower end of the peg, about which the peg turns
    robot.gripper.release()
    robot.move_pose(x=0.5, y=-0.2, z=0.3, b=DOWN, speed=0.5)  # above the peg
    robot.move_pose(x=0.5, y=-0.2, z=0.2, b=DOWN, planner="lin", speed_m_s=0.1)
    robot.gripper.grasp(width=0.014, force=200.0)
    robot.move_pose(x=0.5, y=-0.2, z=0.3, b=DOWN, planner="lin", speed_m_s=0.1)
    # Above the hole at x = 0.55, y = 0.15, with an error of 2 mm and 1 degree.
    robot.move_pose(x=0.552, y=0.149, z=0.28, b=DOWN + 0.017, speed=0.5)
    robot.move_pose(x=0.552, y=0.149, z=0.235, b=DOWN + 0.017, planner="lin", speed_m_s=0.05)
    found: Any = robot.insert(
        12.0, 0.02, radius=0.004, pitch=0.0008, search_speed=0.005, drop=0.001, max_force=60.0
    )
    robot.gripper.release()
    robot.move_pose(x=0.55, y=0.15, z=0.33, b=DOWN, planner="lin", speed_m_s=0.1)
    robot.move_named("home", speed=0.5)
    place = found["pose"]
    print(f"stopped by {found['stopped_by']}: the peg is at x = {place['x']:.4f} m, y = {place['y']:.4f} m")
