"""A Franka by one changed line: the whole service and its backend, with every fault on the way.

The arm is the stand-in that the contract runs on, within rtloop; one motion is against pylibfranka and a
simulator that nobody here wrote, in another process. With COBOT_FRANKY_SIM=1 all is, with the tour of REST:
two processes that answer each other a thousand times a second want a quiet computer and some minutes.
Oracles: where the arm says that it is; the limits that Franka Robotics publishes, of each position that was
commanded. The tour of the simulated FR3 is in tests/e2e/test_fr3.py, the contract in tests/rtloop/contract.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import rest_tour
from arm_activities import robot_health
from arm_over_rest import acknowledge, reset_until_ready
from cobot_run import WAIT_S, answering
from franky_run import FrankySimulator, RunOfFranka, StandInArm
from service_activities import Goal, Servo, followed
from streaming_client import StreamClient
from thorough import few

from cobot import Mode, Robot
from cobot.errors import CobotError

WHOLE = bool(os.environ.get("COBOT_FRANKY_SIM"))


def require_franky_sim() -> None:
    pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: pip install 'cobot[franka]'")
    pytest.importorskip("franky_sim", reason="franky-sim is not installed")


if WHOLE:
    require_franky_sim()

Simulator = FrankySimulator | StandInArm
THERE = [0.4, -0.5, 0.0, -2.0, 0.0, 1.7, 0.5]


@pytest.fixture(scope="module")
def simulator() -> Iterator[Simulator]:
    with FrankySimulator() if WHOLE else StandInArm() as made:
        yield made


@pytest.fixture(scope="module")
def franka(simulator: Simulator, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunOfFranka]:
    with answering(RunOfFranka(tmp_path_factory.mktemp("franka"), simulator)) as made:
        acknowledge(made)
        yield made


@pytest.fixture
def run(franka: RunOfFranka, simulator: Simulator) -> Iterator[RunOfFranka]:
    """It can be moved, and what it was commanded kept what is published."""
    simulator.ask("")
    reset_until_ready(franka)
    yield franka
    assert max(simulator.ask("")["worst"]) < 1.0


def move(run: RunOfFranka, kind: str, **body: object) -> None:
    """A motion that arrives, begun again where the computer was late."""

    def asked() -> bool:
        answer = httpx.post(f"{run.url}/robot/move/{kind}", json={"speed": 1.0, **body}, timeout=WAIT_S)
        if answer.is_success and answer.json()["success"]:
            return True
        reset_until_ready(run)
        return False

    run.until(asked)


@pytest.mark.parametrize("part", few(rest_tour.PARTS))
def test_the_rest_tour(run: RunOfFranka, part: str) -> None:
    rest_tour.tour(run, part)


def test_a_motion_arrives_where_the_robot_says(run: RunOfFranka, simulator: Simulator) -> None:
    move(run, "named", name="home")
    move(run, "named", name="work")
    np.testing.assert_allclose(simulator.ask()["q"], run.joints(), atol=5e-3)


@pytest.mark.thorough
@pytest.mark.skipif(WHOLE, reason="all of it is against franky-sim")
def test_the_whole_service_moves_the_arm_of_franky_sim(tmp_path: Path) -> None:
    require_franky_sim()
    with FrankySimulator() as simulator, answering(RunOfFranka(tmp_path, simulator)) as run:
        acknowledge(run)
        reset_until_ready(run)
        move(run, "named", name="work")
        told = simulator.ask()
        np.testing.assert_allclose(told["q"], run.joints(), atol=5e-3)
        assert max(told["worst"]) < 1.0


@pytest.mark.thorough
def test_it_gives_way_to_a_stream_and_holds_again(run: RunOfFranka, simulator: Simulator) -> None:
    begun = simulator.ask()["q"][0]

    def turned() -> bool:
        """A session that has ended because its client was late is begun again."""
        with contextlib.suppress(CobotError), Robot(run.url, verbose=False) as robot:
            robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
            with robot.start_joint_impedance_control(30, interpolation="quintic") as control:
                home = control.get_state().q
                aim = home[0]
                for _ in range(300):
                    aim = min(aim + 0.002, begun + 0.1)  # no faster than a stream may be
                    control.set_target_joints([aim, *home[1:]])
                    if abs(control.get_state().q[0] - begun - 0.1) < 0.03:
                        return True
        reset_until_ready(run)
        return False

    run.until(turned)
    run.until(run.healthy)
    assert simulator.ask()["q"][0] - begun > 0.05
    move(run, "named", name="work")


@pytest.mark.thorough
def test_a_servo_session_moves_it(run: RunOfFranka, simulator: Simulator) -> None:
    begun = simulator.ask()["q"][0]
    serving = Servo(run)
    try:
        run.until(lambda: abs(simulator.ask()["q"][0] - begun) > 0.02)
    finally:
        serving.end()
    assert httpx.post(f"{run.url}/stop", timeout=WAIT_S).json()["success"]


def test_a_goal_of_follow_joint_trajectory_arrives(run: RunOfFranka, simulator: Simulator) -> None:
    def arrived() -> bool:
        done, _ = followed(run, THERE)
        if not done:
            reset_until_ready(run)
        return done

    run.until(arrived)
    np.testing.assert_allclose(simulator.ask()["q"], THERE, atol=5e-3)


@pytest.mark.thorough
def test_losses_end_no_motion(run: RunOfFranka, simulator: Simulator) -> None:
    """What was overtaken, or is read together with the next one, is a loss to libfranka too."""
    simulator.ask("loss")
    move(run, "named", name="work")
    (shown,) = httpx.get(f"{run.url}/robots", timeout=WAIT_S).json()
    assert shown["device"]["status"]["packets_lost"] > 0


@pytest.mark.parametrize(
    ("fault", "reason"),
    few(
        [
            ("e_stop", "User Stop"),
            ("protective_stop", "a joint harder than" if WHOLE else "a joint is beyond its limit"),
            ("nan", "not finite"),
            ("frozen", "the same values"),
            ("disconnect", "the connection to"),
        ]
    ),
)
def test_recovers_from_a_fault_in_the_middle_of_a_goal(
    run: RunOfFranka, simulator: Simulator, fault: str, reason: str
) -> None:
    goal = Goal(run)
    try:
        simulator.ask(fault)
        assert reason in run.until(lambda: why_faulted(run))
        run.until(lambda: goal.answers)
        httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S)
        assert why_faulted(run), "while it lasts"
    finally:
        goal.end()
    recovers(run, simulator)


@pytest.mark.thorough
def test_recovers_from_spoilt_values_in_the_middle_of_a_stream(
    run: RunOfFranka, simulator: Simulator
) -> None:
    with StreamClient(run.url) as client:
        client.session()
        client.target(run.joints())
        run.until(lambda: robot_health(run).get("mode") == "JOINT_IMPEDANCE")
        simulator.ask("nan")
        assert "not finite" in run.until(lambda: why_faulted(run))
        client.ended()
    recovers(run, simulator)


@pytest.mark.thorough
def test_recovers_from_a_user_stop_in_the_middle_of_a_servo_session(
    run: RunOfFranka, simulator: Simulator
) -> None:
    serving = Servo(run)
    try:
        simulator.ask("e_stop")
        assert "User Stop" in run.until(lambda: why_faulted(run))
    finally:
        serving.end()
    recovers(run, simulator)


def why_faulted(run: RunOfFranka) -> str:
    """Why it is in FAULT; "" as long as it is not."""
    health = robot_health(run)
    return str(health["reason"]) if health.get("mode") == "FAULT" else ""


def recovers(run: RunOfFranka, simulator: Simulator) -> None:
    simulator.ask("")
    reset_until_ready(run)
    move(run, "named", name="work")


def test_a_stop_stops_it_and_its_state_is_shown(run: RunOfFranka, simulator: Simulator) -> None:
    assert httpx.post(f"{run.url}/stop", timeout=WAIT_S).json()["success"]
    (shown,) = httpx.get(f"{run.url}/robots", timeout=WAIT_S).json()
    device: dict[str, Any] = shown["device"]
    assert device["backend"] == simulator.backend
    assert device["status"]["connection"] == "connected"
    assert {"impedance", "torque", "payload"} <= set(device["able"])
