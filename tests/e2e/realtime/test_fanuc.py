"""A CRX through FANUC's Stream Motion, against a simulated controller in another process, with its faults.

Oracles: what the controller says of its own arm, and of the commands it did not take; what REST says of the
same arm. The controller is patient, so a busy computer costs no packet; a motion that the service has stopped
because its computer was late is begun again, as its user would do.
"""

from __future__ import annotations

import re
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
from cobot_run import WAIT_S, answering
from crx_arm import POSITIONS, crx_folder
from fanuc_run import ControllerProcess, RunOverFanuc
from service_activities import followed
from streaming_client import StreamClient
from thorough import few

from cobot.config import SETTINGS_FILE

HOME = np.radians(POSITIONS["home"]).tolist()
THERE = np.radians([-20.0, 10.0, -10.0, 10.0, -60.0, 30.0]).tolist()
IO = {"DO[1]": 1, "DO[2]": 0, "DI[1]": 1}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return crx_folder(tmp_path_factory.mktemp("crx")) / SETTINGS_FILE


@pytest.fixture(scope="module")
def controller(arm: Path) -> Iterator[ControllerProcess]:
    io = [word for name, value in IO.items() for word in ("--io", f"{name}={value}")]
    options = ["--seed", "3", "--horizon", "--table", "2", "--world-z", "0.25"]
    with ControllerProcess(arm, *options, *io) as started:
        yield started


