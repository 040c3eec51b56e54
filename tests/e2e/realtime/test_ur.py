"""An arm of Universal Robots over RTDE, against a simulated controller in another process, with its faults.

Oracles: what the controller says of its own arm; what REST says of the same arm. The controller is patient,
so a busy computer costs no command; a motion that the service has stopped because its computer was late is
begun again, as its user would do.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import rest_tour
from arm_activities import robot_health
from arm_over_rest import acknowledge, device, move, reset_until_ready
from cobot_run import LATE, WAIT_S, answering
from service_activities import followed
from streaming_client import StreamClient
from thorough import few
from ur_arm import JOINTS, POSITIONS, ur_folder
from ur_run import ControllerProcess, RunOverUr

from cobot.config import SETTINGS_FILE

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs loopback addresses besides 127.0.0.1")
HOME = np.radians(POSITIONS["home"]).tolist()
THERE = np.radians([-10.0, -95.0, 105.0, -100.0, -80.0, 20.0]).tolist()
PUSH_N, NO_PUSH = 30.0, [0.0] * 6
NORMAL, PROTECTIVE_STOP, SAFEGUARD_STOP, EMERGENCY_STOP = 1, 3, 5, 7


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ur_folder(tmp_path_factory.mktemp("arm")) / SETTINGS_FILE


@pytest.fixture(scope="module")
def controller(arm: Path) -> Iterator[ControllerProcess]:
    with ControllerProcess(arm) as started:
        yield started


@pytest.fixture(scope="module")
def ur(
    controller: ControllerProcess, arm: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[RunOverUr]:
    with answering(RunOverUr(tmp_path_factory.mktemp("ur"), arm, controller.address)) as started:
        acknowledge(started)
        yield started


@pytest.fixture
def run(ur: RunOverUr, controller: ControllerProcess) -> RunOverUr:
    """With a controller that permits motion, and an arm at its home position."""
    controller.ask(
        safety=NORMAL, blocked="", remote=True, spoil="", silent=False, loss=0.0, slider=1.0, push=NO_PUSH
    )
    reset_until_ready(ur, at_least_once=False)
    move(ur, "named", name="home")
    return ur


def nothing_refused(controller: ControllerProcess) -> None:
    """The controller has found no command beyond its limits, and none that jumps."""
    told = " ".join(controller.ask()["events"])
    assert "is commanded" not in told
    assert "jumps" not in told


@pytest.mark.parametrize("part", few(rest_tour.PARTS))
def test_the_rest_tour(run: RunOverUr, controller: ControllerProcess, part: str) -> None:
    """With a sequence and a recording."""
    rest_tour.tour(run, part)
    nothing_refused(controller)


def test_the_arm_is_where_rest_says(run: RunOverUr, controller: ControllerProcess) -> None:
    move(run, "joints", joints=THERE)
    np.testing.assert_allclose(run.joints(), THERE, atol=5e-3)
    np.testing.assert_allclose(controller.ask()["measured"], THERE, atol=5e-3)
    said = device(run)["status"]
    assert (said["connection"], said["drives"], said["brakes"]) == ("connected", "on", "released")


@pytest.mark.thorough
def test_a_stream_of_joints_moves_it(run: RunOverUr, controller: ControllerProcess) -> None:
    def turned() -> bool:
        """A session that has ended because its client was late is begun again."""
        with StreamClient(run.url) as client:
            client.session()
            for step in range(300):
                client.target([HOME[0] + 0.1 - 0.1 * np.cos(0.02 * step), *HOME[1:]])
                if abs(controller.ask()["setpoint"][0] - HOME[0]) > 0.05:
                    break
                time.sleep(0.01)
            client.ended()
        return bool(abs(controller.ask()["setpoint"][0] - HOME[0]) > 0.05)

    run.until(turned)
    nothing_refused(controller)


@pytest.mark.thorough
def test_a_goal_of_follow_joint_trajectory_arrives(run: RunOverUr, controller: ControllerProcess) -> None:
    joints = [each[0] for each in JOINTS]
    rest_tour.again(lambda: followed(run, THERE, joint=joints))
    np.testing.assert_allclose(controller.ask()["measured"], THERE, atol=5e-3)
    nothing_refused(controller)


@pytest.mark.thorough
def test_five_percent_of_packages_left_out_ends_no_motion(
    run: RunOverUr, controller: ControllerProcess
) -> None:
    before = controller.ask(loss=0.05)["lost"]
    for _ in range(2):
        move(run, "joints", joints=THERE)
        move(run, "named", name="home")
    assert controller.ask(loss=0.0)["lost"] > before
    assert device(run)["status"]["safety_stop"] == ""
    nothing_refused(controller)


def test_outputs_are_set_by_name(run: RunOverUr, controller: ControllerProcess) -> None:
    def put(name: str, value: object) -> httpx.Response:
        return httpx.put(f"{run.url}/robot/io/{name}", json={"value": value}, timeout=WAIT_S)

    run.until(lambda: put("tool_out_0", True).status_code == 200)
    assert controller.ask()["digital_out"] == 1 << 16
    run.until(lambda: put("speed_slider", 50).status_code == 200)
    assert controller.ask()["slider"] == 0.5
    run.until(lambda: device(run)["status"]["speed_scaling"] == 0.5)
    assert "there is no output" in put("tool_out_2", True).json()["detail"]


@pytest.mark.parametrize(
    ("fault", "end", "words"),
    few(
        [
            ({"safety": EMERGENCY_STOP}, {"safety": NORMAL}, "emergency stop"),
            ({"safety": PROTECTIVE_STOP, "blocked": "Cannot unlock"}, {"blocked": ""}, "protective stop"),
            ({"safety": SAFEGUARD_STOP}, {"safety": NORMAL}, "safeguard stop"),
            ({"program": "stop"}, {}, "program on the controller has ended"),
            ({"power": "off"}, {}, "robot mode: off"),
            ({"spoil": "nan"}, {"spoil": ""}, "not finite"),
        ]
    ),
)
def test_faults_are_named_and_a_reset_ends_them(
    run: RunOverUr, controller: ControllerProcess, fault: dict[str, Any], end: dict[str, Any], words: str
) -> None:
    def reason() -> str:
        """That of the fault, or that the computer was late before it."""
        health = robot_health(run)
        said = str(health.get("reason", ""))
        is_late = health.get("mode") == "FAULT" and any(each in said for each in LATE)
        return said if words in said or is_late else ""

    def named() -> tuple[bool, str]:
        controller.ask(**fault)
        said = str(run.until(reason))
        controller.ask(**end)
        reset_until_ready(run, at_least_once=False)
        return words in said, said

    rest_tour.again(named)
    move(run, "joints", joints=THERE)
    nothing_refused(controller)


def guided(run: RunOverUr, controller: ControllerProcess) -> int:
    """The number of a session of freedrive in which a hand pushes the arm, by the controller's events."""

    def begun() -> Any:
        answer = httpx.post(f"{run.url}/robot/freedrive", json={"timeout_s": 60.0}, timeout=WAIT_S)
        said.append(answer.text)
        return answer.json()["session"] if answer.status_code == 200 else None

    said: list[str] = []
    begins = controller.ask()["events"].count("freedrive begins")
    found = int(run.until(begun))
    run.until(lambda: controller.ask()["events"].count("freedrive begins") > begins)
    controller.ask(push=[0.0, PUSH_N, 0.0, 0.0, 0.0, 0.0])
    run.until(lambda: np.abs(np.subtract(controller.ask()["measured"], HOME)).max() > 0.02)
    return found


