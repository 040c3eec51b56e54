"""Paths of the TCP with a speed in m/s: a rectangle with round corners, a full circle, a helix.

Start `make run` in another terminal, then:

.venv/bin/python examples/paths.py
"""

from __future__ import annotations

import os

from cobot.client import Client

DOWN = {"b": 3.14159265}
HEIGHT = 0.4


def draw(robot: Client) -> None:
    robot.move_named("work", speed=0.5)
    corners = [(0.55, -0.1), (0.55, 0.1), (0.4, 0.1), (0.4, -0.1)]
    poses = [{"x": x, "y": y, "z": HEIGHT, **DOWN} for x, y in corners]
    robot.move_pose(**poses[-1], speed=0.5)
    # All sides without a stop, with a blend radius of 20 mm. The TCP moves at up to 0.15 m/s.
    robot.move_pose(**poses[-1], planner="polyline", through=poses[:-1], radius=0.02, speed_m_s=0.15)
    # A full circle about an axis that points up, 50 mm from the TCP.
    axis = {"x": 0, "y": 0, "z": 1}
    robot.move_arc(centre={"x": 0.45, "y": -0.1, "z": HEIGHT}, axis=axis, angle=6.2831853, speed_m_s=0.15)
    # Two turns of a helix about the same axis. It rises by 60 mm.
    robot.move_arc(
        centre={"x": 0.45, "y": -0.1, "z": HEIGHT}, axis=axis, angle=12.566371, rise=0.06, speed=0.5
    )
    # 50 mm up: back along the z axis of the tool, which points down.
    answer = robot.move_pose(x=0, y=0, z=-0.05, frame_id="tool", planner="lin", speed=0.5)
    print(answer)


if __name__ == "__main__":
    with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as client:
        draw(client)
