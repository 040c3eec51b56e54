"""Motions in which some joints hardly turn. Oracle: the limits, and that the goal is reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot.planners import ptp
from cobot.robot.description import RobotDescription
from cobot.types import JointLimits

FAST = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])
STARTS = [
    [0.5235987755982988, -0.0872664625997164, 6.959486421147976e-13, -3.74881214477429e-12,
     -1.3962634094579882, -2.596020220600136e-12],
    [0.5235987527640693, -0.08726646259971642, -4.100408723677838e-18, -5.585030448404953e-07,
     -1.3962657036376962, 2.4670167177836164e-13],
    [0.5235988046077839, -0.08726646259971639, 1.2461829974987005e-15, 1.3967746064683642e-06,
     -1.396274170420441, -2.083351734242978e-12],
]  # fmt: skip
"""Positions of six joints, rad, from which Ruckig finds no profile to the goal with these limits."""


@pytest.mark.parametrize("begin", STARTS)
def test_a_joint_that_hardly_turns_does_not_prevent_a_motion(
    robot: RobotDescription, begin: list[float]
) -> None:
    rows = {name: getattr(robot.limits, name)[:6] for name in JointLimits.QUANTITIES}
    limits = JointLimits(robot.limits.names[:6], **rows)
    limits = replace(limits, max_velocity=FAST, max_acceleration=4.0 * FAST, max_jerk=32.0 * FAST)
    goal = np.radians([0.0, 10.0, -20.0, 0.0, -60.0, 0.0])
    motion = ptp._in_time(np.array(begin), goal, limits)
    np.testing.assert_allclose(motion.sample([motion.duration_s])[0], goal, atol=1e-9)
    times_s = np.linspace(0.0, motion.duration_s, 500)
    for order, rates in enumerate((FAST, 4.0 * FAST, 32.0 * FAST), start=1):
        assert (np.abs(motion.sample(times_s, order)) <= rates * (1.0 + 1e-9)).all()
