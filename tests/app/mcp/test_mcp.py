"""Agents: the official client of the Model Context Protocol at the whole service on virtual time.

Oracles: that client, which knows nothing of us, and where rtloop says the arm is.
"""

from __future__ import annotations

import asyncio
import base64
import io
import json
import struct
import zlib
from collections.abc import Coroutine
from typing import Any

import jsonschema_rs
import numpy as np
import pytest
from mcp import MCPError
from mcp_agent import FAR, HOME, NEAR, Agent, Cell, token
from virtual_service import VirtualService

from app.api.documentation.generators import simplify_nulls
from cobot.access.roles import Role
from cobot.motions.fence import Fence


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_the_official_client_finds_tools_resources_and_prompts(service: VirtualService, mode: str) -> None:
    agent = Agent(service, mode=mode)
    tools = agent.does(lambda client: client.list_tools()).tools
    assert {"get_state", "plan_to_pose", "preview", "execute", "stop", "why_did_it_stop"} <= {
        tool.name for tool in tools
    }
    assert all(tool.description for tool in tools)
    limits = agent.does(lambda client: client.read_resource(f"cobot://limits/{service.name}"))
    assert '"max_velocity"' in limits.contents[0].text
    prompts = agent.does(lambda client: client.list_prompts()).prompts
    assert {prompt.name for prompt in prompts} == {"move_safely", "diagnose"}


@pytest.mark.parametrize("method", ["GET", "PUT", "DELETE"])
def test_nothing_but_post_is_taken(service: VirtualService, method: str) -> None:
    """The body of a GET, which nobody counts, would be kept whole, however long it goes on."""
    answer = service.ask(method, "/mcp/mcp", content=b"{}")
    assert (answer.status_code, answer.headers["allow"]) == (405, "POST")


def rpc(service: VirtualService, method: str, params: Any = None, **headers: str) -> Coroutine[Any, Any, Any]:
    """A request without a client."""
    accept = {"accept": "application/json, text/event-stream", **headers}
    body = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params or {}}
    return service.asking("POST", "/mcp/mcp", json=body, headers=accept)


def test_a_body_larger_than_any_tool_needs_is_not_taken_in(service: VirtualService) -> None:
    """What the library makes of it, it makes in the event loop, which serves the stop too."""
    joints = {"name": "plan_to_joints", "arguments": {"joints": ["x"] * 10_000}}
    answer = service.run(rpc(service, "tools/call", joints))
    assert answer.status_code == 413
    assert answer.json()["detail"] == "the body is larger than the limit of 32768 bytes for agents"


@pytest.mark.parametrize(
    ("tool", "arguments", "words"),
    [
        (
            "plan_to_joints",
            {"joints": ["x"] * 5000},
            "plan_to_joints: joints[0]: must be a number, got 'x'",
        ),
        ("plan_to_joints", {}, "plan_to_joints: joints: is missing"),
        ("plan_to_joints", {"what": 1, "outcome": 2}, "unknown key 'what'; valid keys: joints, speed, robot"),
        (
            "plan_to_pose",
            {"x": 0.0, "y": 0.0, "z": 0.1, "frame": "tool"},
            "plan_to_pose: unknown key 'frame' (did you mean 'frame_id'?); valid keys: x, y, z",
        ),
        ("plan_to_pose", {"x": "0.4", "y": 0.0, "z": 0.5}, "x: must be a number, got '0.4'"),
        ("plan_to_pose", {"x": True, "y": 0.0, "z": 0.5}, "x: must be a number, got true"),
        ("plan_to_pose", {"x": 0.4, "y": 0.0, "z": 0.5, "b": 180}, "180 degrees are 3.14159 rad"),
        ("plan_to_pose", {"x": 400, "y": 0, "z": 500}, "look like millimetres"),
        ("plan_to_joints", {"joints": "[0, 0]"}, "joints: must be a list, got '[0, 0]'"),
        ("stop", {"robots": ""}, "unknown key 'robots' (did you mean 'robot'?); valid keys: robot"),
        ("y" * 9000, {}, "there is no tool 'yyy"),
        ("get_state", {"robot": "nobody"}, "there is no robot 'nobody'; valid names: "),
        ("get_log", {"lines": 10**12}, "get_log: lines: must be less than or equal to 300"),
    ],
)
def test_what_is_wrong_is_said_in_few_words(
    service: VirtualService, tool: str, arguments: dict[str, Any], words: str
) -> None:
    said = Agent(service).refused(tool, **arguments)
    assert words in said
    assert len(said) < 450


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_each_tool_publishes_a_closed_schema_with_a_description_and_a_range_of_each_argument(
    service: VirtualService, mode: str
) -> None:
    for tool in Agent(service, mode=mode).does(lambda client: client.list_tools()).tools:
        assert tool.input_schema["additionalProperties"] is False, tool.name
        for name, field in tool.input_schema["properties"].items():
            assert field["description"], (tool.name, name)
            if field.get("type") in ("number", "integer"):
                assert field["minimum"] < field["maximum"], (tool.name, name)
            if field.get("type") == "string":
                assert "maxLength" in field or "enum" in field, (tool.name, name)


