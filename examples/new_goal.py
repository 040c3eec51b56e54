"""Give a running motion another goal, without a stop.

Start `make run` in another terminal, then:

.venv/bin/python examples/new_goal.py
"""

from __future__ import annotations

import os
import time

from cobot.client import Client

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
TARGETS = (1.0, -0.6, 0.3)
"""Goals of joint 1, rad. Each one replaces the previous goal while the arm is moving."""

with Client(os.environ.get("COBOT_URL", "http://localhost:8007")) as robot:
    robot.move_named("home", speed=0.5)
    job = robot.move_joints([0.6, *HOME[1:]], speed=0.2, wait=False)
    for target in TARGETS:
        time.sleep(0.6)
        answer = job.retarget(joints=[target, *HOME[1:]], speed=0.2)
        print(f"to {target:+.1f} rad: new path in {1e3 * answer['planning_time_s']:.0f} ms")
    job.wait()
    print(f"joint 1 is at {robot.joint_states()['position'][0]:.3f} rad")
