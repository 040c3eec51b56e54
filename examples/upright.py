"""Carries a glass of water to the left and back. ompl keeps the tool upright during the whole motion.

Start `make run` in another terminal, then:

.venv/bin/python examples/upright.py
"""

from __future__ import annotations

import os

from cobot.client import Client

UPRIGHT = {"orientation": {"within_rad": 0.1}}


def carry(robot: Client) -> None:
    robot.move_named("work", speed=0.5)
    place = robot.pose()["position"]
    for y in (0.4, 0.0):
        there = {"x": place["x"], "y": y, "z": place["z"], "b": 3.14159265}
        answer = robot.move_pose(**there, speed=0.5, planner="ompl", constraints=UPRIGHT)
        print(f"y {y:.1f} m after {answer['duration_s']:.1f} s, planned in {answer['planning_time_s']:.2f} s")


if __name__ == "__main__":
    with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:
        carry(robot)
