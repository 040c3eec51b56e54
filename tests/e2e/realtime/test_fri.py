"""The shipped iiwa through KUKA's FRI, against a simulated cabinet in another process, with its faults.

Oracles: what the cabinet says of its own arm, where it was told to be, and of the commands it did not take;
what REST says of the same arm. The cabinet is patient, so a busy computer costs no packet; a motion that the
service has stopped because its computer was late is begun again, as its user would do.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
import rest_tour
from arm_activities import HOME, Motion, robot_health
from arm_over_rest import acknowledge, device, move, reset_until_ready
from cobot_run import WAIT_S, answering
from fri_run import CabinetProcess, RunOverFri
from service_activities import Goal, Servo, followed
from streaming_client import StreamClient
from thorough import few

from cobot.launch.cli import main

THERE = [0.4, 0.3, 0.0, -1.4, 0.0, 1.4, 0.2]
PERIOD_MS = 10


@pytest.fixture(scope="module")
def cabinet() -> Iterator[CabinetProcess]:
    io = ("--io", "Tool.Open:boolean:output", "--io", "Tool.Sensor:digital:input=5")
    with CabinetProcess("--seed", "7", *io, period_ms=PERIOD_MS) as started:
        yield started


@pytest.fixture(scope="module")
def fri(cabinet: CabinetProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunOverFri]:
    with answering(RunOverFri(tmp_path_factory.mktemp("fri"), cabinet, period_ms=PERIOD_MS)) as started:
        acknowledge(started)
        yield started


@pytest.fixture
def run(fri: RunOverFri, cabinet: CabinetProcess) -> RunOverFri:
    """With a good network, and an arm at its home position."""
    cabinet.ask(loss=0.0, reorder=0.0, delay=0, spoil="", safety_stop=-1, mode="AUT")
    reset_until_ready(fri)
    move(fri, "named", name="home")
    return fri


def no_jump(cabinet: CabinetProcess) -> None:
    """Nothing was commanded that the cabinet has refused."""
    told = " ".join(cabinet.ask()["events"])
    assert "jumps" not in told
    assert "is commanded" not in told


@pytest.mark.parametrize("part", few(rest_tour.PARTS))
def test_the_rest_tour(run: RunOverFri, cabinet: CabinetProcess, part: str) -> None:
    rest_tour.tour(run, part)
    no_jump(cabinet)


def test_moves_as_any_robot_does(run: RunOverFri, cabinet: CabinetProcess) -> None:
    move(run, "joints", joints=THERE)
    np.testing.assert_allclose(run.joints(), THERE, atol=2e-3)
    told = cabinet.ask()
    np.testing.assert_allclose(told["measured"], THERE, atol=2e-3)
    assert told["state"] == "COMMANDING_ACTIVE"
    no_jump(cabinet)


def test_says_how_the_device_is(run: RunOverFri, cabinet: CabinetProcess) -> None:
    assert device(run)["backend"] == "fri"
    run.until(lambda: device(run)["status"]["connection"] == "COMMANDING_ACTIVE")
    said = device(run)["status"]
    assert (said["operation_mode"], said["drives"], said["brakes"]) == ("AUT", "on", "released")
    cabinet.ask(safety_stop=2, mode="T1")
    run.until(lambda: device(run)["status"]["safety_stop"].startswith("safety stop 2"))
    assert device(run)["status"]["operation_mode"] == "T1"


@pytest.mark.thorough
def test_its_outputs_are_set_by_name(
    run: RunOverFri, cabinet: CabinetProcess, capsys: pytest.CaptureFixture[str]
) -> None:
    def put(name: str, value: object) -> httpx.Response:
        return httpx.put(f"{run.url}/robot/io/{name}", json={"value": value}, timeout=WAIT_S)

    for value in (True, False, True):
        run.until(lambda value=value: put("Tool.Open", value).status_code == 200)
        assert cabinet.ask()["io"] == {"Tool.Open": float(value), "Tool.Sensor": 5.0}
    assert [each["value"] for each in device(run)["io"]] == [True, 5]
    assert put("Tool.Sensor", 6).status_code == 422
    assert "the device's outputs are: Tool.Open" in put("Tool.Shut", True).json()["detail"]
    cabinet.ask(io={"Tool.Sensor": 6})
    run.until(lambda: [each["value"] for each in device(run)["io"]] == [True, 6])
    capsys.readouterr()
    assert main(["state", "--url", run.url]) == 0
    assert "output Tool.Open: True\ninput Tool.Sensor: 6\n" in capsys.readouterr().out


def test_a_stop_stops_it_on_its_path(run: RunOverFri, cabinet: CabinetProcess) -> None:
    def stopped() -> tuple[bool, str]:
        motion = Motion(run)
        motion.end()  # by POST /stop
        assert isinstance(motion.answer, httpx.Response), motion.answer
        return "stopped by POST /stop" in motion.answer.text, motion.answer.text

    rest_tour.again(stopped)
    run.until(lambda: robot_health(run).get("mode") == "HOLD")
    told = cabinet.ask()

    def rests() -> bool:
        nonlocal told
        before, told = told, cabinet.ask()
        return bool(np.allclose(told["setpoint"], before["setpoint"], rtol=0.0, atol=1e-6))

    run.until(rests)
    assert told["state"] == "COMMANDING_ACTIVE"
    no_jump(cabinet)


def test_a_stream_moves_it(run: RunOverFri, cabinet: CabinetProcess) -> None:
    def turned() -> bool:
        """A session that has ended because its client was late is begun again."""
        with StreamClient(run.url) as client:
            client.session()
            for step in range(300):
                client.target([0.1 - 0.1 * np.cos(0.02 * step), *HOME[1:]])
                if abs(cabinet.ask()["setpoint"][0]) > 0.05:
                    break
                time.sleep(0.01)
            client.ended()
        return bool(abs(cabinet.ask()["setpoint"][0]) > 0.05)

    run.until(turned)
    no_jump(cabinet)


@pytest.mark.thorough
def test_a_servo_session_moves_it(run: RunOverFri, cabinet: CabinetProcess) -> None:
    serving = Servo(run)
    try:
        run.until(lambda: abs(cabinet.ask()["setpoint"][0]) > 0.02)
    finally:
        serving.end()
    httpx.post(f"{run.url}/stop", timeout=WAIT_S).raise_for_status()
    no_jump(cabinet)


def test_a_goal_of_follow_joint_trajectory_arrives(run: RunOverFri, cabinet: CabinetProcess) -> None:
    rest_tour.again(lambda: followed(run, THERE))
    np.testing.assert_allclose(cabinet.ask()["measured"], THERE, atol=2e-3)
    no_jump(cabinet)


@pytest.mark.thorough
@pytest.mark.parametrize("fault", ["loss", "reorder"])
def test_five_percent_of_loss_ends_no_motion(run: RunOverFri, cabinet: CabinetProcess, fault: str) -> None:
    """In each direction; what a window of a hundred answers makes of it is GOOD but once in 200,000."""
    before = cabinet.ask(**{fault: 0.05})
    for turn in (0.5, 0.0):
        move(run, "joints", joints=[turn, *HOME[1:]])
    told = cabinet.ask()
    assert told["motions"] == before["motions"]
    assert (told["lost"] > before["lost"]) == (fault == "loss")
    no_jump(cabinet)


@pytest.mark.parametrize(
    ("fault", "end", "reason"),
    few(
        [
            ({"safety_stop": 0}, {"safety_stop": -1}, "safety stop 0"),
            ({"safety_stop": 1}, {"safety_stop": -1}, "safety stop 1"),
            ({"spoil": "nan"}, {"spoil": ""}, "not finite"),
            ({"spoil": "frozen"}, {"spoil": ""}, "has reported the same values in"),
            ({"loss": 1.0}, {"loss": 0.0}, "no packet from the robot, which clocks the cycle, for"),
            ({"mode": "T2"}, {"mode": "AUT"}, "the robot accepts no commands"),
            ({"close": True}, {}, "the robot accepts no commands"),
        ]
    ),
    ids=["emergency stop", "protective stop", "nan", "frozen", "disconnect", "mode", "session"],
)
def test_recovers_from_a_fault_in_the_middle_of_a_goal(
    run: RunOverFri, cabinet: CabinetProcess, fault: dict[str, Any], end: dict[str, Any], reason: str
) -> None:
    goal = Goal(run)
    try:
        cabinet.ask(**fault)
        assert reason in faulted(run)
        run.until(lambda: goal.answers)
    finally:
        goal.end()
    recovers(run, cabinet, end)


def faulted(run: RunOverFri) -> str:
    """Why it is in FAULT, when it is."""

    def said() -> str:
        health = robot_health(run)
        return str(health["reason"]) if health.get("mode") == "FAULT" else ""

    reason: str = run.until(said)
    return reason


def recovers(run: RunOverFri, cabinet: CabinetProcess, end: dict[str, Any]) -> None:
    """What has ended a fault lets the arm be moved after a reset, without a jump."""
    cabinet.ask(**end)
    run.until(lambda: cabinet.ask()["quality"] == "EXCELLENT")
    reset_until_ready(run)
    move(run, "joints", joints=THERE)
    no_jump(cabinet)


@pytest.mark.thorough
def test_recovers_from_spoilt_values_in_the_middle_of_a_stream(
    run: RunOverFri, cabinet: CabinetProcess
) -> None:
    with StreamClient(run.url) as client:
        client.session()
        client.target(HOME)
        run.until(lambda: robot_health(run).get("mode") == "JOINT_IMPEDANCE")
        cabinet.ask(spoil="nan")
        assert "not finite" in faulted(run)
        client.ended()
    recovers(run, cabinet, {"spoil": ""})


@pytest.mark.thorough
def test_recovers_from_a_safety_stop_in_the_middle_of_a_servo_session(
    run: RunOverFri, cabinet: CabinetProcess
) -> None:
    serving = Servo(run)
    try:
        run.until(lambda: abs(cabinet.ask()["setpoint"][0]) > 0.02)
        cabinet.ask(safety_stop=1)
        assert "safety stop 1" in faulted(run)
    finally:
        serving.end()
    recovers(run, cabinet, {"safety_stop": -1})
