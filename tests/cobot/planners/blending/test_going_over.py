"""The limits of the window in which a motion under way changes into another one.

Oracle: pinocchio's torques on samples of the window, which say what the limit of one drive has to be for the
window to need a given share of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from independent_models import second_robot

from cobot.motions.requests import MotionRequest
from cobot.motions.stretches import Leg
from cobot.planners.blending.going_over import LimitedPath
from cobot.planners.ptp import plan_ptp
from cobot.planners.timing.path import JointCurve
from cobot.robot.description import RobotDescription
from cobot.trajectory_parts import cut
from cobot.types import PlannerName, Scaling, Synchronization

START = np.array([0.0, 0.5, 0.0, -1.3, 0.0, 1.34, 0.0])
GOAL = START + np.array([0.3, 0.8, 0.0, 0.2, 0.0, -0.3, 0.0])
SHOULDER = 1


@pytest.mark.parametrize(("share", "holds"), [(0.985, True), (0.995, False)])
def test_a_window_uses_more_of_an_effort_than_plans_do_but_not_all_of_it(
    robot: RobotDescription, share: float, holds: bool
) -> None:
    request = MotionRequest(START, GOAL, PlannerName.PTP, Scaling(0.5), synchronization=Synchronization.PHASE)
    motion = plan_ptp(robot, request, GOAL)
    begin_s, end_s = 0.1 * motion.duration_s, 0.9 * motion.duration_s
    window = cut(motion, begin_s, end_s)
    times_s = np.linspace(begin_s, end_s, 400)
    law = np.array([motion.sample(times_s, order)[:, SHOULDER] for order in range(4)])
    law[0] -= START[SHOULDER]
    law /= GOAL[SHOULDER] - START[SHOULDER]
    model = second_robot().model
    states = zip(*(motion.sample(times_s, order) for order in range(3)), strict=True)
    torques = np.array([pinocchio.rnea(model, model.createData(), *state) for state in states])
    needed = np.abs(torques[:, SHOULDER]).max()
    max_effort = 10.0 * robot.limits.max_effort
    max_effort[SHOULDER] = needed / share
    leg = Leg(motion, replace(robot.limits, max_effort=max_effort), None)
    course = LimitedPath.of(robot, [leg], [JointCurve.straight(START, GOAL)], [])
    assert course.holds(robot, law, window) is holds
