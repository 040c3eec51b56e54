"""The least client of a Franka, which holds it where it is.

python -m benchmarks.backends.bare_franka ADDRESS
"""

from __future__ import annotations

import sys

import pylibfranka

from cobot.config import load_settings
from rtloop.realtime import freeze_garbage, prepare


def main() -> None:
    """Hold the arm, as punctually as rtloop, until the process is ended."""
    robot = pylibfranka.Robot(sys.argv[1], pylibfranka.RealtimeConfig.kIgnore)
    held = pylibfranka.JointPositions(list(robot.read_once().q_d))
    rt = load_settings(None).rt
    prepare(rt.priority, rt.cpu, rt.cpu_latency_us)
    freeze_garbage()
    control = robot.start_joint_position_control(pylibfranka.ControllerMode.JointImpedance)
    while True:
        control.readOnce()
        control.writeOnce(held)


if __name__ == "__main__":
    main()