def freedrive(run: RunOverUr) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{run.url}/robot/freedrive", timeout=WAIT_S).json()
    return found


def test_freedrive_lets_a_hand_move_the_arm_until_it_is_switched_off(
    run: RunOverUr, controller: ControllerProcess
) -> None:
    def switched_off() -> tuple[bool, str]:
        """A session that has ended because the computer was late is begun again."""
        guided(run, controller)
        controller.ask(push=NO_PUSH)
        answer = httpx.delete(f"{run.url}/robot/freedrive", timeout=WAIT_S).json()
        return answer["ended"] == "freedrive was switched off", str(answer)

    rest_tour.again(switched_off)
    assert controller.ask()["events"][-1] == "freedrive ends"
    rest = controller.ask()["measured"]
    np.testing.assert_allclose(run.joints(), rest, atol=5e-3)
    assert robot_health(run)["mode"] == "HOLD"
    move(run, "joints", joints=THERE)
    np.testing.assert_allclose(controller.ask()["measured"], THERE, atol=5e-3)
    nothing_refused(controller)


@pytest.mark.parametrize("process", ["rtloop", "app"])
def test_a_process_that_is_killed_ends_freedrive(
    run: RunOverUr, controller: ControllerProcess, process: str
) -> None:
    guided(run, controller)
    old = run.child(process)
    assert old is not None
    old.kill()
    run.until(lambda: controller.ask()["events"][-3:].count("freedrive ends") > 0)
    controller.ask(push=NO_PUSH)
    run.until(run.healthy)
    reset_until_ready(run, at_least_once=False)
    assert freedrive(run)["session"] is None
    move(run, "joints", joints=THERE)


