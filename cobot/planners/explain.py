"""Remedies for a motion that could not be planned. Each remedy has been planned; none is a guess."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from cobot.errors import CobotError, LimitError, PlanningError, UnreachableError
from cobot.findings import Explanation, Failure, Kind, Remedy
from cobot.motions.planners import BODY_FIELDS, PlannerName, Way
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.escape import exits
from cobot.planners.goals import joint_goals
from cobot.planners.path.cartesian import free_share
from cobot.planners.path.continued import obstacle_along, share_along
from cobot.planners.path.ends import reachable
from cobot.planners.path.lin import straight_line
from cobot.planners.path.tcp_path import TcpPath, least_turn
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import (
    MIN_GAP_M,
    freer,
    inverse_all,
    nearest_to,
    reach_gap,
    seems_reachable,
)
from cobot.types import Array, Pose, Scaling

MAX_BRANCHES, MAX_STARTS, MAX_GOALS = 12, 40, 4
SLOWER = (0.5, 0.2, 0.1)
MIN_SPEED, MAX_DURATION_S = 0.01, 600.0
"""The lowest speed that is tried, and the longest duration of a remedy."""
BACK = (0.0, 1e-3, 1e-2, 0.03, 0.1, 0.2)
"""Shares of the distance to the start. A goal at the edge of the workspace is moved towards the start by
these shares, in this order. Reason: at the edge a joint is at its limit, or the elbow is straight.
"""
SHORT_OF, MIN_SHARE = (0.95, 0.8, 0.6, 0.4, 0.2), 0.05
"""If a line fails at a point, shorter lines are tried. They end at these shares of the distance to that
point. The second value is the shortest share of the line that is offered.
"""
SPREAD = 8
ANY_END: dict[str, Any] = {"cyclic": False, "end_joints": None}
DEFAULTS = {each.name: each.default for each in fields(MotionRequest) if each.name in BODY_FIELDS}


@dataclass(frozen=True, slots=True)
class Idea:
    """A change to the request that may make it succeed.

    Attributes:
        first: whether the arm must first go to a different start; the idea is used only if it can go there.
        problem: why the idea will not work, if that is already known.
    """

    change: dict[str, Any]
    says: str
    first: bool = False
    problem: CobotError | None = None


def explain(
    robot: RobotDescription, request: MotionRequest, error: CobotError, budget_s: float
) -> Explanation:
    """Find changes to the request that would make its motion possible. The motion has failed with `error`.

    Args:
        budget_s: no idea is started after this time; the current one is completed.
    """
    begun_s = time.monotonic()
    works: dict[Kind, Remedy] = {}
    tried: dict[Kind, Failure] = {}
    for kind, ideas in _ideas(robot, request, error):
        if kind in works or time.monotonic() - begun_s >= budget_s:
            continue
        for idea in ideas:
            left_s = begun_s + budget_s - time.monotonic()
            if left_s <= 0.0:
                break
            try:
                duration_s = _plan_idea(robot, request, idea, left_s)
            except CobotError as exc:
                first = tried.get(kind) or Failure(kind, 0, idea.says, str(exc))
                tried[kind] = replace(first, count=first.count + 1)
            else:
                works[kind] = Remedy(kind, idea.change, idea.says, duration_s)
                break
    spent_s = time.monotonic() - begun_s
    start = tuple(request.start.tolist())
    return Explanation(tuple(works.values()), tuple(tried.values()), spent_s, budget_s, start)


def _plan_idea(robot: RobotDescription, request: MotionRequest, idea: Idea, left_s: float) -> float:
    """Plan the changed motion within `left_s`, and return its duration, s."""
    if idea.problem is not None:
        raise idea.problem
    request = replace(request, timeout_s=min(request.timeout_s, left_s))
    motion = plan(robot, replace(request, **idea.change))
    duration_s = 0.0 if motion is None else motion.duration_s
    if duration_s > MAX_DURATION_S:
        raise PlanningError(f"the motion would take {duration_s:.4g} s, allowed: up to {MAX_DURATION_S:g} s")
    if idea.first:
        anyhow = {"constraints": None, **_searching(request)}
        plan(robot, replace(request, goal=idea.change["start"], **anyhow))
    return duration_s


def _ideas(
    robot: RobotDescription, request: MotionRequest, error: CobotError
) -> Iterator[tuple[Kind, Iterator[Idea]]]:
    """The kinds of ideas, the most promising kind first, each with an iterator over its ideas. The ideas are
    found one by one, because finding all of them may take a long time.
    """
    checks = {found.check for found in error.findings}
    if isinstance(error, LimitError) and _at_start(error):  # the client gave this start; the arm is not there
        yield "start", (replace(idea, first=False) for idea in _other_starts(robot, request))
        return
    at_goal = bool(error.findings) and error.findings[0].share == 1.0
    if "effort" in checks or any(f.check == "limit" and f.quantity != "position" for f in error.findings):
        yield "slower", _slower(request)
    if "time" in checks:
        yield "faster", _faster(request)
    if "reach" in checks and robot.model.inverse_kinematics.lacking:
        yield "free_axes", _more_free_axes(request)
    if request.cyclic or request.end_joints is not None:
        yield "end", iter([Idea(ANY_END, "ending in other joints")])
    if at_goal:
        yield "goal", _other_goals(robot, request)
    if checks & {"limit", "reach", "redundancy", "singularity", "collision"}:
        yield "branch", _other_branches(robot, request)
    yield "planner", _other_planners(robot, request)
    yield "goal", _shorter(robot, request, error)
    if "reach" in checks and not at_goal:
        yield "goal", _other_goals(robot, request)
    if request.traits.way is Way.PATH or _at_start(error):
        yield "start", _other_starts(robot, request)


def _at_start(error: CobotError) -> bool:
    return any(found.share == 0.0 for found in error.findings)


def _slower(request: MotionRequest) -> Iterator[Idea]:
    for share in SLOWER:
        speed = share * request.scaling.speed
        if speed >= MIN_SPEED:
            yield Idea({"scaling": Scaling(speed)}, f"at a speed of {speed:.3g}")


def _faster(request: MotionRequest) -> Iterator[Idea]:
    """The same request with a larger acceleration scale, because there is no time profile if it is near 0."""
    scaling = request.scaling
    if 0.0 < scaling.accel_scale < scaling.speed:
        yield Idea({"scaling": Scaling(scaling.speed)}, "with accel_scale 0, the same as the speed")


def _more_free_axes(request: MotionRequest) -> Iterator[Idea]:
    """The request with more free rotations. An arm with too few joints for arbitrary orientations can then
    reach more poses.
    """
    for axes in freer(request.free_axes):
        yield Idea({"free_axes": axes}, f"with free_axes [{', '.join(axes)}]")


def _is_the_path(request: MotionRequest) -> bool:
    """Whether the client requested the path itself. A different path to its end is then no alternative."""
    return bool(request.through) or request.is_by_angle


def _other_planners(robot: RobotDescription, request: MotionRequest) -> Iterator[Idea]:
    """A planner that goes around obstacles and can leave an invalid start."""
    if _is_the_path(request):
        return
    planner, gap_m = request.traits.alternative, _gap_m(robot, request)
    along = ", not along the path" if request.traits.way is Way.PATH else ""
    problem = None
    if gap_m > MIN_GAP_M:
        problem = UnreachableError(f"the goal is out of reach by {gap_m:.3g} m")
    elif isinstance(request.goal, Pose) and not seems_reachable(robot.model, request.goal, request.free_axes):
        problem = UnreachableError("none of the joint angles tried reaches the goal")
    yield Idea(_searching(request, planner), f"with planner {planner}{along}", problem=problem)


def _gap_m(robot: RobotDescription, request: MotionRequest) -> float:
    """A lower bound of the distance from the goal to the arm's reach; 0 for joint angles."""
    goal = request.goal
    return reach_gap(robot.model, goal, request.free_axes) if isinstance(goal, Pose) else 0.0


