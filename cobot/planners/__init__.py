"""Planners: pure functions from a robot and a request to a `Trajectory`.

Planners do not fall back to each other: a planner that cannot fulfil a request raises an error. Only auto
tries several planners; the trajectory's note names the chosen one and the reason.

OMPL and scipy are imported only when used, because importing them takes half of the start time of a planning
process, and ptp, the most frequent planner, needs neither.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Any, cast

import numpy as np

from cobot.errors import InputError, LimitError, PlanningError
from cobot.motions.planners import PLANNERS, PlannerName, Way
from cobot.motions.points import WaypointRequest
from cobot.motions.requests import MotionRequest
from cobot.planners.escape import leave_invalid_start
from cobot.planners.goals import is_there, joint_goals, nearest_goal
from cobot.planners.held import Held
from cobot.planners.ptp import plan_ptp
from cobot.planners.timing.waypoints import plan_waypoints
from cobot.planners.unit_advice import advice_on_units
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_motion
from cobot.robot.limits import check_positions
from cobot.trajectory import Notice, Trajectory
from cobot.types import Array

__all__ = ["MotionRequest", "WaypointRequest", "plan", "plan_waypoints"]


@cache
def function_of(planner: PlannerName) -> Callable[..., Any]:
    """The function of this planner, found by the name in its traits."""
    module, name = PLANNERS[planner].function.split(":")
    return cast(Callable[..., Any], getattr(import_module(f"cobot.planners.{module}"), name))


for _name, _traits in PLANNERS.items():
    if _traits.way is not Way.SEARCH:  # planners that search import OMPL or scipy, when they are used
        function_of(_name)


def _held(robot: RobotDescription, request: MotionRequest) -> Held | None:
    return None if request.constraints is None else Held(robot, request.constraints, request.start)


def plan(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """Plan a validated motion from rest to rest; None if the arm is already at the goal.

    ompl, chomp and auto first leave a start that is beyond a limit or in collision, see
    `leave_invalid_start`.

    Raises:
        InputError: a goal is beyond the limits, or this planner does not use a given field.
        PlanningError: no motion exists, or this planner does not find one.
    """
    request.check_for(robot)
    if request.end_joints is not None:
        check_positions(robot.limits, request.end_joints, "end_joints: the angle", 1.0)
    try:
        if request.traits.way is not Way.SEARCH:
            robot.collision.check_position(request.start, "the start", 0.0)
            return _direct(robot, request)
        first = leave_invalid_start(robot, request)
        if first is None:
            return _search(robot, request)
        rest = _search(robot, replace(_after(robot, request, first), start=first.end))
        return first if rest is None else first.followed_by(rest)
    except (InputError, PlanningError) as exc:
        if advice := advice_on_units(robot.model, request):
            raise exc.with_message(f"{exc}; {advice}") from exc
        raise


def _after(robot: RobotDescription, request: MotionRequest, first: Trajectory) -> MotionRequest:
    """Return the request for the motion that follows the escape.

    The escape must keep the same constraints, which stay relative to the original start.
    """
    held, constraints = _held(robot, request), request.constraints
    if held is None or constraints is None:
        return request
    held.require(request.start, "the start")
    try:
        held.check(first, request.planner)
    except PlanningError as exc:
        raise PlanningError(f"{exc}; the escape from the start: {first.note}") from exc
    cone = constraints.cone
    if cone is None or cone.direction is not None:
        return request
    axis = robot.model.chain.solve(request.start)[1] @ cone.axis
    return replace(request, constraints=replace(constraints, cone=replace(cone, direction=axis)))


def _direct(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """Plan along the path of the request, or straight to its goal."""
    if request.traits.way is Way.PATH:
        trajectory = function_of(request.planner)(robot, request)
        return None if trajectory is None else validated(robot, request, trajectory)
    goal = nearest_goal(robot, request)
    if is_there(request.start, goal):
        return None
    return validated(robot, request, function_of(request.planner)(robot, request, goal))


def _search(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """Search around obstacles, from a start that is free of collisions and within the limits."""
    goals = joint_goals(robot, request)
    held = _held(robot, request)
    if held is not None:
        held.require(request.start, "the start", 0.0)
        kept = [joints for joints in goals if held.keeps(joints)]
        if not kept:
            held.require(goals[0], "the goal, in the nearest configuration,", 1.0)
        goals = np.array(kept or goals)
    if is_there(request.start, goals[0]):
        return None
    if request.planner is PlannerName.AUTO:
        return _choose(robot, request, goals)
    return validated(robot, request, function_of(request.planner)(robot, request, goals))


def _choose(robot: RobotDescription, request: MotionRequest, goals: Array) -> Trajectory:
    """The ptp motion, or an ompl motion if ptp fails."""
    try:
        trajectory = validated(robot, request, plan_ptp(robot, request, goals[0]))
        taken = Notice("auto", {"planner": PlannerName.PTP.value})
        return replace(trajectory, note="auto used ptp: the direct joint motion is free", notices=(taken,))
    except PlanningError as exc:
        straight = exc
    try:
        trajectory = validated(robot, request, function_of(PlannerName.OMPL)(robot, request, goals))
    except PlanningError as exc:
        message = f"auto found no motion: ptp: {straight}; {exc}"
        raise type(exc)(message, findings=straight.findings + exc.findings) from exc
    taken = Notice("auto", {"planner": PlannerName.OMPL.value})
    note = f"auto used ompl ({request.algorithm}): ptp: {straight}"
    return replace(trajectory, note=note, notices=(taken,))


def validated(robot: RobotDescription, request: MotionRequest, trajectory: Trajectory) -> Trajectory:
    """Check that a motion passes the checks for all plans and the checks of its own constraints, and return
    the motion.

    Raises:
        PlanningError: the motion fails a check.
    """
    try:
        check_motion(robot, trajectory, request.scaled_limits(robot))
        if (held := _held(robot, request)) is not None:
            held.check(trajectory, request.planner)
    except LimitError as exc:
        raise PlanningError(f"{request.planner}: {exc}", findings=exc.findings) from exc
    return trajectory
