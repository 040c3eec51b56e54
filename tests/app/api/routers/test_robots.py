"""Whose endpoints a path names. Oracle: httpx as the client without a network, robots that differ, urllib.

Only the services are stand-ins: routes, names, errors and the schema are the application's.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from asgi_client import ask
from fastapi import FastAPI

from app.main import create_app
from app.services.rights.stopping import Stopped, together
from cobot.addresses import address, path_at
from cobot.config import load_settings
from cobot.ipc.device_record import DeviceReport
from cobot.robot.description import RobotDescription
from cobot.robot.device import Capabilities, DeviceStatus

ROBOTS = """
robots:
  - {name: left}
  - {name: right-2, joint_limits: slower.yaml}
"""

DEVICE = (
    "mujoco",
    DeviceReport(Capabilities(impedance=True), DeviceStatus(operation_mode="T1"), 0.5, "", drives_off=False),
)


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory, robot: RobotDescription) -> FastAPI:
    folder = tmp_path_factory.mktemp("pair")
    shipped = (Path(__file__).parents[4] / "config/joint_limits.yaml").read_text(encoding="utf-8")
    (folder / "slower.yaml").write_text(shipped.replace("2.9", "2.8"), encoding="utf-8")
    (folder / "settings.yaml").write_text(ROBOTS, encoding="utf-8")
    made = create_app(load_settings(folder / "settings.yaml"), None, "http://robot.test")
    work_only = {"work": robot.positions["work"]}
    made.state.robots = {
        "left": services("left", robot),
        "right-2": services("right-2", dataclasses.replace(robot, positions=work_only)),
    }
    made.state.services = made.state.robots["left"]
    return made


class Stopping:
    """Counts, and is at rest at once."""

    def __init__(self) -> None:
        self.calls = 0

    async def stop(self, timeout_s: float, category: int) -> Stopped:
        self.calls += 1
        return Stopped(True, "nothing was running; the arm is at rest", [], [0.0] * 7, True, 0.1)


def services(name: str, robot: RobotDescription) -> Any:
    return SimpleNamespace(
        robot=dataclasses.replace(robot, name=name),
        ownership=SimpleNamespace(stops_before=lambda _: 0),
        stopping=Stopping(),
        link=SimpleNamespace(device=lambda: DEVICE, io=lambda: None),
        positions=SimpleNamespace(all=lambda: list(robot.positions.values())),
    )


def test_the_robots_are_listed_and_the_first_is_the_default_one(app: FastAPI) -> None:
    answer = ask(app, "GET", "/robots").json()
    assert [(each["name"], each["default"], each["path"]) for each in answer] == [
        ("left", True, "/robots/left"),
        ("right-2", False, "/robots/right-2"),
    ]
    assert answer[0]["joint_names"] == [f"joint{i}" for i in range(1, 8)]
    device = answer[0]["device"]
    assert (device["backend"], device["able"], device["speed_share"]) == ("mujoco", ["impedance"], 0.5)
    assert device["status"]["operation_mode"] == "T1"


def test_a_path_without_a_name_is_about_the_default_robot_byte_for_byte(app: FastAPI) -> None:
    plain, named = ask(app, "GET", "/robot/positions"), ask(app, "GET", "/robots/left/positions")
    assert plain.content == named.content
    assert [each["name"] for each in plain.json()] == ["home", "work", "transport"]


def test_a_name_in_the_path_chooses_the_robot(app: FastAPI) -> None:
    assert [each["name"] for each in ask(app, "GET", "/robots/right-2/positions").json()] == ["work"]


@pytest.mark.parametrize(
    ("method", "path", "content"),
    [
        ("GET", "/robots/nobody/positions", {}),
        ("GET", "/robots/nobody/joint_states", {}),
        ("GET", "/robots/nobody/health", {}),
        ("POST", "/robots/nobody/stop", {}),
        ("POST", "/robots/nobody/move/joints", {"json": {"joints": [0.0] * 7}}),
        ("POST", "/robots/nobody/move/joints", {"content": b"{"}),
        ("POST", "/robots/nobody/trajectory/send", {"json": {}}),
        ("GET", "/robots/nobody/sequences/status", {}),
        ("GET", "/robots/LEFT/positions", {}),
        ("GET", "/robots/%F0%9F%A6%BE/positions", {}),
    ],
)
def test_an_unknown_name_is_not_found_and_the_valid_ones_are_listed(
    app: FastAPI, method: str, path: str, content: dict[str, Any]
) -> None:
    answer = ask(app, method, path, **content)
    assert answer.status_code == 404
    assert answer.json()["code"] == "not_found"
    assert answer.json()["detail"].startswith("there is no robot '")
    assert answer.json()["detail"].endswith("'; valid names: left, right-2")


@pytest.mark.parametrize(
    "path", ["/robots/", "/robots/left", "/robots/left/robot/positions", "/robots//pose"]
)
def test_what_is_no_endpoint_of_a_robot_is_not_found(app: FastAPI, path: str) -> None:
    assert ask(app, "GET", path).status_code in (307, 404)


def test_a_stop_with_a_name_stops_one_and_without_a_name_all(app: FastAPI) -> None:
    calls = [each.stopping for each in app.state.robots.values()]
    before = [each.calls for each in calls]
    named = ask(app, "POST", "/robots/right-2/stop").json()
    assert [each.calls for each in calls] == [before[0], before[1] + 1]
    assert named["message"] == "nothing was running; the arm is at rest"
    everything = ask(app, "POST", "/stop").json()
    assert [each.calls for each in calls] == [before[0] + 1, before[1] + 2]
    assert everything["success"]
    assert everything["message"].startswith("left: nothing was running; the arm is at rest; right-2: ")


def test_one_arm_that_does_not_rest_makes_the_stop_of_all_fail() -> None:
    good = Stopped(True, "the arm is at rest", ["motion 3"], [0.0], True, 0.1)
    bad = Stopped(False, "not at rest", [], None, False, 9.5)
    both = together({"a": good, "b": bad})
    assert (both.success, both.at_rest, both.duration_s) == (False, False, 9.5)
    assert both.stopped == ["a: motion 3"]
    assert both.message == "a: the arm is at rest; b: not at rest"
    assert together({"b": bad}) is bad


def test_the_schema_names_the_robots_and_the_limits_of_each(app: FastAPI) -> None:
    schema = app.openapi()
    operations = [each for methods in schema["paths"].values() for each in methods.values()]
    names = [operation["operationId"] for operation in operations]
    assert len(set(names)) == len(names)
    (name,) = schema["paths"]["/robots/{robot}/pose"]["get"]["parameters"]
    assert name["schema"]["enum"] == ["left", "right-2"]
    joints = schema["components"]["schemas"]["MoveJoints"]["properties"]["joints"]
    assert joints["description"].startswith("rad: left: joint1 -2.9")
    assert "; right-2: joint1 -2.8" in joints["description"]
    assert joints["prefixItems"][0]["maximum"] == pytest.approx(2.9, abs=0.1)
    assert (joints["minItems"], joints["maxItems"]) == (7, 7)


@pytest.mark.parametrize(
    ("url", "plain", "expected"),
    [
        ("http://host:1", "/robot/pose", "/robot/pose"),
        ("http://host:1", "/stop", "/stop"),
        (address("http://host:1", "a_b-1"), "/robot/pose", "/pose"),
        (address("http://host:1/", "a_b-1"), "/trajectory/send", "/trajectory/send"),
        (address("http://host:1", "a_b-1"), "/stop", "/stop"),
        ("http://robots:1", "/robot/pose", "/robot/pose"),
    ],
)
def test_a_clients_path_follows_from_the_address_that_it_was_given(
    url: str, plain: str, expected: str
) -> None:
    assert path_at(url, plain) == expected
