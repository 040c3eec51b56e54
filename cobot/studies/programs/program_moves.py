"""The program of a study: motions from one position to the next. They are planned once and simulated in each
task.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from cobot.errors import CobotError, InputError
from cobot.motions.planners import PlannerName
from cobot.motions.requests import MotionRequest, TcpSpeed
from cobot.robot.description import RobotDescription
from cobot.strict import StrictModel
from cobot.studies.chunks import Columns
from cobot.studies.robot_choice import Finite, joints_at, numbers7
from cobot.trajectory import Trajectory
from cobot.types import Array, Pose, Scaling

MIN_SPEED = 0.01


class StudyMove(StrictModel):
    """One motion. The first entry of a program is its start.

    Attributes:
        to: a named position or joint angles, rad.
        pose: x, y, z (m) and w, x, y, z of the TCP in the base frame, instead of `to`.
        speed_m_s: largest TCP speed on its path.
        accel_scale: share of the largest accelerations; 0 means the same as `speed`.
        label: display name, for errors.
        stop: whether the arm stops at the end of this motion instead of blending into the next one.
        within_m: distance that a study of cycles may move the pose along each axis.
        tolerance_m: maximum distance of the TCP from the part it works on at the end of this motion.
    """

    to: str | list[float] | None = None
    pose: Annotated[list[Finite], Field(min_length=7, max_length=7)] | None = None
    planner: Annotated[str, Field(pattern="^(ptp|lin|ompl|auto)$")] = "ptp"
    speed: Annotated[float, Field(ge=MIN_SPEED, le=1.0)] = 0.5
    speed_m_s: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    accel_scale: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    label: Annotated[str, Field(max_length=300)] = ""
    stop: bool = False
    within_m: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    tolerance_m: Annotated[float, Field(gt=0.0, le=1.0)] | None = None

    @model_validator(mode="after")
    def _require_one_goal(self) -> Self:
        if (self.to is None) == (self.pose is None):
            raise ValueError("must have either to or pose")
        return self


Program = Annotated[list[StudyMove], Field(min_length=2, max_length=1000)]


@dataclass(frozen=True, slots=True)
class PlannedMove:
    """A planned motion of a program.

    Attributes:
        place: location of the motion in the program, for errors.
        trajectory: the planned motion; None if the arm is already at the goal.
        goal: TCP pose at the end.
    """

    place: str
    start: Array
    trajectory: Trajectory | None
    goal: Pose
    tolerance_m: float | None
    request: MotionRequest
    stop: bool


def plan_program(
    robot: RobotDescription, program: Sequence[StudyMove], speed: float, seed: int
) -> list[PlannedMove]:
    """Plan all motions, see `plan_moves`."""
    return list(plan_moves(robot, program, speed, seed))


def plan_moves(
    robot: RobotDescription, program: Sequence[StudyMove], speed: float, seed: int
) -> Iterator[PlannedMove]:
    """Plan one motion after the other. Each starts where the previous one ends.

    Args:
        speed: factor for all speeds.

    Raises:
        CobotError: a motion cannot be planned; the message gives its number.
    """
    from cobot.planners import plan

    first = program[0]
    if first.to is None:
        raise InputError("program[0]: needs the key to: the start is a named position or joint angles")
    joints = joints_at(robot, first.to, "program[0].to")
    robot.collision.check_position(joints, "program[0]")
    for number, move in enumerate(program[1:], start=1):
        place = f"program[{number}]" + (f" ({move.label})" if move.label else "")
        try:
            request = _request(robot, move, joints, place, speed, seed)
            trajectory = plan(robot, request)
        except CobotError as exc:
            text = str(exc)
            raise exc.with_message(text if text.startswith(place) else f"{place}: {text}") from exc
        end = joints if trajectory is None else trajectory.end
        yield PlannedMove(
            place, joints, trajectory, robot.model.forward(end), move.tolerance_m, request, move.stop
        )
        joints = np.array(end)


def nearest_program(columns: Columns, parameters: Iterable[str]) -> str:
    """A sentence that names the task in which most motions can be planned. It is for a study in which no
    program is possible.

    Args:
        columns: contains `planned`, the number of planned motions, and `cause`, the reason why the next
            motion is not planned.
        parameters: names of the parameters.
    """
    planned = np.asarray(columns["planned"], dtype=np.int64)
    nearest = int(np.argmax(planned))
    at = ", ".join(f"{name} {columns[name][nearest].item():.6g}" for name in parameters)
    return f"the nearest has {at}: motions planned: {planned[nearest]}; then {columns['cause'][nearest]}"


def _request(
    robot: RobotDescription, move: StudyMove, start: Array, place: str, speed: float, seed: int
) -> MotionRequest:
    return MotionRequest(
        start,
        _goal(robot, move, place),
        PlannerName(move.planner),
        Scaling(min(1.0, max(MIN_SPEED, move.speed * speed)), move.accel_scale),
        tcp_speed=TcpSpeed(None if move.speed_m_s is None else move.speed_m_s * speed),
        seed=seed % 2**31,
    )


def _goal(robot: RobotDescription, move: StudyMove, place: str) -> Array | Pose:
    if move.pose is not None:
        return Pose.from_numbers(numbers7(move.pose, f"{place}.pose"))
    assert move.to is not None
    return joints_at(robot, move.to, f"{place}.to")
