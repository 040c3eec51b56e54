"""Agents and the gripper: planned, approved, run and stopped.

Oracles: the official client of the Model Context Protocol, and a toy, whose fingers stop at its part.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jsonschema_rs
import pytest
from mcp_agent import FENCE, HOME, NEAR, Agent, Cell
from virtual_service import VirtualService

from cobot.grippers.contract.toy import DEVICES, STROKE_M, ToyDevice

PART_M = 0.04
TOY = "gripper: {type: 'cobot.grippers.contract.toy:ToyGripper'}"


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """Tokens are needed, and agents have a fence."""
    folder = tmp_path_factory.mktemp("gripper")
    more = f"web: {{authentication: required, tokens: {folder / 'tokens.json'}}}\n{FENCE}"
    service = VirtualService(folder, more=more, of_robot=TOY)
    DEVICES["toy"] = ToyDevice(service.clock.now_s)
    with service.serving():
        yield Cell(service)


@pytest.fixture
def cell(started: Cell) -> Cell:
    """The arm is at home, and the fingers are open."""
    DEVICES["toy"].object_m = None
    started.goes_to(HOME)
    assert started.asks("/robot/gripper/release", {})["success"]
    return started


def run_approved(cell: Cell, tool: str, **arguments: Any) -> Any:
    plan = cell.agent.call(tool, **arguments)["plan_id"]
    assert cell.asks("/robot/approve", {"plan_id": plan})["approved_by"].startswith("operator")
    return cell.agent.call("execute", plan_id=plan)


def test_a_plan_moves_no_finger_until_an_operator_has_approved_it(cell: Cell) -> None:
    plan = cell.agent.call("plan_gripper_move", width=0.02)
    assert plan["signals"] == ["gripper move, width 0.02 m"]
    refused = cell.agent.refused("execute", plan_id=plan["plan_id"])
    assert (
        "it does more than move the arm (gripper move, width 0.02 m), but the fence permits only motions"
        in refused
    )
    assert DEVICES["toy"].target_m == STROKE_M
    cell.asks("/robot/approve", {"plan_id": plan["plan_id"]})
    answer = cell.agent.call("execute", plan_id=plan["plan_id"])
    assert answer["success"], answer
    assert answer["gripper"]["state"]["width"] == pytest.approx(0.02)
    assert "is not approved" in cell.agent.refused("execute", plan_id=plan["plan_id"]), "it is for one run"


def test_an_agent_grasps_and_releases(cell: Cell) -> None:
    DEVICES["toy"].object_m = PART_M
    answer = run_approved(cell, "plan_gripper_grasp", width=PART_M, force=20.0)
    assert (answer["success"], answer["gripper"]["state"]["object"]) == (True, "held_inside")
    assert DEVICES["toy"].force_n == 20.0
    assert cell.agent.call("get_gripper")["state"]["object"] == "held_inside"
    answer = run_approved(cell, "plan_gripper_release", width=0.09)
    assert (answer["success"], answer["gripper"]["state"]["object"]) == (True, "none")
    assert run_approved(cell, "plan_gripper_home")["gripper"]["state"]["width"] == STROKE_M


def test_a_grasp_of_nothing_is_told(cell: Cell) -> None:
    answer = run_approved(cell, "plan_gripper_grasp", width=PART_M)
    assert not answer["success"]
    assert "the gripper has closed on nothing" in answer["error"]


def test_a_plan_counts_where_the_arm_was_when_it_was_made(cell: Cell) -> None:
    """An approved release must not drop the part somewhere else."""
    plan = cell.agent.call("plan_gripper_release")["plan_id"]
    cell.asks("/robot/approve", {"plan_id": plan})
    cell.goes_to(NEAR)
    assert "away from the start of the plan" in cell.agent.refused("execute", plan_id=plan)


def test_an_agent_does_not_command_the_gripper_of_another_client_s_robot(cell: Cell) -> None:
    plan = cell.agent.call("plan_gripper_move", width=0.02)["plan_id"]
    cell.asks("/robot/approve", {"plan_id": plan})
    held = cell.asks("/robot/control", {"timeout_s": 60.0})["token"]
    assert "control" in cell.agent.refused("execute", plan_id=plan)
    headers = cell.operator | {"x-control-token": held}
    cell.service.ask("DELETE", "/robot/control", headers=headers).raise_for_status()
    assert DEVICES["toy"].target_m == STROKE_M


def test_an_agent_stops_the_fingers_of_any_client(cell: Cell) -> None:
    service = cell.service
    request = service.asking(
        "POST", "/robot/gripper/move", json={"width": 0.0, "speed": 0.02}, headers=cell.operator
    )
    moving = service.begin(request)
    service.sleep(0.5)
    assert cell.agent.call("stop_gripper")["state"]["width"] > 0.05
    assert "stopped by" in service.end(moving).json()["message"]


def test_a_plan_of_the_gripper_is_listed_rehearsed_and_drawn_but_not_queued(cell: Cell) -> None:
    plan = cell.agent.call("plan_gripper_grasp", width=PART_M)["plan_id"]
    (listed,) = (each for each in cell.agent.call("list_plans")["plans"] if each["plan_id"] == plan)
    assert listed["signals"] == ["gripper grasp, width 0.04 m"]
    assert cell.agent.call("rehearse", plan_id=plan)["runs_through"]
    drawn = cell.agent.does(lambda client: client.call_tool("preview", {"plan_id": plan}))
    assert drawn.content[0].mime_type == "image/png"
    queued = cell.service.post("/robot/execute?queue=true", json={"plan_id": plan}, headers=cell.operator)
    assert (queued.status_code, "which cannot be queued" in queued.text) == (422, True), queued.text


REFUSED: list[tuple[str, dict[str, Any], str]] = [
    ("plan_gripper_move", {"width": 0.2}, "width is 0.2 m, but the gripper"),
    ("plan_gripper_move", {"width": 0.02, "force": 500.0}, "force is 500 N"),
    ("plan_gripper_move", {}, "plan_gripper_move: width: is missing"),
    ("plan_gripper_grasp", {"widht": 0.02}, "unknown key 'widht' (did you mean 'width'?)"),
    ("plan_gripper_grasp", {"if_missed": "ignore"}, "if_missed: must be"),
    ("plan_gripper_release", {"width": "0.02"}, "width: must be a number, got '0.02'"),
    ("plan_gripper_home", {"width": 0.02}, "unknown key 'width'"),
]


@pytest.mark.parametrize(("tool", "arguments", "words"), REFUSED)
def test_what_is_wrong_is_told_when_it_is_planned(
    cell: Cell, tool: str, arguments: dict[str, Any], words: str
) -> None:
    assert words in cell.agent.refused(tool, **arguments)


CALLS: list[tuple[str, dict[str, Any]]] = [
    ("plan_gripper_move", {"width": 0.05}),
    ("plan_gripper_move", {"width": -0.01}),
    ("plan_gripper_move", {"width": 0.05, "speed": 0.0}),
    ("plan_gripper_grasp", {}),
    ("plan_gripper_grasp", {"width": None, "tolerance_outer": 1.5}),
    ("plan_gripper_grasp", {"if_missed": "success"}),
    ("plan_gripper_release", {"width": None}),
    ("plan_gripper_release", {"speed": 0.1}),
    ("plan_gripper_home", {}),
    ("get_gripper", {"what": 1}),
]


@pytest.mark.parametrize(("tool", "arguments"), CALLS)
def test_a_call_is_taken_exactly_if_the_published_schema_permits_it(
    cell: Cell, tool: str, arguments: dict[str, Any]
) -> None:
    """Oracle: a second implementation of JSON Schema."""
    tools = cell.agent.does(lambda client: client.list_tools()).tools
    schema = next(each.input_schema for each in tools if each.name == tool)
    answer = cell.agent.does(lambda client: client.call_tool(tool, arguments))
    assert answer.is_error is not jsonschema_rs.validator_for(schema).is_valid(arguments), answer


def test_a_plan_over_rest_names_the_field_that_is_wrong(cell: Cell) -> None:
    for body, words in (
        ({"gripper": {"command": "squeeze"}}, "gripper.command: must be one of move, grasp, release, home"),
        ({"gripper": {"command": "grasp", "width": "wide"}}, "gripper.width: must be a number, got 'wide'"),
        ({"gripper": {"width": 0.02}}, "gripper.command: must be one of"),
    ):
        answer = cell.service.post("/robot/plan/gripper", json=body, headers=cell.agent.headers)
        assert (answer.status_code, words in answer.text) == (422, True), answer.text


def test_without_a_gripper_there_is_nothing_to_plan(service: VirtualService) -> None:
    assert "this robot has no gripper" in Agent(service).refused("plan_gripper_move", width=0.02)