POSE = {"x": 0.45, "y": 0.0, "z": 0.5}
CALLS: list[tuple[str, dict[str, Any]]] = [
    ("plan_to_pose", POSE),
    ("plan_to_pose", POSE | {"x": "0.45"}),
    ("plan_to_pose", POSE | {"x": None}),
    ("plan_to_pose", POSE | {"b": 180.0}),
    ("plan_to_pose", POSE | {"b": 9}),
    ("plan_to_pose", POSE | {"speed": 0.001}),
    ("plan_to_pose", POSE | {"speed": 1}),
    ("plan_to_pose", POSE | {"planner": "circ"}),
    ("plan_to_pose", POSE | {"frame": "tool"}),
    ("plan_to_pose", {"x": 0.45, "y": 0.0}),
    ("plan_to_pose", POSE | {"free_axes": ["rz"]}),
    ("plan_to_pose", POSE | {"free_axes": None}),
    ("plan_to_pose", POSE | {"free_axes": ["a"]}),
    ("plan_to_pose", POSE | {"cyclic": True}),
    ("plan_path", {"poses": [{"x": 0.0, "y": 0.0, "z": -0.01}], "frame_id": "tool"}),
    ("plan_path", {"poses": [POSE | {"q": 1.0}]}),
    ("plan_path", {"poses": [POSE], "cyclic": "yes"}),
    ("plan_path", {"poses": []}),
    ("plan_arc", {"centre": POSE, "axis": POSE, "angle": 1.0, "rise": 11.0}),
    ("plan_arc", {"centre": POSE, "axis": POSE}),
    ("plan_to_joints", {"joints": NEAR}),
    ("plan_to_joints", {"joints": []}),
    ("plan_to_joints", {"joints": 0.5}),
    ("plan_to_position", {"name": "work"}),
    ("plan_to_position", {"name": 7}),
    ("get_log", {"lines": 0}),
    ("get_log", {"lines": 1.5}),
    ("get_log", {"lines": 300}),
    ("get_state", {"robot": "x" * 65}),
]


@pytest.mark.parametrize(("tool", "arguments"), CALLS)
def test_a_call_is_taken_exactly_if_the_published_schema_permits_it(
    service: VirtualService, tool: str, arguments: dict[str, Any]
) -> None:
    """Oracle: a second implementation of JSON Schema."""
    agent = Agent(service)
    tools = agent.does(lambda client: client.list_tools()).tools
    schema = next(each.input_schema for each in tools if each.name == tool)
    answer = agent.does(lambda client: client.call_tool(tool, arguments))
    assert answer.is_error is not jsonschema_rs.validator_for(schema).is_valid(arguments)


