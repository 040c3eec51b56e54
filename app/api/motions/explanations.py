"""Alternatives to a motion that cannot be planned, as complete requests that a client can send."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.api.schemas.explain import Explain, Works, explain_of, tried_of
from cobot.errors import CobotError
from cobot.findings import Explanation, Remedy
from cobot.motions.bodies import AnyMotion, MoveArc, MoveJoints, MoveNamed, MovePose
from cobot.motions.planners import BODY_FIELDS
from cobot.motions.requests import MotionRequest
from cobot.types import Array, Pose, Scaling

ENDPOINTS: dict[type[Any], str] = {MoveNamed: "named", MoveJoints: "joints", MovePose: "pose", MoveArc: "arc"}
OF_POSES = set(MovePose.model_fields) - set(MoveJoints.model_fields)
"""Fields of a motion to a pose that a motion to joint angles does not have."""
DROPPED = set().union(*BODY_FIELDS.values())
"""Fields that not every planner uses. An alternative with a different planner omits them."""


def explained(
    error: CobotError,
    found: Explanation,
    motions: Sequence[AnyMotion],
    goals: Sequence[MotionRequest],
    base_frame: str,
) -> Explain:
    """Explain why planning failed with `error`. `motions` are the requested motions to `goals`."""
    explain = explain_of(error)
    assert explain is not None
    number = (found.motion or 1) - 1
    body, in_tool = motions[number], goals[number].in_tool
    return explain.model_copy(
        update={
            "motion": found.motion,
            # From a different start, poses in the TCP frame would be different goals.
            "works": [
                _works(each, body, found, base_frame)
                for each in found.works
                if not (in_tool and each.kind == "start")
            ],
            "tried": tried_of(found.tried),
            "spent_s": found.spent_s,
            "budget_s": found.budget_s,
        }
    )


def _works(remedy: Remedy, asked: AnyMotion, found: Explanation, base_frame: str) -> Works:
    body = asked.model_dump(exclude_unset=True, by_alias=True)
    kind = next(name for model, name in ENDPOINTS.items() if isinstance(asked, model))
    if found.motion is not None:
        body["start"] = list(found.start)
    for field, value in remedy.change.items():
        match field:
            case "scaling":
                assert isinstance(value, Scaling)
                body |= {"speed": value.speed, "accel_scale": value.accel_scale}
            case "planner":
                body = {name: given for name, given in body.items() if name not in DROPPED}
                body["planner"] = str(value)
            case "free_axes":
                body["free_axes"] = list(value)
            case "end_joints":
                body.pop("end_joints", None)
            case "cyclic" if body.get("cyclic"):
                body["cyclic"] = value
            case "start":
                body["start"] = value.tolist()
            case "goal" if isinstance(value, Pose):
                body |= _pose(value, base_frame)
            case "goal":
                kind = "joints"
                body = _to_joints(body, value)
    return Works(
        change=remedy.kind,
        says=remedy.says,
        endpoint=f"/robot/plan/{kind}",
        body=body,
        duration_s=remedy.duration_s,
    )


def _pose(goal: Pose, base_frame: str) -> dict[str, Any]:
    x, y, z = goal.position.tolist()
    a, b, c = goal.abc
    return {"x": x, "y": y, "z": z, "a": a, "b": b, "c": c, "frame_id": base_frame}


def _to_joints(body: dict[str, Any], joints: Array) -> dict[str, Any]:
    kept = {name: given for name, given in body.items() if name not in OF_POSES | {"name"}}
    return kept | {"joints": joints.tolist()}