def _searching(request: MotionRequest, planner: PlannerName = PlannerName.AUTO) -> dict[str, Any]:
    """Changes to the request for a different planner. They keep the scaling, and remove the fields that some
    planners do not use.
    """
    return {"planner": planner, "scaling": request.scaling, **DEFAULTS, **ANY_END}


def _other_branches(robot: RobotDescription, request: MotionRequest) -> Iterator[Idea]:
    """For a ptp motion to a pose: the joint angles that ptp did not choose."""
    if request.traits.way is not Way.DIRECT or not isinstance(request.goal, Pose):
        return
    try:
        goals = joint_goals(robot, request)[1:]
    except CobotError:
        return
    for goal in goals[:MAX_BRANCHES]:
        yield Idea({"goal": goal}, f"at the goal the joints {_shown(goal)} {robot.limits.units}")


def _other_starts(robot: RobotDescription, request: MotionRequest) -> Iterator[Idea]:
    """For an invalid start, the nearest valid starts. For a path, different joint angles at the same TCP
    pose, to which the arm can go first.
    """
    limits = robot.limits
    if not request.is_by_angle and _gap_m(robot, request) > MIN_GAP_M:
        return
    inside = np.clip(request.start, limits.min_position, limits.max_position)
    if not robot.collision.is_free(inside):
        starts = exits(robot, inside)[:MAX_GOALS]
    elif np.abs(inside - request.start).max() > 0.0:
        starts = [inside]
    elif request.traits.way is Way.PATH:
        here = robot.model.forward(request.start)
        found = np.array(inverse_all(robot.model, here, request.start, spread=SPREAD))
        starts = list(found[robot.collision.clearance.are_free(found)][:MAX_STARTS])
    else:
        return
    starts = [start for start in starts if np.abs(start - request.start).max() > 1e-3]
    for start, problem in _fitting(robot, request, starts):
        says = f"from the joints {_shown(start)} {limits.units}"
        yield Idea({"start": start}, says, True, problem)
        if request.traits.way is Way.DIRECT:
            yield Idea({"start": start, **_searching(request)}, f"{says}, with planner auto", True)