def test_a_refusal_brings_its_code_as_structured_content(service: VirtualService) -> None:
    agent = Agent(service)
    for tool, arguments, code, number in (
        ("no_tool", {}, "not_found", 12),
        ("plan_to_pose", {"x": 0.4, "y": 0.0, "z": 0.5, "frame": "tool"}, "input", 10),
        ("plan_to_pose", {"x": 5.0, "y": 0.0, "z": 0.5}, "unreachable", 21),
        ("plan_to_joints", {"joints": [9.0, *NEAR[1:]]}, "limit", 11),
        ("preview", {"plan_id": "gone"}, "not_found", 12),
    ):
        answer = agent.does(lambda client: client.call_tool(tool, arguments))  # noqa: B023
        assert answer.is_error, tool
        told = {"detail": answer.content[0].text, "code": code, "number": number}
        assert answer.structured_content == told


def test_an_agent_sees_where_the_arm_is(service: VirtualService) -> None:
    state = Agent(service).call("get_state")
    np.testing.assert_allclose(state["joints"]["position"], service.joints(), atol=1e-3)


def test_a_plan_can_be_looked_at(service: VirtualService) -> None:
    agent = Agent(service)
    before = service.joints()
    plan = agent.call("plan_to_joints", joints=NEAR, speed=0.5)
    answer = agent.does(lambda client: client.call_tool("preview", {"plan_id": plan["plan_id"]}))
    assert answer.content[0].mime_type == "image/png"
    pixels = read_png(base64.b64decode(answer.content[0].data))
    blue = (pixels[:, :, 2] > 200) & (pixels[:, :, 0] < 60)
    assert blue.sum() > 20, "the way of the TCP is not to be seen"
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 50
    assert service.joints() == before


def test_a_crowd_of_previews_takes_one_planning_process_and_does_not_wait_for_ever(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent = Agent(service)
    plan = agent.call("plan_to_joints", joints=NEAR, speed=0.5)["plan_id"]
    drawn = [0, 0]

    async def slowly(*_: Any) -> bytes:
        drawn[0] += 1
        drawn[1] = max(drawn)
        await asyncio.sleep(4.0)
        drawn[0] -= 1
        return b"a picture"

    monkeypatch.setattr(service.app.state.services.planning, "compute", slowly)
    asked = {"name": "preview", "arguments": {"plan_id": plan}}
    crowd = [service.begin(rpc(service, "tools/call", asked)) for _ in range(5)]
    answers = [service.end(each).json()["result"] for each in crowd]
    assert drawn == [0, 1]
    assert [answer["isError"] for answer in answers] == [False, False, False, True, True]
    assert (
        "could not be drawn within 10 s, because other plans are being drawn"
        in answers[-1]["content"][0]["text"]
    )


def test_off_is_off(service: VirtualService) -> None:
    agent = Agent(service)
    plan = agent.call("plan_to_joints", joints=NEAR)
    service.post("/robot/approve", json={"plan_id": plan["plan_id"]})
    assert "mcp.execution is off" in agent.refused("execute", plan_id=plan["plan_id"])


def test_a_stop_overtakes_all_that_other_agents_have_asked_for(service: VirtualService) -> None:
    service.go_home()
    moving = service.begin(service.asking("POST", "/robot/move/joints", json={"joints": FAR, "speed": 0.1}))
    service.sleep(0.5)
    crowd = [service.begin(rpc(service, "tools/list")) for _ in range(50)]
    stopping = service.begin(rpc(service, "tools/call", {"name": "stop"}))
    service.sleep(0.4)
    assert moving.done(), "the crowd takes a second, the arm a tenth of one"
    assert not all(each.done() for each in crowd)
    assert "the arm is at rest" in service.end(stopping).json()["result"]["content"][0]["text"]
    assert {service.end(each).status_code for each in crowd} == {200}


def test_an_agent_moves_within_its_fence(cell: Cell) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=NEAR, speed=0.1)
    assert cell.agent.call("execute", plan_id=plan["plan_id"])["success"]
    np.testing.assert_allclose(cell.joints(), NEAR, atol=2e-3)


