"""Tasks for the planning processes: functions that are pickled by their names.

The planners and rtloop's cycle are imported only when these functions are called. So the service, which only
names the functions, does not load scipy.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from cobot.config import Settings
from cobot.errors import CobotError, InputError, LimitError, PlanningError
from cobot.findings import Explanation
from cobot.motions.change_over import ChangeOver
from cobot.motions.forecast import Forecast
from cobot.motions.improving import Improving
from cobot.motions.points import WaypointRequest
from cobot.motions.rehearsal import Rehearsal
from cobot.motions.requests import Blended, Envelope, MotionRequest, RatedMove
from cobot.motions.stretches import Leg, Stretch
from cobot.recording.path import RecordedPath
from cobot.robot.description import RobotDescription
from cobot.robot.limits import check_positions
from cobot.robot.scene import Scene
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.trajectory_parts import cut
from cobot.types import Array

PlanRequest = MotionRequest | WaypointRequest | RatedMove
LegRequest = RatedMove | MotionRequest
Result = TypeVar("Result")


def plan_motion(robot: RobotDescription, request: PlanRequest) -> Trajectory | None:
    """See `cobot.planners.plan`, `plan_waypoints` and `plan_rated`."""
    from cobot.planners import plan, plan_waypoints

    if isinstance(request, MotionRequest):
        return plan(robot, request)
    if isinstance(request, WaypointRequest):
        return plan_waypoints(robot, request)
    leg = plan_rated(robot, request)
    return None if leg is None else leg.motion


def improve_motion(
    robot: RobotDescription, request: MotionRequest, found: Trajectory | Improving, slice_s: float
) -> Improving:
    """See `cobot.planners.search.improve`. In the first call, `found` is the first planned motion."""
    from cobot.planners.search.improve import begin, improve

    state = begin(robot, request, found) if isinstance(found, Trajectory) else found
    return improve(robot, request, state, slice_s)


def surround(robot: RobotDescription, scene: Scene, tool: Tool) -> None:
    """Load a scene and a tool, and compute in advance what plans and forecasts in this scene need."""
    if robot.model.carried.version != tool.version + scene.loads:
        robot.model.carry(tool, scene)
    checker = robot.collision
    if (checker.scene.version, checker.tool.version) != (scene.version, tool.version):
        checker.surround(scene, tool)
    checker.clearance.enclose()
    _ = checker.nearest  # the first access computes it


def plan_rated(robot: RobotDescription, move: RatedMove) -> Leg | None:
    """See `cobot.planners.rated.plan_rated`."""
    from cobot.planners.rated import plan_rated

    return plan_rated(robot, move)


def leg(robot: RobotDescription, request: LegRequest, envelope: Envelope) -> Leg | None:
    """Plan a queued motion: a `RatedMove` with `plan_rated`, any other motion with `cobot.planners.plan`
    within the limits of `envelope`.
    """
    if isinstance(request, RatedMove):
        return plan_rated(robot, request)
    from cobot.planners import plan
    from cobot.planners.blending.joined import leg_of
    from cobot.planners.rated import with_envelope

    slower = with_envelope(robot, envelope)
    motion = plan(slower, request)
    return None if motion is None else leg_of(slower, request, motion)


def begin_stretch(
    robot: RobotDescription, legs: Sequence[Leg], radii_m: Sequence[float], envelope: Envelope
) -> Stretch:
    """See `cobot.planners.blending.prolonged.begin_stretch`."""
    from cobot.planners.blending.prolonged import begin_stretch
    from cobot.planners.rated import with_envelope

    return begin_stretch(with_envelope(robot, envelope), legs, radii_m)


def extend_stretch(
    robot: RobotDescription,
    under_way: Stretch,
    legs: Sequence[Leg],
    radii_m: Sequence[float],
    times_s: tuple[float, float],
    envelope: Envelope,
) -> Stretch:
    """See `cobot.planners.blending.prolonged.extend_stretch`.

    Args:
        times_s: the current path time, and the path time before which nothing may change.
    """
    from cobot.planners.blending.prolonged import extend_stretch
    from cobot.planners.rated import with_envelope

    return extend_stretch(with_envelope(robot, envelope), under_way, legs, radii_m, *times_s)


def change_goal(
    robot: RobotDescription, request: MotionRequest, under_way: Trajectory, now_s: float, from_s: float
) -> ChangeOver:
    """See `cobot.planners.retarget.retarget`."""
    from cobot.planners.retarget import retarget

    return retarget(robot, request, under_way, now_s, from_s)


def lead_around(
    robot: RobotDescription,
    request: MotionRequest,
    under_way: Trajectory,
    now_s: float,
    from_s: float,
    free_s: float,
) -> ChangeOver | None:
    """Change a motion so that it avoids an obstacle in its path. The change is made in the same way as in
    `change_goal`.

    Args:
        free_s: path time from `now_s` within which the motion must not touch anything, s.

    Returns:
        None if the motion touches nothing, or touches something within `free_s`.
    """
    contact = robot.collision.first_contact(cut(under_way, now_s, under_way.duration_s))
    if contact is None or contact.free_s < free_s:
        return None
    return change_goal(robot, request, under_way, now_s, from_s)


def join_motions(
    robot: RobotDescription,
    requests: Sequence[MotionRequest],
    motions: Sequence[Trajectory],
    radii_m: Sequence[float],
) -> Blended:
    """See `cobot.planners.blending.joined.joined`. `motions` were planned for these requests."""
    from cobot.planners.blending.joined import joined, leg_of

    pairs = zip(requests, motions, strict=True)
    return joined(robot, [leg_of(robot, *pair) for pair in pairs], radii_m)


def describe(robot: RobotDescription, trajectory: Trajectory | None, start: Array, samples: int) -> Forecast:
    """See `cobot.planners.forecast.describe`."""
    from cobot.planners.forecast import describe

    return describe(robot, trajectory, start, samples)


def forecast(robot: RobotDescription, request: MotionRequest, samples: int) -> Forecast:
    """See `cobot.planners.forecast.forecast`."""
    from cobot.planners.forecast import forecast

    return forecast(robot, request, samples)


def dry_run(robot: RobotDescription, settings: Settings, start: Array, trajectory: Trajectory) -> Rehearsal:
    """See `rtloop.rehearsal.rehearse` and `cobot.planners.forecast.evaluate_run`."""
    from cobot.planners.forecast import evaluate_run
    from rtloop.rehearsal import rehearse

    return evaluate_run(robot, rehearse(settings, robot, start, trajectory))


def draw_picture(robot: RobotDescription, joints: Array, poses: Array) -> bytes:
    """See `cobot.planners.picture.picture`."""
    from cobot.planners.picture import picture

    return picture(robot, joints, poses)


def read_recorded_path(robot: RobotDescription, path: Path, samples: int) -> RecordedPath:
    """Read the path in a recording with `cobot.recording.reader.read_path`, and add the TCP poses.

    Raises:
        InputError: the recording is from an arm with a different number of joints.
    """
    from cobot.recording.reader import read_path

    found = read_path(path, samples)
    dof = found.joints.shape[1]
    if dof != robot.limits.dof:
        raise InputError(
            f"{path.name}: the recorded arm has {dof} joints, but this arm has {robot.limits.dof}"
        )
    return replace(found, poses=robot.model.poses(found.joints))


def explain(
    robot: RobotDescription, request: MotionRequest, error: CobotError, budget_s: float
) -> Explanation:
    """See `cobot.planners.explain.explain`."""
    from cobot.planners.explain import explain

    return explain(robot, request, error, budget_s)


def work_or_explain(
    robot: RobotDescription,
    work: Callable[[RobotDescription], Result],
    request: MotionRequest,
    explain_s: float,
    spare_s: float,
) -> Result:
    """Return the result of `work` for the request. If the work fails, an explanation is added to its error.
    The search for the explanation takes at most `explain_s`, and ends at the latest `spare_s` after the work
    began.
    """
    begun_s = time.monotonic()
    try:
        return work(robot)
    except (PlanningError, LimitError) as exc:
        budget_s = min(explain_s, spare_s - (time.monotonic() - begun_s))
        if exc.findings and budget_s > 0.0:
            exc.explanation = explain(robot, request, exc, budget_s)
        raise


def from_start(robot: RobotDescription, work: Callable[[RobotDescription], Result], start: Array) -> Result:
    """Return the result of `work` for a request that begins at joint positions given by the client.

    Raises:
        LimitError: the start is beyond a limit.
    """
    check_positions(robot.limits, start, "start: the angle", 0.0)
    return work(robot)
