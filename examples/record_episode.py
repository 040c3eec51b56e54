"""Record an episode for learning. A program demonstrates a motion, and a simulated camera takes pictures.

Start `make run` in another terminal, then:

    .venv/bin/python examples/record_episode.py

The duration in seconds is an optional argument. On another computer, set COBOT_ROBOT=http://HOST:8007. To
record an arm that a person or a policy is moving, use `python -m cobot.learning record`.
"""

from __future__ import annotations

import math
import os
import sys
import time
from pathlib import Path

import numpy as np

from cobot import Mode, Robot
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.learning.cameras import FRONT, Renderer
from cobot.learning.episodes import EpisodeWriter, read_episode
from cobot.robot.description import load_robot

RATE_HZ = 30
SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
FILE = Path("episode.mcap")

arm = load_robot(load_settings())  # for another robot: load_settings(Path("FILE.yaml"))
camera = Renderer(arm, [FRONT])

try:
    with Robot(os.environ.get("COBOT_ROBOT", "iiwa")) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with (
            robot.start_joint_impedance_control(RATE_HZ, interpolation="quintic") as control,
            EpisodeWriter(FILE, arm.limits.names, RATE_HZ, task="swing to the left") as episode,
        ):
            home = control.get_state().q
            begun_s = time.monotonic()
            for tick in range(1, round(SECONDS * RATE_HZ) + 1):
                seen = robot.states()
                action = [home[0] + 0.15 * (1.0 - math.cos(tick / RATE_HZ)), *home[1:]]
                pictures = camera.render(np.array(seen.q))
                episode.add(robot.clock_s(), seen.q, seen.dq, action, pictures, seen.gripper)
                control.set_target_joints(action)
                time.sleep(max(0.0, begun_s + tick / RATE_HZ - time.monotonic()))
            episode.finish(success=True)
except CobotError as exc:
    sys.exit(f"record_episode.py: {exc}")

found = read_episode(FILE)  # `cobot-to-lerobot` makes a dataset of such files
print(f"{FILE}: actions {found.action.shape}, pictures {found.pictures['front'].shape}")