def test_an_agent_runs_a_plan_with_an_event_and_a_condition_and_is_told_of_them(cell: Cell) -> None:
    cell.goes_to(HOME)
    events = [{"at": {"fraction": 0.5}, "event": "half way"}]
    until = {"torque": {"joint": "joint2", "threshold": 500.0}, "if_not_met": "success"}
    body = {"joints": NEAR, "speed": 0.1, "actions": events, "until": until}
    plan = cell.service.post("/robot/plan/joints", body, headers=cell.agent.headers).json()
    assert "plan_id" in plan, plan
    (listed,) = (
        each for each in cell.agent.call("list_plans")["plans"] if each["plan_id"] == plan["plan_id"]
    )
    assert any("event 'half way'" in sentence for sentence in listed["signals"])
    answer = cell.agent.call("execute", plan_id=plan["plan_id"])
    assert (answer["success"], answer["stopped_by"]) == (True, "")
    assert [each["fired"] for each in answer["actions"]] == [True]


def test_what_an_operator_has_approved_runs_once(cell: Cell) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=FAR, speed=0.5)["plan_id"]
    assert "is not approved, and not within the fence" in cell.agent.refused("execute", plan_id=plan)
    assert cell.asks("/robot/approve", {"plan_id": plan})["approved_by"].startswith("operator")
    assert cell.agent.call("execute", plan_id=plan)["success"]
    np.testing.assert_allclose(cell.joints(), FAR, atol=2e-3)
    cell.goes_to(HOME)
    assert "is not approved" in cell.agent.refused("execute", plan_id=plan)


TRIANGLE = [{"x": x, "y": y, "z": 0.0} for x, y in ((0.05, 0.0), (0.05, 0.08), (0.0, 0.0))]
"""In the tool's frame; it ends where it begins."""


def test_an_agent_repeats_a_closed_path_which_ends_in_its_joints(cell: Cell) -> None:
    """Oracles: the plan's own joints, and rtloop, which starts no plan elsewhere than at its start."""
    cell.goes_to(HOME)
    given = {"poses": TRIANGLE, "frame_id": "tool", "speed": 0.5}
    path = cell.agent.call("plan_path", **given, cyclic=True)["path"]
    np.testing.assert_allclose(path[-1]["joints"], path[0]["joints"], atol=1e-6)
    plan = cell.agent.call("plan_path", **given, cyclic=True)["plan_id"]
    for _ in range(3):
        cell.asks("/robot/approve", {"plan_id": plan})
        assert cell.agent.call("execute", plan_id=plan)["success"]
    np.testing.assert_allclose(cell.joints(), HOME, atol=2e-3)


def test_an_agent_says_how_a_circle_a_path_and_a_line_end(cell: Cell) -> None:
    """Oracle: the joints that the plan begins and ends with."""
    cell.goes_to(NEAR)
    circle = {"centre": {"x": 0.05, "y": 0.0, "z": 0.0}, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}}
    turn = {"angle": 2.0 * np.pi, "frame_id": "tool", "speed": 0.5}
    path = cell.agent.call("plan_arc", **circle, **turn)["path"]
    np.testing.assert_allclose(path[-1]["joints"], path[0]["joints"], atol=1e-6)
    open_end = cell.agent.call("plan_arc", **circle, **turn, cyclic=False)["path"]
    assert np.abs(np.subtract(open_end[-1]["joints"], open_end[0]["joints"])).max() > 1e-3
    ahead = {"x": 0.0, "y": 0.0, "z": -0.03, "b": 0.0, "frame_id": "tool", "planner": "lin"}
    said = cell.agent.refused("plan_to_pose", **ahead, end_joints=NEAR)
    assert "end_joints: their pose is 30 mm and 0 degrees from the goal" in said
    assert "cyclic: the path of polyline ends" in cell.agent.refused(
        "plan_path", poses=TRIANGLE[:2], frame_id="tool", cyclic=True
    )


