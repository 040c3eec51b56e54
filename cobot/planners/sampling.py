"""ompl: RRTConnect in joint space, for goals that no direct motion reaches."""

from __future__ import annotations

import numpy as np
from ompl import base, geometric, util

from cobot.errors import PlanningError, PlanningTimeout
from cobot.motions.requests import MotionRequest
from cobot.planners.spline import smooth_motion
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

RESOLUTION_RAD = 0.02
"""Along a motion OMPL checks states for collision that are no further apart, rad."""
SIMPLIFICATION_SHARE = 0.2
"""Making the path shorter takes no more than this share of the planning time."""

util.setLogLevel(util.LogLevel.LOG_ERROR)
util.RNG.setSeed(1)  # one per process: a worker's sequence of plans is repeatable, not a single plan


def plan_ompl(robot: RobotDescription, request: MotionRequest, goal: Array) -> Trajectory:
    """A smooth motion around obstacles.

    Raises:
        PlanningTimeout: no path within the request's time.
        CollisionError: the smoothed path touches something.
    """
    corners = _search(robot, request, goal)
    corners[0], corners[-1] = request.start, goal
    return smooth_motion(robot, corners, request.scaled_limits(robot))


def _search(robot: RobotDescription, request: MotionRequest, goal: Array) -> Array:
    """The corners of a free polyline, shape (n, dof)."""
    setup, space = _problem(robot)
    setup.setStartAndGoalStates(_state(space, request.start), _state(space, goal))
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    status = setup.solve(request.timeout_s)
    if not setup.haveExactSolutionPath():
        reason = (
            f"RRTConnect: {status.asString()}" if hasattr(status, "asString") else "RRTConnect found no path"
        )
        raise PlanningTimeout(f"ompl: no free path within {request.timeout_s:.1f} s ({reason})")
    path = setup.getSolutionPath()
    geometric.PathSimplifier(setup.getSpaceInformation()).simplify(
        path, SIMPLIFICATION_SHARE * request.timeout_s
    )
    if path.getStateCount() < 2:
        raise PlanningError("ompl: the path has no length")
    return np.array([[state[joint] for joint in range(robot.limits.dof)] for state in path.getStates()])


def _problem(robot: RobotDescription) -> tuple[geometric.SimpleSetup, base.RealVectorStateSpace]:
    limits = robot.limits
    space = base.RealVectorStateSpace(limits.dof)
    bounds = base.RealVectorBounds(limits.dof)
    for joint in range(limits.dof):
        bounds.setLow(joint, float(limits.min_position[joint]))
        bounds.setHigh(joint, float(limits.max_position[joint]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(RESOLUTION_RAD / information.getMaximumExtent())
    joints = np.empty(limits.dof)

    def free(state: base.State) -> bool:
        for joint in range(limits.dof):
            joints[joint] = state[joint]
        return robot.collision.is_free(joints)

    setup.setStateValidityChecker(free)
    return setup, space


def _state(space: base.RealVectorStateSpace, joints: Array) -> base.State:
    state = space.allocState()
    for joint, value in enumerate(joints):
        state[joint] = float(value)
    return state
