"""A KR over RSI, made by `cobot new-robot`, against a simulated controller in another process.

Oracles: what the controller says of its own arm, and of the answers that it did not take; what REST says of
the same arm; the client of RSIPI, which is not ours, against the same controller.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import rest_tour
import yaml
from arm_activities import robot_health
from arm_over_rest import acknowledge, device, move, reset_until_ready
from cobot_run import WAIT_S, answering, until
from rsi_run import HOME, WORK, RsiProcess, RunOverRsi, free_udp_port, kr10
from service_activities import followed
from streaming_client import StreamClient
from thorough import few

from rtloop.contract.__main__ import main as backend_command


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return kr10(tmp_path_factory.mktemp("rsi"), free_udp_port())


@pytest.fixture(scope="module")
def controller(folder: Path) -> Iterator[RsiProcess]:
    settings = yaml.safe_load((folder / "cobot-setting.yaml").read_text())
    with RsiProcess(folder, settings["robot"]["backend"]["port"], "--in-a-row", "--seed", "7") as started:
        yield started


@pytest.fixture(scope="module")
def service(controller: RsiProcess, folder: Path) -> Iterator[RunOverRsi]:
    with answering(RunOverRsi(folder)) as started:
        acknowledge(started)
        yield started


@pytest.fixture
def run(service: RunOverRsi, controller: RsiProcess) -> RunOverRsi:
    """With a good network, and an arm at its home position."""
    controller.ask(loss=0.0, reorder=0.0, delay=0, spoil="", estop=False, mode="AUT", override=100, runs=True)
    reset_until_ready(service)
    move(service, "named", name="home")
    return service


def took_everything(controller: RsiProcess) -> None:
    """No answer was refused, and none moved the arm beyond its limits."""
    told = controller.ask()
    events = " ".join(told["events"])
    assert told["malformed"] == 0
    assert "is commanded" not in events
    assert "jumps" not in events
    assert "reached its limit" not in events


@pytest.mark.parametrize("part", few(rest_tour.PARTS))
def test_the_rest_tour(run: RunOverRsi, controller: RsiProcess, part: str) -> None:
    rest_tour.tour(run, part)
    took_everything(controller)


def test_the_controller_agrees_where_its_arm_is(run: RunOverRsi, controller: RsiProcess) -> None:
    move(run, "joints", joints=WORK)
    told = controller.ask()
    np.testing.assert_allclose(told["measured"], WORK, atol=2e-3)
    reference = np.array(told["setpoint"]) - np.radians(told["correction"])
    np.testing.assert_allclose(reference, HOME, atol=2e-3)
    said = device(run)
    assert (said["backend"], said["status"]["operation_mode"], said["status"]["drives"]) == (
        "rsi",
        "AUT",
        "on",
    )


def test_a_sequence_grasps_and_releases_by_its_outputs(run: RunOverRsi, controller: RsiProcess) -> None:
    """A gripper at two outputs; the part keeps the fingers from closing, which an input would report."""
    steps: list[dict[str, Any]] = [
        {"gripper": {"command": "release"}},
        {"named": "work", "speed": 1.0},
        {"gripper": {"command": "grasp"}},
        {"named": "home", "speed": 1.0},
    ]
    body = {"config": ("grasp.json", json.dumps({"steps": steps}))}

    def ran() -> tuple[bool, str]:
        answer = httpx.post(
            f"{run.url}/sequences/start", files=body, data={"n_iterations": "1"}, timeout=WAIT_S
        )
        answer.raise_for_status()
        ended = run.until(
            lambda: (
                found
                if (found := httpx.get(f"{run.url}/sequences/status").json())["status"] == "finished"
                else None
            )
        )
        lines = httpx.get(f"{run.url}/sequences/logs?n=50").json()["lines"]
        return ended["returncode"] == 0, str(lines)

    rest_tour.again(ran)
    assert controller.ask()["io"] == {"closed": False, "close": True, "open": False}
    gripper = httpx.get(f"{run.url}/robot/gripper", timeout=WAIT_S).raise_for_status().json()
    assert gripper["state"]["object"] == "held_inside"
    took_everything(controller)


@pytest.mark.thorough
def test_a_stream_moves_it(run: RunOverRsi, controller: RsiProcess) -> None:
    def turned() -> bool:
        with StreamClient(run.url) as client:
            client.session()
            for step in range(300):
                client.target([0.1 - 0.1 * np.cos(0.02 * step), *HOME[1:]])
                if abs(controller.ask()["setpoint"][0]) > 0.05:
                    break
                time.sleep(0.01)
            client.ended()
        return bool(abs(controller.ask()["setpoint"][0]) > 0.05)

    run.until(turned)
    took_everything(controller)


@pytest.mark.thorough
def test_a_goal_of_follow_joint_trajectory_arrives(run: RunOverRsi, controller: RsiProcess) -> None:
    rest_tour.again(lambda: followed(run, WORK, joint="joint_a"))
    np.testing.assert_allclose(controller.ask()["measured"], WORK, atol=2e-3)
    took_everything(controller)


@pytest.mark.thorough
def test_a_recording_has_the_motion(run: RunOverRsi) -> None:
    move(run, "named", name="work")
    made = httpx.post(
        f"{run.url}/recordings", json={"action": "dump", "seconds": 0.5}, timeout=WAIT_S
    ).raise_for_status()
    (name,) = made.json()["names"]
    listed = httpx.get(f"{run.url}/recordings", timeout=WAIT_S).json()["recordings"]
    assert name in [each["name"] for each in listed]


@pytest.mark.thorough
@pytest.mark.parametrize("fault", ["loss", "reorder"])
def test_five_percent_of_loss_ends_no_motion(run: RunOverRsi, controller: RsiProcess, fault: str) -> None:
    before = controller.ask(**{fault: 0.05})
    for joints in (WORK, HOME):
        move(run, "joints", joints=joints, speed=0.3)
    told = controller.ask()
    assert told["sessions"] == before["sessions"]
    assert (told["lost"] > before["lost"]) == (fault == "loss")
    took_everything(controller)


@pytest.mark.parametrize(
    ("fault", "end", "reason"),
    few(
        [
            ({"estop": True}, {"estop": False}, "RSI has ended (enabling switch released, emergency stop"),
            (
                {"spoil": "nan"},
                {"spoil": ""},
                "the last one was rejected: AIPos.A1 is 'nan', which is not a finite number",
            ),
            ({"spoil": "frozen"}, {"spoil": ""}, "has reported the same values in"),
            ({"loss": 1.0}, {"loss": 0.0}, "no packet from the robot controller for"),
            ({"mode": "T2"}, {"mode": "AUT"}, "the controller's program has started RSI again"),
            ({"off": True}, {}, "the controller's program has started RSI again"),
        ]
    ),
    ids=["emergency stop", "nan", "frozen", "disconnect", "mode", "program"],
)
def test_recovers_from_a_fault_in_the_middle_of_a_motion(
    run: RunOverRsi, controller: RsiProcess, fault: dict[str, Any], end: dict[str, Any], reason: str
) -> None:
    body = {"joints": [-0.9, -1.0, 1.2, 0.1, 1.0, 0.3], "speed": 0.3}
    motion = threading.Thread(
        target=httpx.post, args=(f"{run.url}/robot/move/joints",), kwargs={"json": body, "timeout": WAIT_S}
    )
    motion.start()
    try:
        run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")
        controller.ask(**fault)

        def said() -> str:
            health = robot_health(run)
            return str(health["reason"]) if health.get("mode") == "FAULT" else ""

        assert reason in run.until(said)
    finally:
        motion.join()
    controller.ask(**end)
    before = controller.ask()["answered"]
    run.until(lambda: controller.ask()["answered"] > before + 20)
    reset_until_ready(run)
    move(run, "joints", joints=WORK)
    told = controller.ask()
    np.testing.assert_allclose(told["measured"], WORK, atol=2e-3)
    assert "jumps" not in " ".join(told["events"])


def test_the_program_override_slows_motions_down(run: RunOverRsi, controller: RsiProcess) -> None:
    controller.ask(override=30)
    run.until(lambda: device(run)["status"]["speed_scaling"] == pytest.approx(0.3))
    assert "program override 30 %" in device(run)["status"]["text"]


@pytest.mark.thorough
def test_the_client_of_rsipi_moves_the_simulated_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both read the Ethernet configuration that cobot writes."""
    pytest.importorskip("RSIPI", reason="rsipi is not installed: see requirements/peers.lock")
    monkeypatch.chdir(tmp_path)
    from RSIPI import RSIAPI

    port = free_udp_port()
    made = kr10(tmp_path, port, 4, axis_tag="AKorr", sen_type="ImFree")
    config = made / "cobot-setting.yaml"
    assert backend_command(["files", "rsi", str(tmp_path / "files"), "--config", str(config)]) == 0
    ethernet = tmp_path / "files" / "SensorInterface" / "cobot_rsi_ethernet.xml"
    with (
        RsiProcess(made, port, "--in-a-row") as controller,
        RSIAPI(str(ethernet), rsi_mode="absolute", max_joint_rate=0.03) as client,
    ):
        client.start()
        until(lambda: controller.ask()["answered"] > 50)
        client.motion.update_joints(A1=2.0, A3=-1.0)
        until(lambda: abs(controller.ask()["correction"][0] - 2.0) < 1e-6)
        told = controller.ask()
        assert told["malformed"] == 0
        np.testing.assert_allclose(told["correction"], [2.0, 0, -1.0, 0, 0, 0], atol=1e-6)
        assert np.degrees(told["setpoint"][0]) == pytest.approx(2.0, abs=1e-3)
        until(lambda: abs(client.client.send_variables.get("ASPos")["A1"] - 2.0) < 1e-3)