def _fitting(
    robot: RobotDescription, request: MotionRequest, starts: list[Array]
) -> Iterator[tuple[Array, CobotError | None]]:
    """The starts from which the motion may succeed. For a line, these are the starts from which the joints
    can probably follow it; if there are none, all starts are returned, with the reason why the first one
    fails. For other motions, all starts are returned.
    """
    unfit = []
    for start in starts:
        line = _line(robot, request, start)
        if line is None or share_along(robot, start, line) == 1.0:
            yield start, None
        else:
            unfit.append((start, line))
    if unfit and len(unfit) == len(starts):
        problem = obstacle_along(robot, *unfit[0])
        yield from ((start, problem) for start in starts)


def _line(robot: RobotDescription, request: MotionRequest, start: Array) -> TcpPath | None:
    """The path of a lin motion from `start` that may end in any joints; None for other motions."""
    goal = request.goal
    if request.planner is not PlannerName.LIN or not isinstance(goal, Pose):
        return None
    if request.cyclic or request.end_joints is not None:
        return None
    if robot.model.inverse_kinematics.lacking:
        request = replace(request, start=start)  # the end depends on it
    here = robot.model.forward(start)
    line = straight_line(here, reachable(robot, request, here, goal), least_turn(robot))
    return replace(line, free=request.free_axes)


def _other_goals(robot: RobotDescription, request: MotionRequest) -> Iterator[Idea]:
    """The nearest goals that are within the limits, reachable and free of collisions. Some are only reachable
    with a planner that searches.
    """
    for goal, says in _near_goals(robot, request):
        if request.traits.way is not Way.PATH:
            yield Idea({"goal": goal}, f"to the nearest possible goal, {says}")
        if request.traits.way is not Way.SEARCH:
            change = {"goal": goal, **_searching(request, PlannerName.AUTO)}
            yield Idea(change, f"to the nearest possible goal, {says}, with planner auto")


def _near_goals(robot: RobotDescription, request: MotionRequest) -> Iterator[tuple[Array | Pose, str]]:
    limits, goal = robot.limits, request.goal
    if not isinstance(goal, Pose):
        inside = np.clip(goal, limits.min_position, limits.max_position)
        nearest = [inside] if robot.collision.is_free(inside) else exits(robot, inside)[:MAX_GOALS]
        for joints in nearest:
            yield joints, f"joints {_shown(joints)} {limits.units}"
        return
    if _is_the_path(request):
        return
    for joints in _near_joints(robot, request, goal):
        pose = _as_written(robot.model.forward(joints))
        away = float(np.linalg.norm(pose.position - goal.position))
        turn = 2.0 * float(np.arccos(np.clip(abs(pose.quaternion @ goal.quaternion), -1.0, 1.0)))
        yield pose, f"{1e3 * away:.4g} mm and {turn:.3g} rad away"


def _near_joints(robot: RobotDescription, request: MotionRequest, goal: Pose) -> Iterator[Array]:
    """Collision-free joint angles with the TCP near a pose that is out of reach or in collision."""
    descent = nearest_to(robot.model, goal, request.start, request.seed, request.free_axes)
    nearest = descent.joints
    if request.traits.way is Way.PATH and descent.solved:
        return
    if not robot.collision.is_free(nearest):
        yield from exits(robot, nearest)[:MAX_GOALS]
        return
    for share in BACK:
        yield nearest + share * (request.start - nearest)


def _as_written(pose: Pose) -> Pose:
    """The pose that results if a client sends its orientation as angles."""
    x, y, z = pose.position.tolist()
    return Pose.from_abc(x, y, z, *pose.abc)


def _shorter(robot: RobotDescription, request: MotionRequest, error: CobotError) -> Iterator[Idea]:
    """For a line that fails at a point: the part of the line before this point."""
    shares = [found.share for found in error.findings if found.share]
    if request.planner is not PlannerName.LIN or not shares or not isinstance(request.goal, Pose):
        return
    here, axes, most = robot.model.forward(request.start), request.free_axes, max(shares)
    line = replace(straight_line(here, request.goal), free=axes)

    def up_to(share: float) -> TcpPath:
        return replace(straight_line(here, _as_written(line.pose_at(share))), free=axes)

    parts = [part * most for part in SHORT_OF]
    if share_along(robot, request.start, up_to(parts[0])) < 1.0:
        free = free_share(robot, request.start, line)
        if SHORT_OF[0] * free >= MIN_SHARE:
            parts = [part * min(most, free) for part in SHORT_OF]
            longer = SHORT_OF[0] * min(most, free + 1.0 / line.places)
            if longer > parts[0] and free_share(robot, request.start, up_to(longer)) == 1.0:
                parts.insert(0, longer)
        elif robot.model.kinematics(axes).arm_angle is None:
            return  # few lines lead further, and each trial takes a long time
    for share in parts:
        if share >= MIN_SHARE:
            goal = _as_written(line.pose_at(share))
            yield Idea({"goal": goal, **ANY_END}, f"along the line up to {100.0 * share:.0f} % of it")


def _shown(joints: Array) -> str:
    return "[" + ", ".join(f"{value:.3f}" for value in joints) + "]"
