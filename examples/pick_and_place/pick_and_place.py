"""Picks the cube, carries it through the light barrier, and places it in the tray by touch.

Start `cobot run --cell examples/pick_and_place` in another terminal, then:

.venv/bin/python examples/pick_and_place/pick_and_place.py
"""

from __future__ import annotations

import math
import os
from typing import Any

from cobot.client import Client

DOWN = math.pi
"""Angle b of poses in which the tool points down."""
TOUCH: dict[str, Any] = {"force": {"direction": {"x": 0.0, "y": 0.0, "z": 1.0}, "threshold": 10.0}}

with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:

    def line(x: float, y: float, z: float, speed_m_s: float) -> None:
        robot.move_pose(x=x, y=y, z=z, b=DOWN, planner="lin", speed_m_s=speed_m_s)

    robot.move_named("home", speed=0.5)
    robot.gripper.release()
    robot.move_pose(x=0.5, y=-0.3, z=0.36, b=DOWN, speed=0.5)  # above the cube
    line(0.5, -0.3, 0.225, 0.1)
    robot.gripper.grasp(width=0.05, force=40.0)
    line(0.5, -0.3, 0.36, 0.1)
    line(0.5, 0.12, 0.36, 0.3)  # the cube interrupts the light barrier; the fingers are above the beam
    robot.wait_for({"input": "gate", "is": True}, timeout_s=2.0)
    line(0.55, 0.3, 0.36, 0.3)  # above the tray
    placed = robot.move_pose(x=0.55, y=0.3, z=0.22, b=DOWN, planner="lin", speed_m_s=0.03, until=TOUCH)
    robot.gripper.release()
    line(0.55, 0.3, 0.5, 0.1)
    robot.move_named("home", speed=0.5)
    count = next(each["value"] for each in robot.io() if each["name"] == "gate.count")
    print(f"placed at z = {placed['contact']['position'][2]:.3f} m; the light barrier has counted {count}")
