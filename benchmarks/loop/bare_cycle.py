"""The floor for the cycle: a bare Python loop at 1 kHz that steps Ruckig and MuJoCo and copies the state.

    python -m benchmarks.loop.bare_cycle SECONDS

Prints the compute time of each cycle in nanoseconds, one line each.
"""

from __future__ import annotations

import sys
import time

import mujoco
import numpy as np
import ruckig

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.clock import RealtimeClock
from rtloop.realtime import freeze_garbage, prepare


def main(duration_s: float) -> None:
    settings = load_settings(None)
    robot = load_robot(settings)
    limits, period_s = robot.limits, settings.rt.period_s
    model = robot.model.mj
    data = mujoco.MjData(model)
    position = data.qpos
    state = np.zeros((3, limits.dof))
    generator = ruckig.Ruckig(limits.dof, period_s)
    problem, output = ruckig.InputParameter(limits.dof), ruckig.OutputParameter(limits.dof)
    problem.max_velocity = limits.max_velocity.tolist()
    problem.max_acceleration = limits.max_acceleration.tolist()
    problem.max_jerk = limits.max_jerk.tolist()
    problem.target_position = [1.0] * limits.dof
    prepare(settings.rt.priority, settings.rt.cpu, settings.rt.cpu_latency_us)
    freeze_garbage()
    clock = RealtimeClock(period_s)
    durations = []
    for _ in range(int(duration_s / period_s)):
        clock.wait(moving=True)
        begun_ns = time.monotonic_ns()
        generator.update(problem, output)
        output.pass_to_input(problem)
        state[0] = output.new_position
        mujoco.mj_step(model, data)
        state[1] = position
        durations.append(time.monotonic_ns() - begun_ns)
    print("\n".join(map(str, durations)))


if __name__ == "__main__":
    main(float(sys.argv[1]))