def test_freedrive_that_is_not_renewed_ends(run: RunOverUr, controller: ControllerProcess) -> None:
    def ended() -> tuple[bool, str]:
        number = guided(run, controller)
        body = {"session": number, "timeout_s": 0.5}
        said = httpx.post(f"{run.url}/robot/freedrive", json=body, timeout=WAIT_S).text
        run.until(lambda: freedrive(run)["session"] is None)
        said += freedrive(run)["ended"]
        return "freedrive was not renewed for 0.5 s" in said, said

    rest_tour.again(ended)
    run.until(lambda: controller.ask()["events"][-1] == "freedrive ends")


def test_freedrive_is_refused_with_the_reason(run: RunOverUr, controller: ControllerProcess) -> None:
    """While something pulls at the arm; and with a program that Local Control has ended."""

    def begin() -> str:
        return httpx.post(f"{run.url}/robot/freedrive", json={}, timeout=WAIT_S).text

    controller.ask(push=[0.0, 0.0, -2.0 * PUSH_N, 0.0, 0.0, 0.0])
    run.until(lambda: abs(httpx.get(f"{run.url}/robot/state", timeout=WAIT_S).json()["wrench"][2]) > PUSH_N)
    assert "already feels" in begin()
    controller.ask(push=NO_PUSH, remote=False, program="stop")
    run.until(lambda: robot_health(run).get("mode") == "FAULT")
    assert "program on the controller has ended" in begin()
    run.until(lambda: "Remote Control" in httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S).text)
    controller.ask(remote=True)
    reset_until_ready(run, at_least_once=False)


def test_a_killed_rtloop_stops_the_arm_and_the_next_one_takes_over(
    run: RunOverUr, controller: ControllerProcess
) -> None:
    """The program on the controller ends by itself. The next rtloop takes over where the arm is then."""
    body = {"name": "work", "speed": 0.1}
    moving = threading.Thread(
        target=httpx.post, args=(f"{run.url}/robot/move/named",), kwargs={"json": body, "timeout": WAIT_S}
    )
    moving.start()
    run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")
    old = run.child("rtloop")
    assert old is not None
    old.kill()
    moving.join()
    run.until(lambda: "cobot: no command in time" in controller.ask()["events"])
    run.until(run.healthy)
    reset_until_ready(run, at_least_once=False)
    rest = controller.ask()["setpoint"]
    assert np.abs(np.subtract(rest, HOME)).max() < 0.3
    nothing_refused(controller)
    move(run, "joints", joints=THERE)


@pytest.fixture
def by_torques(arm: Path, tmp_path: Path) -> Iterator[tuple[RunOverUr, ControllerProcess]]:
    """The service with `torque: true`, beside a controller that has `direct_torque`."""
    with (
        ControllerProcess(arm, "--software", "5.25.1") as controller,
        answering(RunOverUr(tmp_path, arm, controller.address, period_ms=2, torque=True)) as run,
    ):
        acknowledge(run)
        yield run, controller


def test_streamed_torques_move_the_arm_and_a_killed_rtloop_brakes_it(
    by_torques: tuple[RunOverUr, ControllerProcess],
) -> None:
    run, controller = by_torques
    reset_until_ready(run, at_least_once=False)
    move(run, "named", name="home")
    assert {"torque", "impedance", "freedrive"} <= set(device(run)["able"])

    def turned(client: StreamClient) -> bool:
        """A session that has ended because its client was late is begun again."""
        client.session(stream="joint_torque")
        before = controller.ask()["measured"][0]
        for _ in range(500):
            client.number += 1
            client.send("target", sequence=client.number, torques=[8.0, 0.0, 0.0, 0.0, 0.0, 0.0])
            if controller.ask()["measured"][0] - before > 0.1:
                return True
            time.sleep(0.002)
        return False

    def moved() -> bool:
        with StreamClient(run.url) as client:
            found = turned(client)
            client.ended()
        return found

    run.until(moved)
    assert "direct torque ends" in controller.ask()["events"]
    reset_until_ready(run, at_least_once=False)
    move(run, "named", name="home")
    old = run.child("rtloop")
    assert old is not None
    with StreamClient(run.url) as client:
        run.until(lambda: turned(client))
        old.kill()
        run.until(lambda: "cobot: no command in time" in controller.ask()["events"])
    stopped = controller.ask()["measured"]
    run.until(run.healthy)
    reset_until_ready(run, at_least_once=False)
    assert np.abs(np.subtract(controller.ask()["measured"], stopped)).max() < 0.05
    nothing_refused(controller)
    move(run, "joints", joints=THERE)
