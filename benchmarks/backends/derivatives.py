"""Derivatives of the commands that devices receive in planned motions, as fractions of the limits in
joint_limits.yaml.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import BPoly

from benchmarks.table import Row, row
from cobot.config import Settings, load_settings
from cobot.errors import CobotError
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits, PlannerName, Scaling
from rtloop.backends.trajectory_driver import POINT_PERIOD_S, Motion
from rtloop.contract.suite import cell_for

MOVES = 4
STEP_S = 2e-4
NANOSECOND_S = 1e-9
COLUMNS = ("velocity", "acceleration", "jerk")


def commands_row(name: str, settings: Settings, kind: str) -> Row:
    """The row for the commands in each cycle of the contract's motion, at half the joints' limits."""
    cell = cell_for(settings, kind)
    with cell.drive() as driver:
        for _ in range(MOVES):
            driver.move()
        sent = np.array(driver.wire)
    rates = [np.diff(sent, order, axis=0) / cell.settings.rt.period_s**order for order in (1, 2, 3)]
    return _row(f"{name} in planned motions", [_shares(rates, cell.robot.limits)])


def goals_row(motions: int) -> Row:
    """The row for whole motions at full speed, in the form in which a joint trajectory controller
    interpolates their points: quintics through positions, velocities and accelerations, at times in
    nanoseconds.
    """
    robot = load_robot(load_settings(None))
    shares = []
    for path in _paths(robot, motions):
        times_s, rows = Motion(1, path.breakpoints_s, path.coefficients, 1.0).points(POINT_PERIOD_S)
        sent_s = np.round(times_s / NANOSECOND_S) * NANOSECOND_S
        quintics = BPoly.from_derivatives(sent_s, rows.transpose(1, 0, 2))
        every_s = np.arange(0.0, sent_s[-1], STEP_S)
        shares.append(_shares([quintics(every_s, order) for order in (1, 2, 3)], robot.limits))
    return _row(f"ros2_control: quintics between the points of {2 * motions} goals at full speed", shares)


def _paths(robot: RobotDescription, count: int) -> Iterator[Trajectory]:
    """`count` ptp motions, and the same number of lin motions."""
    random, limits = np.random.default_rng(7), robot.limits
    home = np.array(robot.positions["home"].joints)
    for planner in (PlannerName.PTP, PlannerName.LIN):
        found = 0
        while found < count:
            start, goal = (random.uniform(limits.min_position, limits.max_position) for _ in range(2))
            wish: object = goal
            if planner == PlannerName.LIN:
                start = home + random.uniform(-0.4, 0.4, limits.dof)
                wish = robot.model.forward(home + random.uniform(-0.4, 0.4, limits.dof))
            try:
                path = plan(robot, MotionRequest(start, wish, planner, Scaling(1.0)))
            except CobotError:
                continue
            if path is not None:
                found += 1
                yield path


def _shares(rates: Sequence[Array], limits: JointLimits) -> list[float]:
    bounds = (limits.max_velocity, limits.max_acceleration, limits.max_jerk)
    return [float((np.abs(rate) / most).max()) for rate, most in zip(rates, bounds, strict=True)]


def _row(name: str, shares: Sequence[list[float]]) -> Row:
    return row(
        f"{name}, largest share of the joints' limits",
        "",
        np.max(shares, axis=0).tolist(),
        "the limits",
        (1.0, 1.0, 1.0),
        columns=COLUMNS,
        aim="1 at most",
    )