@pytest.fixture(scope="module")
def fanuc(
    controller: ControllerProcess, arm: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[RunOverFanuc]:
    ports = controller.stream_port, controller.rmi_port
    made = RunOverFanuc(tmp_path_factory.mktemp("fanuc"), arm, *ports, io=list(IO))
    with answering(made) as started:
        acknowledge(started)
        yield started


@pytest.fixture
def run(fanuc: RunOverFanuc, controller: ControllerProcess) -> RunOverFanuc:
    """With a good network, and an arm at its home position."""
    controller.ask(loss=0.0, reorder=0.0, spoil="", e_stop=False, fence=False, collision=False, mode="AUTO",
                   deaf=False, safety_scale=1.0)  # fmt: skip
    reset_until_ready(fanuc)
    move(fanuc, "named", name="home")
    return fanuc


def nothing_refused(controller: ControllerProcess) -> None:
    """The controller has found no command beyond its limits, and none that jumps."""
    told = controller.ask()
    assert not any("ST:" in alarm for alarm in told["alarms"])
    assert not any("ST:" in event for event in told["events"])
    assert max(max(row) for row in told["peaks"].values()) <= 1.01


@pytest.mark.parametrize("part", few(rest_tour.PARTS))
def test_the_rest_tour(run: RunOverFanuc, controller: ControllerProcess, part: str) -> None:
    """With a sequence and a recording."""
    rest_tour.tour(run, part)
    nothing_refused(controller)


def test_the_arm_is_where_rest_says(run: RunOverFanuc, controller: ControllerProcess) -> None:
    move(run, "joints", joints=THERE)
    np.testing.assert_allclose(run.joints(), THERE, atol=5e-3)
    np.testing.assert_allclose(controller.ask()["measured"], THERE, atol=5e-3)
    said = device(run)["status"]
    assert (said["connection"], said["operation_mode"], said["drives"]) == ("COMMANDING", "AUT", "on")
    assert said["text"] == "Stream Motion 3, RMI 9.0"


@pytest.mark.thorough
def test_a_stream_of_joints_moves_it(run: RunOverFanuc, controller: ControllerProcess) -> None:
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
def test_a_goal_of_follow_joint_trajectory_arrives(run: RunOverFanuc, controller: ControllerProcess) -> None:
    rest_tour.again(lambda: followed(run, THERE))
    np.testing.assert_allclose(controller.ask()["measured"], THERE, atol=5e-3)
    nothing_refused(controller)


def test_outputs_are_set_by_their_names(run: RunOverFanuc, controller: ControllerProcess) -> None:
    def put(name: str, value: object) -> httpx.Response:
        return httpx.put(f"{run.url}/robot/io/{name}", json={"value": value}, timeout=WAIT_S)

    assert controller.ask()["io"] == IO  # nothing has changed by itself
    for value in (True, False):
        run.until(lambda value=value: put("DO[2]", value).status_code == 200)
        assert controller.ask()["io"] == {**IO, "DO[2]": int(value)}
    assert put("DI[1]", True).status_code == 422
    controller.ask(io={"DI[1]": 0})
    run.until(lambda: [each["value"] for each in device(run)["io"]] == [True, False, False])
    controller.ask(io=IO)


@pytest.mark.thorough
@pytest.mark.parametrize("fault", ["loss", "reorder"])
def test_five_percent_of_loss_ends_no_motion(
    run: RunOverFanuc, controller: ControllerProcess, fault: str
) -> None:
    before = controller.ask(**{fault: 0.05})
    for turn in (0.5, 0.0):
        move(run, "joints", joints=[turn, *HOME[1:]])
    told = controller.ask()
    assert told["moves"] == before["moves"]
    assert (told["lost"] > before["lost"]) == (fault == "loss")
    nothing_refused(controller)


@pytest.mark.parametrize(
    ("fault", "end", "reason"),
    few(
        [
            ({"e_stop": True}, {"e_stop": False}, "an emergency stop is pressed"),
            ({"fence": True}, {"fence": False}, "the controller has an alarm"),
            ({"collision": True}, {"collision": False}, "the controller has an alarm"),
            ({"alarm": "SRVO-023 Stop error excess"}, {}, "the controller has an alarm"),
            ({"mode": "T2"}, {"mode": "AUTO"}, "the teach pendant is on"),
            ({"contact_stop": 2}, {"contact_stop": 1}, "has stopped at a contact"),
            ({"spoil": "nan"}, {"spoil": ""}, "not finite"),
            ({"spoil": "frozen"}, {"spoil": ""}, "has reported the same values in"),
            ({"loss": 1.0}, {"loss": 0.0}, "no packet from the robot"),
        ]
    ),
    ids=["emergency stop", "fence", "collision", "alarm", "mode", "contact", "nan", "frozen", "disconnect"],
)
def test_recovers_from_a_fault_in_a_motion(
    run: RunOverFanuc,
    controller: ControllerProcess,
    fault: dict[str, Any],
    end: dict[str, Any],
    reason: str,
) -> None:
    body = {"joints": THERE, "speed": 0.3}
    job = httpx.post(f"{run.url}/robot/move/joints?wait=false", json=body, timeout=WAIT_S).json()
    run.until(lambda: httpx.get(f"{run.url}/jobs/{job['id']}", timeout=WAIT_S).json()["state"] == "running")
    controller.ask(**fault)
    assert reason in faulted(run)
    controller.ask(**end)
    reset_until_ready(run)
    move(run, "joints", joints=THERE)
    np.testing.assert_allclose(controller.ask()["setpoint"], THERE, atol=2e-3)
    nothing_refused(controller)


def faulted(run: RunOverFanuc) -> str:
    """Why it is in FAULT, when it is."""

    def said() -> str:
        health = robot_health(run)
        return str(health["reason"]) if health.get("mode") == "FAULT" else ""

    reason: str = run.until(said)
    return reason


def test_the_fence_is_said_in_words(run: RunOverFanuc, controller: ControllerProcess) -> None:
    controller.ask(fence=True)
    run.until(lambda: "the fence is open: close it (SRVO-004" in device(run)["status"]["text"])
    answer = httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S)
    assert "the arm's servos are off: the fence is open: close it" in answer.text


@pytest.mark.thorough
def test_an_interface_that_is_deaf_is_said_and_a_reset_connects_again(
    run: RunOverFanuc, controller: ControllerProcess
) -> None:
    """Half open: it takes requests, and says nothing."""
    controller.ask(deaf=True)
    run.until(lambda: "does not answer a request to" in device(run)["status"]["text"])
    lost = re.compile("is not connected .*does not answer a request to .*a reset connects it")
    run.until(lambda: lost.search(device(run)["status"]["text"]))  # the reason stays
    move(run, "joints", joints=THERE)  # the stream is as good as before
    controller.ask(e_stop=True)
    faulted(run)
    controller.ask(e_stop=False)
    words = "cannot be enabled: the controller does not answer a request to"
    run.until(lambda: words in httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S).text)
    controller.ask(deaf=False, close=True)
    reset_until_ready(run)
    move(run, "joints", joints=HOME)
    nothing_refused(controller)
