"""An arm as a robot of LeRobot: read observations, and send actions. Start `make run` in another terminal.
Then run this with the Python in which LeRobot is installed:

    .venv/bin/python examples/lerobot_arm.py

The duration in seconds is an optional argument. If packages are missing, the error message names them.
"""

from __future__ import annotations

import math
import os
import sys
import time

try:
    from lerobot_robot_cobot import CobotRobot, CobotRobotConfig
except ImportError as exc:
    needed = "./packages/cobot-client ./packages/lerobot-robot-cobot"
    sys.exit(f"lerobot_arm.py: {exc}: pip install {needed} (3 GB with PyTorch)")

RATE_HZ = 30
SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0

url = os.environ.get("COBOT_URL", "http://localhost:8007")
arm = CobotRobot(CobotRobotConfig(id="cobot", url=url, rate_hz=RATE_HZ))
try:
    arm.connect()
    home = arm.get_observation()
    begun_s = time.monotonic()
    for tick in range(1, round(SECONDS * RATE_HZ) + 1):
        action = {joint: home[joint] for joint in arm.action_features}
        action["joint1.pos"] += 0.15 * (1.0 - math.cos(tick / RATE_HZ))
        arm.send_action(action)
        time.sleep(max(0.0, begun_s + tick / RATE_HZ - time.monotonic()))
    print(f"joint1 is at {arm.get_observation()['joint1.pos']:.3f} rad")
except ConnectionError as exc:  # LeRobot's DeviceNotConnectedError is one
    sys.exit(f"lerobot_arm.py: {exc}")
finally:
    arm.disconnect()  # the arm stops
