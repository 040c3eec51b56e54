"""A policy that an openpi server computes moves the arm. Start `make run` in another terminal, then:

    .venv/bin/python examples/openpi_policy.py HOST:PORT [SECONDS]

From another computer, with COBOT_ROBOT=http://HOST:8007. It needs `pip install 'cobot[learning]'`.
"""

from __future__ import annotations

import os
import sys

from cobot import Mode, Robot
from learning.openpi import PolicyConnection
from learning.policy import PolicyRunner, state_observer

PERIOD_S = 1 / 30  # of the actions of a chunk: as the policy was trained

with PolicyConnection(sys.argv[1]) as policy, Robot(os.environ.get("COBOT_ROBOT", "iiwa")) as robot:
    robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    with robot.start_joint_impedance_control(30, interpolation="quintic") as control:
        runner = PolicyRunner(robot, control, policy, PERIOD_S, observe=state_observer("swing"), every_s=0.2)
        runner.run(float(sys.argv[2]) if len(sys.argv) > 2 else 10.0)
        print(f"{len(runner.sent)} chunks, the last one after {runner.latency.last_s:.3f} s")
