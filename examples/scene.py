"""Set a tool, add obstacles, and plan a motion around them.

Start `make run` in another terminal, then:

.venv/bin/python examples/scene.py
"""

from __future__ import annotations

import os

import numpy as np

from cobot.client import Client

with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:
    robot.move_named("home", speed=0.5)
    print(robot.set_tool(name="gripper", mass=1.2, centre=[0.0, 0.0, 0.06], tcp={"z": 0.15}))
    post = {"shape": "cylinder", "radius": 0.05, "length": 1.0, "x": 0.35, "y": 0.2, "z": 0.5}
    # 50,000 points, in m, like those of a depth camera
    seen = np.random.default_rng(1).uniform([-0.1, 0.6, 0.0], [0.1, 0.8, 0.15], (50_000, 3))
    cloud = {"shape": "point_cloud", "points": seen, "voxel": 0.01, "x": 0.0, "y": 0.0, "z": 0.0}
    print(robot.change_scene(objects={"post": post, "seen": cloud}))
    home = robot.joint_states()["position"]
    print(robot.move_joints([1.0, *home[1:]], speed=0.5, planner="auto")["note"])
    robot.change_scene(objects={"post": None, "seen": None})
    robot.set_tool(clear=True)
