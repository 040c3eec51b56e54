"""The simulated FANUC controller with a client that nobody here wrote, in another process.

Oracle: the driver of airo-fanuc, which drives a real CRX: its bring-up, motion and recovery need every packet
and reply to be as it knows them. A busy computer may be late for a packet; then it recovers, as it would.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S
from crx_arm import POSITIONS, crx_folder
from fanuc_run import ControllerProcess

from cobot.config import SETTINGS_FILE

pytestmark = pytest.mark.thorough

airo = pytest.importorskip("airo_fanuc", reason="airo-fanuc is not installed")
HOME = np.radians(POSITIONS["home"])
THERE = HOME + np.radians([10.0, 0.0, 5.0, 0.0, 0.0, -20.0])
SPEED = np.radians(20.0)
ARRIVES_S, ARRIVED_RAD = 10.0, 1e-3


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControllerProcess]:
    arm = crx_folder(tmp_path_factory.mktemp("crx")) / SETTINGS_FILE
    with ControllerProcess(arm, patience_s=0.2) as started:
        yield started


@pytest.fixture
def driver(controller: ControllerProcess) -> Iterator[Any]:
    profile = airo.RobotProfile.from_degrees(
        name="crx",
        model="simulated",
        velocity_limits_deg_s=[120.0, 120.0, 180.0, 180.0, 180.0, 180.0],
        acceleration_limits_deg_s2=[240.0, 240.0, 360.0, 360.0, 360.0, 360.0],
        jerk_limits_deg_s3=[960.0, 960.0, 1440.0, 1440.0, 1440.0, 1440.0],
        position_limits_lower_deg=[-179.0, -99.0, -129.0, -189.0, -119.0, -189.0],
        position_limits_upper_deg=[179.0, 99.0, 129.0, 189.0, 119.0, 189.0],
    )
    config = airo.DriverConfig(profile=profile, sm_port=controller.stream_port, rmi_port=controller.rmi_port)
    policy = airo.DriverPolicy(
        config=config, enable_gripper=False, enable_ownership=False, recovery_cooldown_s=0.5
    )
    started = airo.FanucDriver("127.0.0.1", policy)
    try:
        yield started
    finally:
        started.close()


def until(condition: Callable[[], Any]) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline_s, "did not happen"
        time.sleep(0.02)


def moved(driver: Any, goal: Any) -> bool:
    """Whether a motion arrives within some seconds; one that was too late is begun again."""
    try:
        driver.arm()
        driver.move_j(goal, joint_speed=SPEED)
    except Exception:  # noqa: BLE001 - its own classes; what counts is where the arm is
        return False
    deadline_s = time.monotonic() + ARRIVES_S
    while np.abs(driver.get_joint_configuration() - goal).max() > ARRIVED_RAD:
        if time.monotonic() > deadline_s or driver.get_state()["faulted"]:
            return False
        time.sleep(0.05)
    return True


def test_it_brings_the_arm_up_moves_it_and_ends(driver: Any, controller: ControllerProcess) -> None:
    np.testing.assert_allclose(driver.get_joint_configuration(), controller.ask()["measured"], atol=1e-3)
    until(lambda: moved(driver, THERE))
    told = controller.ask()
    np.testing.assert_allclose(told["measured"], THERE, atol=0.01)
    assert told["malformed"] == 0
    assert not any("ST:" in event for event in told["events"])
    until(lambda: moved(driver, HOME))


def test_it_sees_an_emergency_stop_and_recovers(driver: Any, controller: ControllerProcess) -> None:
    controller.ask(e_stop=True)
    until(lambda: driver.get_state()["e_stopped"] and driver.get_state()["faulted"])
    controller.ask(e_stop=False)
    until(driver.recover)
    until(lambda: moved(driver, THERE))
    until(lambda: moved(driver, HOME))
    assert controller.ask()["alarms"] == []
