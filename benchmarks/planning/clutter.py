"""Motions through clutter: the number of solved problems, the computing time, and the length of the paths."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TypeVar

import mujoco
import numpy as np
from ompl import base, geometric, util

from benchmarks.planning import scenes
from benchmarks.planning.scenes import Problem
from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.motions.constraints import Cone, Constraints
from cobot.planners import MotionRequest, plan
from cobot.planners.goals import joint_goals
from cobot.planners.rrt_connect import connect
from cobot.planners.search.detours import length, without_detours
from cobot.planners.search.sampling import ATTEMPTS, FIRST_SHARES, RANGE_RAD, find_path, room
from cobot.planners.shortcut import shorten
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array, PlannerName, Pose, Scaling

Result = TypeVar("Result")
COLUMNS = ("p50", "p95", "max")
TIMEOUT_S = 10.0
RUNS, PATHS = 10, 3
PEER_STEP_RAD = 0.02
PEER_S = 2.0
UPRIGHT_RAD = 0.1


@dataclass(slots=True)
class Tries:
    """The results of one planner: the CPU time for each problem, ms, and the number of solved problems."""

    cpu_ms: list[float] = field(default_factory=list)
    solved: int = 0

    def add(self, cpu_ms: float, found: object) -> None:
        self.cpu_ms.append(cpu_ms)
        self.solved += found is not None

    @property
    def solved_percent(self) -> float:
        return 100.0 * self.solved / len(self.cpu_ms)


def clutter(problems: int, references: int, reference_s: float) -> Iterator[Row]:
    """Plan this number of problems of each kind. The paths with the longest detours are also compared with
    the best of ten long searches.
    """
    robot = load_robot(load_settings(None))
    yield _distances(robot)
    whole = {planner: Tries() for planner in (PlannerName.OMPL, PlannerName.CHOMP)}
    to_poses, upright = Tries(), Tries()
    ratios: list[float] = []
    beside_peer: list[float] = []
    for kind in scenes.KINDS:
        tries = {name: Tries() for name in ("path", "peer", *whole)}
        lengths: list[tuple[float, Problem]] = []
        for problem in scenes.problems(robot, kind, problems):
            corners = _path(tries["path"], problem)
            cpu_ms, theirs = _timed(lambda problem=problem: _by_ompl(problem))
            tries["peer"].add(cpu_ms, theirs)
            if corners is not None and theirs is not None:
                beside_peer.append(length(corners) / length(theirs))
            for planner, all_of_it in whole.items():
                request = _request(problem, planner)
                outcome = _timed(lambda there=problem.robot, request=request: plan(there, request))
                tries[planner].add(*outcome)
                all_of_it.add(*outcome)
            request = replace(_request(problem, PlannerName.OMPL), goal=problem.pose)
            to_poses.add(*_timed(lambda there=problem.robot, request=request: plan(there, request)))
            if (request := _upright(problem)) is not None:
                upright.add(*_timed(lambda there=problem.robot, request=request: plan(there, request)))
            if corners is not None:
                lengths.append((length(corners), problem))
        yield _times(
            f"{kind}: a path, shortened, CPU", tries["path"], "OMPL's RRTConnect, Python", tries["peer"]
        )
        yield _times(f"{kind}: ompl, from request to trajectory, CPU", tries["ompl"], "chomp", tries["chomp"])
        lengths.sort(key=lambda each: each[0] / _direct(each[1]), reverse=True)
        ratios += [ours / _best(problem, reference_s) for ours, problem in lengths[:references]]
    ours, chomp = whole[PlannerName.OMPL], whole[PlannerName.CHOMP]
    yield _times("clutter: ompl, from request to trajectory, CPU", ours, "chomp", chomp, "50 ms, p95 500 ms")
    yield _times("clutter: ompl to a pose, in any free configuration, CPU", to_poses, "to joint angles", ours)
    yield _times(
        f"clutter: ompl, the tool upright within {UPRIGHT_RAD:g} rad, CPU", upright, "to joint angles", ours
    )
    yield row(
        f"clutter: the tool upright, solved, of {len(upright.cpu_ms)} with a free goal",
        "%",
        (upright.solved_percent,),
        "to joint angles",
        (ours.solved_percent,),
        columns=("solved",),
    )
    yield row(
        f"clutter: solved, of {len(ours.cpu_ms)}",
        "%",
        (ours.solved_percent,),
        "chomp",
        (chomp.solved_percent,),
        columns=("solved",),
        aim="100 %; chomp 95 %",
    )
    yield _lengths("that of OMPL's RRTConnect", beside_peer, 1.0, "")
    yield _lengths(f"the best of ten runs of {reference_s:g} s", ratios, 1.3, "1.3")


def _upright(problem: Problem) -> MotionRequest | None:
    """A request to the goal's place during which the tool keeps the orientation of the start, with a small
    tolerance.
    """
    robot = problem.robot
    goal = Pose(problem.pose.position, robot.model.forward(problem.start).quaternion)
    cone = Constraints(Cone(np.array([0.0, 0.0, 1.0]), UPRIGHT_RAD))
    request = replace(_request(problem, PlannerName.OMPL), goal=goal, constraints=cone)
    try:
        joint_goals(robot, request)
    except CobotError:
        return None
    return request


def _distances(robot: RobotDescription) -> Row:
    """The time to check random configurations at a shelf, next to MuJoCo's contacts. Both are called from
    Python.
    """
    there = next(scenes.problems(robot, "shelf", 1)).robot
    limits, mj = robot.limits, there.model.mj
    rows = np.random.default_rng(5).uniform(limits.min_position, limits.max_position, (3000, limits.dof))
    data = mujoco.MjData(mj)

    def by_mujoco(joints: Array) -> None:
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        mujoco.mj_collision(mj, data)

    ours = [1e3 * _timed(lambda joints=joints: there.collision.is_free(joints))[0] for joints in rows]
    theirs = [1e3 * _timed(lambda joints=joints: by_mujoco(joints))[0] for joints in rows]
    values, against = (tuple(np.percentile(each, (50.0, 95.0))) for each in (ours, theirs))
    return row(
        "whether a configuration is free, CPU",
        "µs",
        values,
        "MuJoCo's contacts",
        against,
        columns=COLUMNS[:2],
    )


def _times(name: str, ours: Tries, against: str, theirs: Tries, aim: str = "") -> Row:
    values, against_values = (
        tuple(float(value) for value in np.percentile(tries.cpu_ms, (50.0, 95.0, 100.0)))
        for tries in (ours, theirs)
    )
    return row(name, "ms", values, against, against_values, columns=COLUMNS, aim=aim)


def _lengths(by: str, ratios: list[float], against: float, aim: str) -> Row:
    values = tuple(float(value) for value in np.percentile(ratios, (50.0, 95.0, 100.0)))
    name, columns = f"clutter: length of the path by {by}", COLUMNS
    return row(
        name,
        "",
        values,
        "aim" if aim else "as long",
        (against,) * 3,
        columns=columns,
        ratio_of="p95",
        aim=aim,
    )


def _request(problem: Problem, planner: PlannerName) -> MotionRequest:
    return MotionRequest(problem.start, problem.goal, planner, Scaling(1.0), timeout_s=TIMEOUT_S)


def _path(tries: Tries, problem: Problem) -> Array | None:
    request = _request(problem, PlannerName.OMPL)
    cpu_ms, corners = _timed(lambda: find_path(problem.robot, request, problem.goal[None]))
    tries.add(cpu_ms, corners)
    return corners


def _best(problem: Problem, run_s: float) -> float:
    """The length of the shortest path of ten searches, rad. Each search uses all of its time, alternately
    near the direct way and further away from it, and removes the detours from every three paths.
    """
    collision, limits = problem.robot.collision, problem.robot.limits
    bounds = limits.min_position, limits.max_position
    ends = np.array([problem.start, problem.goal])
    direct, rooms = _direct(problem), (*FIRST_SHARES[:3], 1.0)
    shortest: list[float] = []
    with collision.keeping(room(problem.robot, ends)) as clearance:
        for run in range(RUNS):
            end_s, seed, best = time.process_time() + run_s, 1000 * run, np.inf
            paths: list[Array] = []
            while (left_s := end_s - time.process_time()) > 0.0:
                seed += 1
                longest = np.inf if np.isinf(best) else direct + rooms[seed % len(rooms)] * (best - direct)
                attempts = 0 if np.isinf(best) else ATTEMPTS
                found = connect(
                    clearance, ends[0], ends[1:], *bounds, seed, left_s, RANGE_RAD, longest, attempts
                )
                if found is not None:
                    paths.append(shorten(clearance, found, seed))
                    best = min(best, length(paths[-1]))
                if len(paths) == PATHS:
                    best = min(best, length(without_detours(clearance, paths, ends[1:], bounds, seed)))
                    paths = []
            shortest.append(best)
    return min(shortest)


def _by_ompl(problem: Problem) -> Array | None:
    """The path of OMPL's RRTConnect with simplification, which calls Python to check a configuration every
    0.02 rad.
    """
    util.setLogLevel(util.LogLevel.LOG_NONE)
    limits, collision = problem.robot.limits, problem.robot.collision
    space = base.RealVectorStateSpace(limits.dof)
    bounds = base.RealVectorBounds(limits.dof)
    for joint in range(limits.dof):
        bounds.setLow(joint, float(limits.min_position[joint]))
        bounds.setHigh(joint, float(limits.max_position[joint]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(PEER_STEP_RAD / information.getMaximumExtent())
    setup.setStateValidityChecker(collision.clearance.is_free)
    states = []
    for joints in (problem.start, problem.goal):
        state = space.allocState()
        for joint, value in enumerate(joints):
            state[joint] = float(value)
        states.append(state)
    setup.setStartAndGoalStates(*states)
    setup.setPlanner(geometric.RRTConnect(information))
    setup.solve(TIMEOUT_S)
    if not setup.haveExactSolutionPath():
        return None
    setup.simplifySolution(PEER_S)
    return np.array(
        [[state[joint] for joint in range(limits.dof)] for state in setup.getSolutionPath().getStates()]
    )


def _direct(problem: Problem) -> float:
    return float(np.linalg.norm(problem.goal - problem.start))


def _timed(call: Callable[[], Result]) -> tuple[float, Result | None]:
    """CPU time in ms, and the result; None if the call fails."""
    begun_ns = time.process_time_ns()
    try:
        result = call()
    except CobotError:
        result = None
    return (time.process_time_ns() - begun_ns) / 1e6, result
