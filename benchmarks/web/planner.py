"""A planner that never ends, to see how a worker of the service affects the computer."""

from __future__ import annotations

import itertools

import numpy as np

from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.launch.process import Niceness, set_niceness
from cobot.planners import MotionRequest, plan
from cobot.robot.description import load_robot
from cobot.types import PlannerName, Scaling

if __name__ == "__main__":
    set_niceness(Niceness.BACKGROUND)
    robot = load_robot(load_settings(None))
    home, work = (np.array(robot.positions[name].joints) for name in ("home", "work"))
    for seed in itertools.count():
        try:
            plan(robot, MotionRequest(home, work, PlannerName.OMPL, Scaling(0.5), seed=seed))
        except CobotError:
            continue
