"""OpenAPI links from values in answers to the operations that take them, for generated clients and fuzzers.

A link is only a hint, because a plan can expire, a job can end and a recording can be deleted.
"""

from __future__ import annotations

from typing import Any

from cobot.addresses import CONTROL_TOKEN

PLAN = "$response.body#/plan_id"
JOB = "$response.body#/id"
NAME = "$response.body#/name"
RECORDING = "$response.body#/names/0"
TWIN = "_of"
"""Suffix of the operation ids of endpoints whose path contains the robot's name."""


def _parameter(name: str, value: str) -> dict[str, Any]:
    return {"parameters": {name: value}}


LINKS: dict[str, dict[str, dict[str, Any]]] = {
    "PlanAnswer": {
        "kept_plan": _parameter("plan", PLAN),
        "rehearse": _parameter("plan", PLAN),
        "execute_plan": _parameter("plan", PLAN),
        "approve_plan": _parameter("plan", PLAN),
        "approve": {"requestBody": {"plan_id": PLAN}},
        "execute": {"requestBody": {"plan_id": PLAN}},
    },
    "KeptPlan": {"execute": {"requestBody": {"plan_id": PLAN}}},
    "JobAnswer": {
        operation: _parameter("job", JOB)
        for operation in ("job", "cancel_job", "pause_job", "resume_job", "retarget_job", "step_job")
    },
    "NamedPositionAnswer": {
        "move_named": {"requestBody": {"name": NAME}},
        "plan_named": {"requestBody": {"name": NAME}},
        "forget_position": _parameter("name", NAME),
    },
    "AskedRecordingAnswer": {
        operation: _parameter("name", RECORDING)
        for operation in ("recording", "recorded_path", "remove_recording")
    },
    "TakenAnswer": {"release_control": _parameter(CONTROL_TOKEN, "$response.body#/token")},
}
"""Links of each answer model. For each operation: the value that it takes from the answer, and the parameter
to which the value is passed.
"""


def link(schema: dict[str, Any]) -> None:
    """Add the links between the operations of an OpenAPI document to that document."""
    known = {each["operationId"] for path in schema["paths"].values() for each in path.values()}
    for operations in schema["paths"].values():
        for method, endpoint in operations.items():
            if method == "delete":  # the object with this name no longer exists
                continue
            suffix = TWIN if endpoint["operationId"].endswith(TWIN) else ""
            for answer in endpoint["responses"].values():
                links = _links(answer, suffix, known)
                if links:
                    answer["links"] = links


def _links(answer: dict[str, Any], suffix: str, known: set[str]) -> dict[str, Any]:
    """Create links from an answer to other operations on the same robot."""
    content = answer.get("content", {}).get("application/json", {}).get("schema", {})
    found = LINKS.get(content.get("$ref", "").rpartition("/")[2], {})
    robot = {"robot": "$request.path.robot"} if suffix else {}
    return {
        operation: {
            "operationId": operation + suffix,
            **each,
            **({"parameters": robot | each.get("parameters", {})} if robot else {}),
        }
        for operation, each in found.items()
        if operation + suffix in known
    }