@pytest.mark.parametrize(
    ("tool", "path"),
    [("plan_to_pose", "pose"), ("plan_path", "path"), ("plan_arc", "arc")],
)
def test_what_a_tool_takes_from_a_rest_body_has_its_schema(
    service: VirtualService, tool: str, path: str
) -> None:
    """Oracle: the OpenAPI document of the service, where the description has the default."""
    tools = {each.name: each for each in Agent(service).does(lambda client: client.list_tools()).tools}
    bodies = service.get("/openapi.json").json()["components"]["schemas"]
    rest = bodies[f"Plan{path.capitalize()}"]["properties"]
    own = {"robot"} | ({"x", "y", "z", "a", "b", "c", "planner"} if path == "pose" else set())
    taken = {name: field for name, field in tools[tool].input_schema["properties"].items() if name not in own}
    assert {"free_axes", "end_joints" if path == "pose" else "cyclic"} <= taken.keys()
    for name, field in taken.items():
        expected = json.loads(json.dumps(rest[name]).replace("#/components/schemas/", "#/$defs/"))
        simplify_nulls(field)
        default = field.pop("default", None)
        if default is not None:
            text = f"Default: {json.dumps(default)}."
            field["description"] = f"{field.get('description', '')} {text}".strip()
        assert field == expected, name


def test_an_approval_can_be_taken_back(cell: Cell) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=FAR, speed=0.5)["plan_id"]
    cell.asks("/robot/approve", {"plan_id": plan})
    assert cell.asks("/robot/approve", {"plan_id": plan, "approved": False})["approved_by"] is None
    assert "is not approved" in cell.agent.refused("execute", plan_id=plan)


def test_an_agent_stops_the_arm_for_everybody(cell: Cell) -> None:
    cell.goes_to(HOME)
    service = cell.service
    moving = service.begin(
        service.asking(
            "POST", "/robot/move/joints", json={"joints": FAR, "speed": 0.1}, headers=cell.operator
        )
    )
    service.sleep(0.5)
    cell.agent.call("stop")
    answer = service.end(moving).json()
    assert not answer["success"]
    assert "stopped by POST /stop" in answer["message"]
    assert "STOPPED" in cell.agent.call("why_did_it_stop")["last_motion"]


OUTSIDE: list[tuple[str, dict[str, Any], str]] = [
    ("plan_to_joints", {"joints": FAR, "speed": 0.1}, "the TCP would be at"),
    ("plan_to_joints", {"joints": NEAR, "speed": 1.0}, "m/s, but the fence permits 0.25 m/s"),
    ("plan_to_pose", {"x": 0.5, "y": 0.0, "z": 0.15, "speed": 0.1}, "the TCP would be at z"),
    (
        "plan_to_pose",
        {"x": 0.4, "y": 0.4, "z": 0.5, "planner": "lin"},
        "the TCP would be at y",
    ),
    ("plan_to_pose", {"x": 0.5, "y": 0.1, "z": 0.5, "speed": 0.1, "planner": "ompl"}, "its planner is ompl"),
    ("plan_to_pose", {"x": 0.5, "y": 0.1, "z": 0.5, "speed": 0.1, "planner": "auto"}, "its planner is auto"),
]


@pytest.mark.parametrize(("tool", "arguments", "why"), OUTSIDE)
def test_a_plan_beyond_the_fence_is_refused(
    cell: Cell, tool: str, arguments: dict[str, Any], why: str
) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call(tool, **arguments)["plan_id"]
    assert why in cell.agent.refused("execute", plan_id=plan)
    np.testing.assert_allclose(cell.joints(), HOME, atol=2e-3)


def test_rtloop_holds_the_fence_where_the_service_fails_to(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=FAR, speed=0.1)["plan_id"]
    monkeypatch.setattr(Fence, "breach", lambda *_: "")
    answer = cell.agent.call("execute", plan_id=plan)
    assert not answer["success"]
    assert "the motion would leave its fence: the TCP would be at y = 0.3" in answer["error"]
    pose = cell.service.ask("GET", "/robot/pose", headers=cell.operator).json()
    assert 0.1 < pose["position"]["y"] < 0.3


