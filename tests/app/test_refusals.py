"""Each refusal over each transport has its code of docs/services.md. Oracle: `cobot.codes`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine
from typing import Any

import pytest
from mcp.server.mcpserver.exceptions import ToolError

from app.actions.fjt_goal import GoalViolated, JointsError, OldGoalError, PathViolated
from app.api.errors import answer_to
from app.aubo.classes import REGISTRY
from app.aubo.registry import Origin, Service, run
from app.graph.actions import GoalHandle
from app.graph.graph import Graph
from app.mcp.server import refusal, refused_by
from app.mcp.tools import decided
from app.rosbridge.connection import Connection
from cobot.codes import OF_ERROR, code_of
from cobot.errors import BY_CODE, CobotError
from cobot.ros.failures import FjtError, error_code_of
from cobot.ros.messages import Messages
from ros2.gateway import failure
from ros2.rosbridge import Rosbridge

ERRORS = sorted(BY_CODE.values(), key=lambda kind: kind.code)
GET_DOF = REGISTRY["RobotConfig", "getDof"]
EMPTY = {"code": 0, "message": "", "result": 0}


class Refusing:
    """An action that refuses each goal, and a service that refuses each call."""

    name = "/refuse"
    type_ = "aubo_interfaces/action/Refuse"
    definition = "---\nint32 done\n---\nint32 now\n"

    def __init__(self, error: CobotError) -> None:
        self.error = error

    async def execute(self, goal: dict[str, Any], handle: GoalHandle) -> dict[str, Any]:
        raise self.error

    async def call(self, request: dict[str, Any]) -> dict[str, Any]:
        raise self.error


async def over_rosbridge(
    error: CobotError, complaint: CobotError | None = None, **asked: Any
) -> dict[str, Any]:
    graph = Graph(Messages())
    refusing = Refusing(error)
    graph.add_action(refusing)
    graph.add_service("/refuse_call", "std_srvs/srv/Trigger", refusing.call, owner=refusing)
    client = Connection(graph, "client")
    if complaint is None:
        client.take(asked)
    else:
        client.complain(complaint, "1")
    while not (texts := list(client.outbox.texts())):
        await asyncio.sleep(0)
    await client.close()
    await graph.close()
    answer: dict[str, Any] = json.loads(texts[0])
    return answer


def done(work: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(asyncio.wait_for(work, 60.0))


@pytest.mark.parametrize("kind", ERRORS)
def test_http_and_websockets_have_the_name_of_the_code(kind: type[CobotError]) -> None:
    """Frames of /robot/stream and /events say `code` as HTTP does: `CobotError.code`."""
    answer = json.loads(bytes(answer_to(kind("why")).body))
    assert answer["code"] == code_of(kind("why")).name.lower()


@pytest.mark.parametrize("kind", ERRORS)
def test_vendor_services_have_the_code(kind: type[CobotError]) -> None:
    def refuse(robot: Any) -> int:
        raise kind("why")

    found = Service(
        robot_class="RobotConfig",
        method="getDof",
        doc=GET_DOF.doc,
        parameters=(),
        result=GET_DOF.result,
        function=refuse,
        takes_origin=False,
    )
    answer = done(run(None, found, {}, Origin("test", 0)))  # type: ignore[arg-type]
    assert (answer.code, answer.message, answer.result) == (OF_ERROR[kind], "why", int(OF_ERROR[kind]))


@pytest.mark.parametrize("kind", ERRORS)
def test_rosbridge_has_the_code_of_calls_of_goals_and_of_messages(kind: type[CobotError]) -> None:
    call = done(over_rosbridge(kind("why"), op="call_service", id="1", service="/refuse_call"))
    goal = done(over_rosbridge(kind("why"), op="send_action_goal", id="1", action="/refuse"))
    for answer in (call, goal):
        assert (answer["result"], answer["values"], answer["code"]) == (False, "why", OF_ERROR[kind])
    complaint = done(over_rosbridge(kind("why"), complaint=kind("why")))
    assert (complaint["op"], complaint["code"]) == ("status", OF_ERROR[kind])


@pytest.mark.parametrize("kind", ERRORS)
def test_dds_has_the_code_that_rosbridge_has_given(kind: type[CobotError]) -> None:
    async def called() -> None:
        link = Rosbridge("http://localhost:1", lambda: None, lambda topic, message: None)
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        link._calls["call:1"] = answer
        refused = {"op": "service_response", "id": "call:1", "values": "why", "result": False}
        link._take({**refused, "code": int(OF_ERROR[kind])})
        await answer

    with pytest.raises(kind, match="why") as caught:
        done(called())
    code = int(OF_ERROR[kind])
    assert failure(dict(EMPTY), caught.value) == {"code": code, "message": "why", "result": code}


@pytest.mark.parametrize("kind", ERRORS)
def test_agents_get_the_code_from_the_service_and_from_the_rest_api(kind: type[CobotError]) -> None:
    expected = {"detail": "why", "code": kind.code, "number": int(OF_ERROR[kind])}
    assert refusal(kind("why")).structured_content == expected
    with pytest.raises(ToolError, match="409: why") as caught:
        decided((409, {"detail": "why", "code": kind.code}))
    assert type(refused_by(caught.value)) is kind


@pytest.mark.parametrize("kind", ERRORS)
def test_a_goal_s_result_says_whether_the_goal_is_wrong_or_was_interrupted(kind: type[CobotError]) -> None:
    of_the_goal = ("input", "planning", "payload", "media_type", "not_supported")
    wrong = any(getattr(each, "code", "") in of_the_goal for each in kind.__mro__)
    assert error_code_of(kind("why")) is (FjtError.INVALID_GOAL if wrong else FjtError.INTERRUPTED)


def test_the_action_s_own_errors_have_its_own_codes() -> None:
    assert error_code_of(JointsError("why")) is FjtError.INVALID_JOINTS
    assert error_code_of(OldGoalError("why")) is FjtError.OLD_HEADER_TIMESTAMP
    assert error_code_of(PathViolated("why")) is FjtError.PATH_TOLERANCE_VIOLATED
    assert error_code_of(GoalViolated("why")) is FjtError.GOAL_TOLERANCE_VIOLATED
