"""Inputs and outputs by name over REST. Oracle: the arm, which keeps what its outputs were told."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
from panel_arm import PanelArm
from rig import Rig
from virtual_service import VirtualService, virtual_service

from cobot.config import Settings
from cobot.robot.description import RobotDescription

CLOSE, FORCE, SPEED, PART = "Gripper.Close", "Gripper.Force", "Belt.Speed", "Part.There"


class ServiceOfArm(VirtualService):
    """With an arm that has inputs and outputs."""

    arm: PanelArm

    def _rig(self, settings: Settings, robot: RobotDescription, capacity: int, several: bool) -> Rig:
        self.arm = PanelArm(settings, robot.limits)
        return self._rig_with(self.arm, "panel_arm", settings, robot, capacity)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfArm]:
    with ServiceOfArm(tmp_path_factory.mktemp("io")).serving() as made:
        assert isinstance(made, ServiceOfArm)
        yield made


@pytest.fixture
def run(service: ServiceOfArm) -> ServiceOfArm:
    service.arm.deaf, service.arm.refuses = False, ""
    return service


def put(run: VirtualService, name: str, value: object) -> tuple[int, dict[str, object]]:
    answer = run.ask("PUT", f"/robot/io/{name}", json={"value": value})
    return answer.status_code, answer.json()


def test_all_of_them_are_shown_with_their_kinds(run: ServiceOfArm) -> None:
    shown = run.get("/robot/io").json()
    assert (shown["backend"], shown["supported"]) == ("panel_arm", True)
    assert [(each["name"], each["kind"], each["direction"]) for each in shown["points"]] == [
        (CLOSE, "boolean", "output"),
        (FORCE, "analog", "output"),
        (SPEED, "digital", "output"),
        (PART, "boolean", "input"),
        ("Lamp.Green", "boolean", "output"),
        ("Lamp.Red", "boolean", "output"),
    ]
    assert run.get("/robots").json()[0]["device"]["io"] == shown["points"]
    assert run.get(f"/robots/{run.name}/robot/io".replace("/robot/io", "/io")).json() == shown


@pytest.mark.parametrize(
    ("name", "value"), [(CLOSE, True), (CLOSE, False), (SPEED, 250), (FORCE, -0.5), (FORCE, 2)]
)
def test_an_output_is_set_when_the_device_has_reported_it(run: ServiceOfArm, name: str, value: float) -> None:
    status, answer = put(run, name, value)
    assert status == 200, answer
    assert (answer["name"], answer["value"], answer["direction"]) == (name, value, "output")
    assert run.arm._io[name].value == float(value)
    point = next(each for each in run.get("/robot/io").json()["points"] if each["name"] == name)
    assert point["value"] == value
    assert type(point["value"]) is (float if name == FORCE else type(value))
    client = run.client(run.url)
    assert [each["value"] for each in client.io() if each["name"] == name] == [value]


def test_the_python_client_sets_one_while_the_arm_moves(run: ServiceOfArm) -> None:
    run.go_home()
    motion = run.begin(run.asking("POST", "/robot/move/named", json={"name": "work", "speed": 0.3}))
    run.until(lambda: run.health()["robot"]["mode"] == "TRAJECTORY")
    assert put(run, CLOSE, True)[0] == 200
    assert run.health()["robot"]["mode"] == "TRAJECTORY"
    assert run.end(motion).json()["success"]
    assert run.client(run.url).set_output(CLOSE, False)["value"] is False


@pytest.mark.parametrize(
    ("name", "value", "status", "code", "text"),
    [
        ("Gripper.Shut", True, 404, "not_found", f"outputs are: {CLOSE}, {FORCE}, {SPEED}"),
        (PART, False, 422, "input", "is an input, which only the device sets; name an output"),
        (CLOSE, 1, 422, "input", "boolean: the value must be true or false, got 1"),
        (SPEED, True, 422, "input", "digital: the value must be a number, got true"),
        (SPEED, 1.5, 422, "input", "a whole number, got 1.5"),
        (SPEED, -1, 422, "limit", "a whole number from 0 to 9007199254740991, got -1"),
        (SPEED, 2**53, 422, "limit", "a whole number from 0 to 9007199254740991"),
        (FORCE, 10**400, 422, "", ""),
        (FORCE, "2.5", 422, "", "value"),
        (FORCE, None, 422, "", "value"),
        (FORCE, [1], 422, "", "value"),
    ],
)
def test_what_cannot_be_set_is_refused_by_name(
    run: ServiceOfArm, name: str, value: object, status: int, code: str, text: str
) -> None:
    before = dict(run.arm._io)
    found, answer = put(run, name, value)
    assert (found, text in str(answer["detail"])) == (status, True), answer
    assert code in ("", answer["code"])
    assert run.arm._io == before


@pytest.mark.parametrize("body", [b"", b"{}", b'{"value": NaN}', b'{"value": true, "force": 1}', b"[]"])
def test_a_body_that_says_something_else_is_refused(run: ServiceOfArm, body: bytes) -> None:
    answer = run.ask("PUT", f"/robot/io/{CLOSE}", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422, answer.text


def test_one_that_the_device_does_not_report_is_not_set(run: ServiceOfArm) -> None:
    run.arm.deaf = True
    status, answer = put(run, SPEED, 77)
    assert (status, answer["code"]) == (504, "device_timeout")
    assert "has not reported 77 within 1.5 s; it reports " in str(answer["detail"])


def test_a_value_that_is_no_number_is_shown_as_none(run: ServiceOfArm) -> None:
    """As a device may report one; JSON has no word for it."""
    before = run.arm._io[FORCE]
    run.arm._io[FORCE] = replace(before, value=math.nan)
    try:
        run.sleep(1.0)
        points = run.get("/robot/io").json()["points"]
        assert [each["value"] for each in points if each["name"] == FORCE] == [None]
        assert run.get("/robots").status_code == 200
    finally:
        run.arm._io[FORCE] = before
        run.sleep(1.0)


def test_a_boolean_that_is_not_reported_is_said_in_its_own_words(run: ServiceOfArm) -> None:
    put(run, CLOSE, False)
    run.arm.deaf = True
    assert "has not reported true within 1.5 s; it reports false" in str(put(run, CLOSE, True)[1]["detail"])


def test_one_that_the_device_refuses_is_said_with_its_reason(run: ServiceOfArm) -> None:
    run.arm.refuses = "the valve has no air"
    status, answer = put(run, CLOSE, True)
    assert (status, answer["code"], answer["detail"]) == (502, "device", "the valve has no air")


def test_who_has_not_the_control_sets_nothing(run: ServiceOfArm) -> None:
    taken = run.post("/robot/control", {"timeout_s": 60.0}).json()
    token = {"X-Control-Token": taken["token"]}
    assert put(run, CLOSE, True)[0] == 409
    held = run.ask("PUT", f"/robot/io/{CLOSE}", json={"value": True}, headers=token)
    assert held.status_code == 200
    run.ask("DELETE", "/robot/control", headers=token).raise_for_status()


def test_it_stands_in_the_audit_with_its_value(run: ServiceOfArm) -> None:
    assert put(run, FORCE, 1.25)[0] == 200
    newest = run.get("/audit?limit=1").json()["entries"][0]
    assert newest["what"] == f"PUT /robot/io/{FORCE}"
    assert (newest["details"]["value"], newest["outcome"]) == (1.25, "200")


def test_a_backend_without_them_says_so_by_its_name(tmp_path_factory: pytest.TempPathFactory) -> None:
    with virtual_service(tmp_path_factory.mktemp("none")) as run:
        shown = run.get("/robot/io").json()
        assert shown == {"backend": "mujoco", "supported": False, "points": []}
        status, answer = put(run, CLOSE, True)
        assert (status, answer["code"]) == (404, "not_found")
        assert answer["detail"] == (
            f"there is no output {CLOSE!r}, because the backend mujoco has no inputs and outputs"
        )