REST: list[tuple[str, Any]] = [
    ("/robot/move/joints", {"joints": NEAR}),
    ("/robot/move/named", {"name": "home"}),
    ("/robot/move/pose", {"x": 0.5, "y": 0.0, "z": 0.5, "b": 3.14159}),
    ("/robot/move/sequence", {"motions": [{"joints": NEAR}]}),
    ("/robot/execute", {"plan_id": "PLAN"}),
    ("/robot/approve", {"plan_id": "PLAN"}),
    ("/robot/tool", {"mass": 1.0}),
    ("/robot/control", {}),
    ("/robot/reset", None),
    ("/scene", {"remove": []}),
    ("/trajectory/send", {"points": []}),
    ("/admin/reload", None),
]


@pytest.mark.parametrize(("path", "body"), REST)
def test_the_token_of_an_agent_opens_no_way_around_the_tools(cell: Cell, path: str, body: Any) -> None:
    plan = cell.agent.call("plan_to_joints", joints=NEAR, speed=0.1)["plan_id"]
    if body and "plan_id" in body:
        body = {"plan_id": plan}
    answer = cell.service.post(path, json=body, headers=cell.agent.headers)
    assert answer.status_code == 403, answer.text
    assert "has the role agent" in answer.json()["detail"]


def test_a_plan_is_not_run_in_another_world(cell: Cell) -> None:
    """Plans that were fenced when they were made, and are not any more."""
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=NEAR, speed=0.1)["plan_id"]
    cell.goes_to([0.1, *HOME[1:]])
    assert "away from the start of the plan" in cell.agent.refused("execute", plan_id=plan)
    assert "there is no plan" in cell.agent.refused("execute", plan_id="0123456789abcdef")


def test_an_observer_neither_plans_nor_executes_nor_draws(cell: Cell) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=NEAR, speed=0.1)["plan_id"]
    observer = Agent(cell.service, token(cell.service, Role.OBSERVER))
    observer.call("get_state")
    for tool, arguments in (
        ("plan_to_joints", {"joints": NEAR}),
        ("plan_to_joints", {"joints": "which are not even looked at"}),
        ("preview", {"plan_id": plan}),
        ("rehearse", {"plan_id": plan}),
        ("execute", {"plan_id": plan}),
    ):
        assert "role observer" in observer.refused(tool, **arguments)


def test_without_a_token_there_is_nothing(cell: Cell) -> None:
    answer = cell.service.post("/mcp/mcp", json={"jsonrpc": "2.0", "id": 1, "method": "tools/list"})
    assert answer.status_code == 401


def test_every_call_is_in_the_audit(cell: Cell) -> None:
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=FAR, speed=0.1)["plan_id"]
    cell.agent.refused("execute", plan_id=plan)
    admin = {"authorization": f"Bearer {token(cell.service, Role.ADMIN)}"}
    entries = cell.service.ask("GET", "/audit?limit=20", headers=admin).json()["entries"]
    tried = next(entry for entry in entries if entry["what"] == "MCP execute")
    assert tried["who"].startswith("agent")
    assert tried["details"]["plan_id"] == plan
    assert "is not approved" in tried["outcome"]


def test_what_is_read_and_which_prompt_is_taken_is_in_the_audit_too(
    cell: Cell, caplog: pytest.LogCaptureFixture
) -> None:
    async def looks(client: Any) -> None:
        await client.read_resource(f"cobot://limits/{cell.service.name}")
        await client.get_prompt("move_safely", {"goal": "the table"})
        for name, arguments in (("move_safely", {"what": "anywhere"}), ("move", {"goal": "the table"})):
            with pytest.raises(
                MCPError, match=r"there is no prompt .*; valid names: move_safely\(goal\), diagnose"
            ):
                await client.get_prompt(name, arguments)
        for missing in ("cobot://limits/nobody", "cobot://nothing"):
            with pytest.raises(MCPError, match=r"nobody|nothing"):
                await client.read_resource(missing)

    cell.agent.does(looks)
    admin = {"authorization": f"Bearer {token(cell.service, Role.ADMIN)}"}
    entries = cell.service.ask("GET", "/audit?limit=20", headers=admin).json()["entries"]
    entries = [entry for entry in entries if entry["what"] in ("MCP read", "MCP prompt")]
    nothing, nobody, _, wrong, prompt, limits = entries
    assert all(entry["who"].startswith("agent") for entry in entries)
    assert (limits["what"], limits["outcome"]) == ("MCP read", "ok")
    assert limits["details"] == {"uri": f"cobot://limits/{cell.service.name}"}
    assert (prompt["what"], prompt["outcome"]) == ("MCP prompt", "ok")
    assert prompt["details"]["prompt"] == "move_safely"
    assert "the table" in prompt["details"]["arguments"]
    assert "there is no robot 'nobody'; valid names: " in nobody["outcome"]
    assert nothing["outcome"] != "ok"
    assert "there is no prompt 'move_safely' with these arguments" in wrong["outcome"]
    assert [record for record in caplog.records if record.exc_info] == []


