"""Move the arm with a policy that runs on an openpi server. Start `make run` in another terminal, then:

    .venv/bin/python examples/openpi_policy.py HOST:PORT [SECONDS]

On another computer, set COBOT_ROBOT=http://HOST:8007. This example needs `pip install 'cobot[learning]'`.
"""

from __future__ import annotations

import argparse
import os
import sys

from cobot import Mode, Robot
from cobot.client import ServedFingers
from cobot.errors import CobotError
from cobot.learning.openpi import PolicyConnection
from cobot.learning.policy import PolicyRunner, state_observer

PERIOD_S = 1 / 30  # period of the actions in a chunk, as in the training of the policy

parser = argparse.ArgumentParser()
parser.add_argument("address", metavar="HOST:PORT", help="address of the openpi server")
parser.add_argument("seconds", metavar="SECONDS", type=float, nargs="?", default=10.0)
chosen = parser.parse_args()
name = os.environ.get("COBOT_ROBOT", "iiwa")
try:
    with PolicyConnection(chosen.address) as policy, Robot(name) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(30, interpolation="quintic") as control:
            observe = state_observer("swing")
            fingers = ServedFingers.of(robot.gripper)  # None for a robot without a gripper
            runner = PolicyRunner(
                robot, control, policy, PERIOD_S, observe=observe, every_s=0.2, fingers=fingers
            )
            runner.run(chosen.seconds)
            print(f"{len(runner.sent)} chunks, the last one after {runner.latency.last_s:.3f} s")
except CobotError as exc:
    sys.exit(f"openpi_policy.py: {exc}")
