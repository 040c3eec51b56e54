"""Move the arm with a policy that sends 30 targets per second. Start `make run` in another terminal, then:

    .venv/bin/python examples/policy_30hz.py

The duration in seconds is an optional argument. On another computer, set COBOT_ROBOT=http://HOST:8007.
"""

from __future__ import annotations

import math
import os
import sys
import time

from cobot import Mode, Robot

RATE_HZ = 30
SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0


def policy(home: list[float], time_s: float) -> list[float]:
    """Return the next joint positions, rad. Put your policy here, and pass it `control.get_state()`."""
    swing = 0.15 * (1.0 - math.cos(time_s))
    return [home[0] + swing, *home[1:5], home[5] + swing, home[6]]


with Robot(os.environ.get("COBOT_ROBOT", "iiwa")) as robot:
    robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    with robot.start_joint_impedance_control(RATE_HZ, interpolation="quintic") as control:
        home = control.get_state().q
        begun_s = time.monotonic()
        for tick in range(round(SECONDS * RATE_HZ)):
            control.set_target_joints(policy(home, tick / RATE_HZ))
            time.sleep(max(0.0, begun_s + (tick + 1) / RATE_HZ - time.monotonic()))
        print("the arm is at", control.get_state().q)
print("and rests")  # the arm stops at the end of the `with` block, or if this process ends