def read_png(content: bytes) -> np.ndarray:
    """By the specification, with zlib alone."""
    file = io.BytesIO(content)
    assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    rows, shape = b"", (0, 0)
    while head := file.read(8):
        length, kind = struct.unpack(">I4s", head)
        body, (checksum,) = file.read(length), struct.unpack(">I", file.read(4))
        assert zlib.crc32(kind + body) == checksum
        if kind == b"IHDR":
            shape = struct.unpack(">II", body[:8])[::-1]
        if kind == b"IDAT":
            rows += body
    found = np.frombuffer(zlib.decompress(rows), np.uint8).reshape(shape[0], 1 + 3 * shape[1])
    assert not found[:, 0].any()
    return found[:, 1:].reshape(*shape, 3)


def test_a_client_that_leaves_in_the_middle_of_its_request_leaves_no_traceback(
    service: VirtualService, caplog: pytest.LogCaptureFixture
) -> None:
    """And one that sends its request in pieces is answered."""

    def asked(*messages: dict[str, Any]) -> list[Any]:
        sent: list[Any] = []
        coming = iter(messages)

        async def receive() -> Any:
            return next(coming, {"type": "http.disconnect"})

        async def send(message: Any) -> None:
            sent.append(message)

        headers = {"host": "localhost", "content-type": "application/json"}
        headers["accept"] = "application/json, text/event-stream"
        scope: dict[str, Any] = {
            "type": "http",
            "http_version": "1.1",
            "method": "POST",
            "scheme": "http",
            "path": "/mcp/mcp",
            "raw_path": b"/mcp/mcp",
            "root_path": "",
            "query_string": b"",
            "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
            "client": ("127.0.0.1", 4000),
            "server": ("127.0.0.1", 8007),
        }
        service.run(service.app(scope, receive, send))
        return sent

    hello = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "x", "version": "1"}}
    body = json.dumps({"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": hello}).encode()
    whole = asked(
        {"type": "http.request", "body": body[:20], "more_body": True},
        {"type": "http.request", "body": body[20:], "more_body": False},
    )
    assert whole[0]["status"] == 200, whole
    asked({"type": "http.request", "body": body[:20], "more_body": True})
    assert [record for record in caplog.records if record.exc_info] == []


def test_names_that_an_agent_makes_up_are_printable_and_short_in_the_audit(
    cell: Cell, caplog: pytest.LogCaptureFixture
) -> None:
    """Control characters, a text that turns its direction, and kilobytes. Oracle: `str.isprintable`."""
    evil = "\x1b[2J\x00\u202e" * 500

    async def asks(client: Any) -> None:
        for name, arguments in ((evil, {"goal": evil}), ("move_safely", {evil: evil})):
            with pytest.raises(MCPError, match="there is no prompt"):
                await client.get_prompt(name, arguments)

    cell.agent.does(asks)
    admin = {"authorization": f"Bearer {token(cell.service, Role.ADMIN)}"}
    entries = cell.service.ask("GET", "/audit?limit=20", headers=admin).json()["entries"]
    made_up = [entry for entry in entries if entry["what"] == "MCP prompt"][:2]
    assert len(made_up) == 2
    for entry in made_up:
        for text in (entry["outcome"], *map(str, entry["details"].values())):
            assert text.isprintable()
            assert len(text) < 1_000
    assert all(record.getMessage().isprintable() for record in caplog.records if "prompt" in record.message)
