"""Requests for plans as JSON, and the list of kept plans. The answers are in `plan_answers`."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, FailFast, Field

from cobot.loose_lists import RequestModel
from cobot.motions.bodies import (
    MoveArc,
    MoveJoints,
    MoveNamed,
    MovePose,
    MoveSequence,
    PathPose,
    Radius,
    TcpMotion,
)
from cobot.motions.fields import HOME, BudgetS, Finite, example
from cobot.strict import StrictModel

Start = Annotated[
    list[Finite] | None,
    Field(
        min_length=1,
        max_length=64,
        description="Joint angles to plan from, rad. Default: the current ones.",
    ),
]
Samples = Annotated[
    int, Field(ge=2, le=1000, description="Number of path points in the response, evenly spaced in time.")
]

ExplainIt = Annotated[
    bool,
    Field(
        description="true: if planning fails, search for changes that make a plan possible, for at most "
        "`planning.explain_s`; false: only report the reason."
    ),
]
PlanId = Annotated[
    str, Field(min_length=1, max_length=64, description="The plan_id from the response that made the plan.")
]


class KeptPlan(BaseModel):
    """A plan that can be run, as shown to the person who approves it."""

    model_config = example(
        {
            "plan_id": "plan_2f1c9a0b7d3e4855",
            "by": "agent-7",
            "planners": ["lin"],
            "duration_s": 1.1,
            "signals": ["0.55 s: set glue to 1"],
            "expires_in_s": 540.0,
            "approved_by": None,
        }
    )

    plan_id: str = Field(description="Id of the plan, for requests that approve or run it.")
    by: str = Field(description="The client that requested it: the name of its token.")
    planners: list[str] = Field(description="The planners that were requested.")
    duration_s: float = Field(description="Duration at full speed, s.")
    signals: list[str] = Field(
        description="Actions on the path, conditions of the motion and commands to the gripper, as sentences."
    )
    expires_in_s: float = Field(description="Time until the plan is deleted, s.")
    approved_by: str | None = Field(
        description="The client that has approved one run by an agent; null: not approved."
    )


class Approve(RequestModel):
    """A plan that an agent may run once."""

    model_config = example({"plan_id": "plan_2f1c9a0b7d3e4855"})

    plan_id: PlanId
    approved: Annotated[bool, Field(description="true: approve the plan; false: withdraw the approval.")] = (
        True
    )


class Planning(RequestModel):
    """The options of a plan, in addition to its motion."""

    start: Start = None
    samples: Samples = 50
    explain: ExplainIt = True


class Improve(RequestModel):
    """The time allowed for finding a faster plan."""

    model_config = example({"budget_s": 0.5, "samples": 3})

    budget_s: Annotated[
        BudgetS, Field(description="Time for the search, s. 0: the given plan is the answer.")
    ] = 1.0
    samples: Samples = 50


class PlanNamed(Planning, MoveNamed):
    """The fields of the motion, and the start of the plan."""

    model_config = example({"name": "work", "speed": 0.5, "samples": 3})


class PlanJoints(Planning, MoveJoints):
    """The fields of the motion, and the start of the plan."""

    model_config = example({"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25, "samples": 3})


class PlanPose(Planning, MovePose):
    """The fields of the motion, and the start of the plan."""

    model_config = example({"x": 0.4, "y": 0.0, "z": 0.5, "b": 3.14159, "speed": 0.25, "samples": 3})


class PlanArc(Planning, MoveArc):
    """The fields of the motion, and the start of the plan."""

    model_config = example(
        {
            "centre": {"x": 0.5, "y": 0.0, "z": 0.5},
            "axis": {"x": 0.0, "y": 0.0, "z": 1.0},
            "angle": 0.5,
            "samples": 3,
        }
    )


class PlanPath(Planning, TcpMotion):
    """Straight lines of the TCP, and the start of the plan."""

    model_config = example(
        {
            "poses": [
                {"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159},
                {"x": 0.45, "y": -0.1, "z": 0.5, "b": 3.14159},
            ],
            "radius": 0.02,
            "start": [0.0, 0.5, 0.0, -1.57, 0.0, 1.07, 0.0],
            "samples": 3,
        }
    )

    poses: Annotated[list[PathPose], FailFast()] = Field(
        min_length=1, max_length=201, description="Poses of the path; the last one is the goal."
    )
    radius: Radius = Field(
        0.0,
        description="Blend radius at each pose but the last, m; 0: the TCP stops there.",
    )

    def polyline(self) -> PlanPose:
        """The equivalent motion to a pose: a polyline through the other poses, or lin with a single pose."""
        given = self.model_dump(exclude={"poses"}, exclude_unset=True)
        through = [pose.model_dump() for pose in self.poses[:-1]]
        goal = self.poses[-1].model_dump()
        path: dict[str, Any] = {"planner": "polyline", "through": through}
        if not through:
            given.pop("radius", None)
            path = {"planner": "lin"}
        return PlanPose.model_validate({**given, **goal, **path})


class PlanSequence(Planning, MoveSequence):
    """The fields of the motion, and the start of the plan."""

    model_config = example(
        {
            "motions": [
                {"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25},
                {"name": "home", "speed": 0.25},
            ],
            "radii": [0.05],
            "samples": 3,
        }
    )


class PlanGripper(RequestModel):
    """A command to the gripper that is planned, not executed."""

    model_config = example({"gripper": {"command": "grasp", "width": 0.04}, "samples": 2})

    gripper: dict[str, Any] = Field(
        max_length=8,
        description="`command` is move, grasp, release or home; the other fields are those of POST "
        "/robot/gripper/move, grasp, release and home.",
    )
    samples: Samples = 2


class MotionQuery(StrictModel):
    """The resolution of the path."""

    model_config = ConfigDict(strict=False)

    samples: Samples = 100


class Execute(RequestModel):
    """The plan to run."""

    model_config = example({"plan_id": "plan_2f1c9a0b7d3e4855"})

    plan_id: PlanId
