"""Each refusal over each transport has its code of docs/services.md. Oracle: `cobot.codes`."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Coroutine
from typing import Any

import httpx2
import pytest
from asgi_client import Refused
from mcp.server.mcpserver.exceptions import ToolError
from virtual_service import VirtualService

from app.actions.fjt_goal import GoalViolated, JointsError, OldGoalError, PathViolated
from app.api.errors import answer_to
from app.api.routers import events, stream
from app.aubo.classes import REGISTRY
from app.aubo.registry import CallOrigin, VendorService, run
from app.foxglove import router as foxglove
from app.graph.actions import GoalHandle
from app.graph.graph import Graph
from app.mcp.server import refusal, refused_by
from app.mcp.tools import read_decision
from app.rosbridge.connection import RosbridgeConnection
from cobot.client import Client
from cobot.codes import OF_ERROR, code_of
from cobot.dds.gateway import failure
from cobot.dds.rosbridge import Rosbridge
from cobot.errors import BY_CODE, CobotError, PayloadError
from cobot.ros.failures import FjtError, error_code_of
from cobot.ros.messages import Messages
from cobot.runner.lua_program import Program
from cobot.runner.lua_sandbox import LuaLimits, run_apart

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
    client = RosbridgeConnection(graph, "client")
    if complaint is None:
        client.take(asked)
    else:
        client.report_error(complaint, "1")
    while not (texts := list(client.outbox.texts())):
        await asyncio.sleep(0)
    await client.close()
    await graph.close()
    answer: dict[str, Any] = json.loads(texts[0])
    return answer


def done(work: Coroutine[Any, Any, Any]) -> Any:
    return asyncio.run(asyncio.wait_for(work, 60.0))


def refusing(error: CobotError) -> Callable[..., Any]:
    def refuse(*_: object) -> Any:
        raise error

    return refuse


def told(socket: Any, name: str, value: str) -> dict[str, Any]:
    """The first text message with this value."""
    while True:
        message = socket.recv()
        if isinstance(message, str) and (content := json.loads(message)).get(name) == value:
            return dict(content)


@pytest.mark.parametrize("kind", ERRORS)
def test_http_has_the_name_of_the_code(kind: type[CobotError]) -> None:
    answer = json.loads(bytes(answer_to(kind("why")).body))
    assert answer["code"] == code_of(kind("why")).name.lower()


@pytest.mark.parametrize("kind", ERRORS)
@pytest.mark.parametrize(
    ("path", "place", "function"),
    [
        ("/robot/stream", stream, "services_of"),
        ("/events", events, "_listener"),
        ("/foxglove", foxglove, "_rate"),
    ],
)
def test_a_websocket_that_is_not_accepted_is_answered_as_http_is(
    service: VirtualService,
    monkeypatch: pytest.MonkeyPatch,
    kind: type[CobotError],
    path: str,
    place: Any,
    function: str,
) -> None:
    monkeypatch.setattr(place, function, refusing(kind("why")))
    with pytest.raises(Refused) as refused:
        service.connect(path, subprotocols=foxglove.SUBPROTOCOLS[0])
    expected = answer_to(kind("why"))
    assert (refused.value.status, refused.value.body) == (expected.status_code, bytes(expected.body))


@pytest.mark.parametrize("kind", ERRORS)
def test_frames_of_a_stream_have_the_name_of_the_code(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch, kind: type[CobotError]
) -> None:
    with service.connect("/robot/stream") as socket:
        monkeypatch.setattr(stream, "read_frame", refusing(kind("why")))
        socket.send(json.dumps({"type": "target", "sequence": 7}))
        frame = told(socket, "type", "error")
    assert frame["code"] == code_of(kind("why")).name.lower()
    assert (frame["detail"], frame["sequence"]) == ("why", 7)


@pytest.mark.parametrize("kind", ERRORS)
def test_foxglove_has_the_code(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch, kind: type[CobotError]
) -> None:
    monkeypatch.setattr(foxglove._Client, "_take", refusing(kind("why")))
    with service.connect("/foxglove", subprotocols=foxglove.SUBPROTOCOLS[0]) as socket:
        socket.send("{}")
        status = told(socket, "op", "status")
    assert (status["message"], status["code"]) == ("why", OF_ERROR[kind])


@pytest.mark.parametrize("kind", ERRORS)
@pytest.mark.parametrize("source", ["movej({1})", "robot.A.b({})"])
def test_lua_programs_have_the_code_in_the_text_that_pcall_gives(kind: type[CobotError], source: str) -> None:
    def refuse(request: httpx2.Request) -> httpx2.Response:
        if request.url.path == "/health":
            return httpx2.Response(200, json={"robot": {"name": "iiwa"}})
        answer = answer_to(kind("why"))
        return httpx2.Response(answer.status_code, content=bytes(answer.body))

    def run(text: str) -> list[str]:
        lines: list[str] = []
        with Client("http://robot", transport=httpx2.MockTransport(refuse)) as client:
            program = Program(client, "http://127.0.0.1:1", LuaLimits(), lines.append)
            run_apart(lambda: program.run(text.encode(), "test.lua"), program.watch)
        return lines

    (line,) = run(f"textmsg(select(2, pcall(function() {source} end)))")
    assert line.endswith(f"why (code {int(OF_ERROR[kind])})")
    with pytest.raises(kind):
        run(source)


@pytest.mark.parametrize("kind", ERRORS)
def test_vendor_services_have_the_code(kind: type[CobotError]) -> None:
    def refuse(robot: Any) -> int:
        raise kind("why")

    found = VendorService(
        robot_class="RobotConfig",
        method="getDof",
        doc=GET_DOF.doc,
        parameters=(),
        result=GET_DOF.result,
        function=refuse,
        takes_origin=False,
    )
    answer = done(run(None, found, {}, CallOrigin("test", 0)))  # type: ignore[arg-type]
    assert (answer.code, answer.message, answer.result) == (OF_ERROR[kind], "why", int(OF_ERROR[kind]))


@pytest.mark.parametrize("kind", ERRORS)
def test_rosbridge_has_the_code_of_calls_of_goals_and_of_messages(kind: type[CobotError]) -> None:
    call = done(over_rosbridge(kind("why"), op="call_service", id="1", service="/refuse_call"))
    goal = done(over_rosbridge(kind("why"), op="send_action_goal", id="1", action="/refuse"))
    for answer in (call, goal):
        assert (answer["result"], answer["values"], answer["code"]) == (False, "why", OF_ERROR[kind])
    complaint = done(over_rosbridge(kind("why"), complaint=kind("why")))
    assert (complaint["op"], complaint["code"]) == ("status", OF_ERROR[kind])


@pytest.mark.parametrize(
    ("asked", "answer"), [("call_service", "service_response"), ("send_action_goal", "action_result")]
)
def test_what_is_too_large_to_be_decoded_is_answered_with_its_code(asked: str, answer: str) -> None:
    async def rejected() -> Any:
        graph = Graph(Messages())
        client = RosbridgeConnection(graph, "client")
        client.reject_unread(json.dumps({"op": asked, "id": "1", "args": {}}), PayloadError("why"))
        (text,) = client.outbox.texts()
        await client.close()
        await graph.close()
        return json.loads(text)

    told = done(rejected())
    assert (told["op"], told["id"], told["result"]) == (answer, "1", False)
    assert (told["values"], told["code"]) == ("why", OF_ERROR[PayloadError])


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
        read_decision((409, {"detail": "why", "code": kind.code}))
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
