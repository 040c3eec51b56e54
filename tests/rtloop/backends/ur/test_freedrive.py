"""Hand guiding by the controller's own freedrive, in rtloop's cycle and a simulated controller, period by
period.

Oracle: the arm behind the controller and what its own state says; the push is a force in MuJoCo.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from lockstep_ur import hold
from ur_arm import with_options

from cobot.config import Settings
from cobot.contract_checks import ContractError
from cobot.ipc.layout import Stream
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode
from rtloop.backends import BackendError, Reporting
from rtloop.backends.ur import UrBackend
from rtloop.backends.ur.fields import RuntimeState, SafetyMode, UrRobotMode
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.functions import ProgramContext
from rtloop.backends.ur.simulator.lockstep import UrLockStep, UrRig
from rtloop.backends.ur.simulator.options import UrControllerOptions
from rtloop.contract.driver import Driver
from rtloop.contract.stream import end_session, open_session
from rtloop.results import ACCEPTED

PUSH_N = 30.0
WITHOUT = {"freedrive": False}
Joined = Callable[..., tuple[UrBackend, UrLockStep]]


@pytest.fixture
def driver(ur: Settings, arm: RobotDescription) -> Iterator[Driver]:
    made = Driver(ur, arm, UrRig(ur, arm.limits))
    try:
        made.start()
        made.until("the arm is held", lambda: made.mode is LoopMode.HOLD and bool(made.heard.commands))
        made.run(1.5)
        yield made
    finally:
        made.close()


def way_of(driver: Driver) -> UrLockStep:
    assert isinstance(driver.rig, UrRig)
    return driver.rig._channel


def controller_of(driver: Driver) -> UrController:
    return way_of(driver).controller


def guided(driver: Driver, seconds: float = 1.0) -> UrController:
    """Freedrive has begun, and a hand pushes."""
    open_session(driver, Stream.GUIDED)
    controller = controller_of(driver)
    driver.until("freedrive begins", lambda: "freedrive begins" in controller.events)
    controller.arm.push[1] = PUSH_N
    driver.run(seconds)
    return controller


def held(driver: Driver) -> None:
    """Without the push, the arm is in position control, at rest where cobot commands it, and can move."""
    driver.until("the arm is held", lambda: driver.mode is LoopMode.HOLD)
    controller = controller_of(driver)
    controller.arm.push[:] = 0.0
    driver.run(1.5)
    assert controller.safety is SafetyMode.NORMAL, list(controller.events)
    np.testing.assert_allclose(controller.arm.measured.position, driver.heard.commands[-1][0][0], atol=2e-3)
    driver.move()


def test_the_arm_goes_where_it_is_pushed_and_is_held_where_it_is_let_go(driver: Driver) -> None:
    before = controller_of(driver).arm.measured.position.copy()
    controller = guided(driver)
    moved = controller.arm.measured.position.copy()
    assert np.abs(moved - before).max() > 0.05
    assert isinstance(driver.backend, Reporting)
    assert "a person guides the arm by hand" in driver.backend.status().text
    np.testing.assert_allclose(driver.heard.commands[-1][0][0], driver.heard.measured, atol=1e-9)
    controller.arm.push[1] = 0.0
    driver.run(0.5)
    let_go = controller.arm.measured.position.copy()
    end_session(driver)
    driver.until("the arm is held", lambda: driver.mode is LoopMode.HOLD)
    assert driver.reason == "the client has ended the session"
    driver.run(1.5)
    np.testing.assert_allclose(controller.arm.measured.position, let_go, atol=2e-3)
    held(driver)
    assert list(controller.events).count("freedrive ends") == 1


def test_a_stop_while_the_arm_is_pushed_holds_it_within_tenths_of_a_second(driver: Driver) -> None:
    controller = guided(driver)
    speed = np.abs(controller.arm.measured.velocity).max()
    assert speed > 0.1
    driver.stop()
    driver.run(0.05)
    assert "freedrive ends" in controller.events
    driver.run(0.25)
    assert np.abs(controller.arm.measured.velocity).max() < 0.02, "although the hand still pushes"
    held(driver)


def test_a_silent_service_ends_it(driver: Driver) -> None:
    controller = guided(driver, 0.2)
    heartbeat = driver.memory.heartbeat
    alive_ns = int(heartbeat.data["monotonic_ns"])
    heartbeat.data["monotonic_ns"] = 1
    heartbeat.publish()
    driver.run(0.1)
    assert "freedrive ends" in controller.events
    assert "the service has been silent" in driver.reason
    heartbeat.data["monotonic_ns"] = alive_ns
    heartbeat.publish()
    held(driver)


def test_without_rtloop_the_program_holds_the_arm_and_ends(driver: Driver) -> None:
    """As after kill -9: the connection is there, and nothing comes."""
    controller = guided(driver)
    begun_s = controller.time_s
    while controller.runtime is RuntimeState.PLAYING:
        way_of(driver).pass_period()
        assert controller.time_s - begun_s < 0.2
    assert [each for each in controller.events if "cobot" in each or "freedrive" in each][-3:] == [
        "freedrive ends",
        "cobot: no command in time",
        "program cobot_control stopped: it has ended",
    ]
    for _ in range(100):
        way_of(driver).pass_period()
    assert np.abs(controller.arm.measured.velocity).max() < 0.01


@pytest.mark.parametrize("fault", ["e_stop", "protective_stop", "disconnect", "nan"])
def test_a_fault_ends_it_with_its_reason_and_a_reset_ends_the_fault(driver: Driver, fault: str) -> None:
    controller = guided(driver)
    with driver.fault(fault):
        driver.until("a fault", lambda: driver.mode is LoopMode.FAULT)
        driver.run(0.5)
        assert "freedrive ends" in controller.events or fault in ("e_stop", "protective_stop")
        assert not controller._context.is_guided
        reason = driver.reason
        controller.arm.push[1] = 0.0
    words = {
        "e_stop": "emergency stop",
        "protective_stop": "protective stop",
        "disconnect": "no data from the controller",
        "nan": "not finite",
    }
    assert words[fault] in reason
    assert driver.reset() == ACCEPTED
    held(driver)


def test_a_limit_that_is_passed_by_hand_is_a_protective_stop(driver: Driver) -> None:
    controller = guided(driver, 0.1)
    controller.arm.limits.max_position.flags.writeable = True
    before = controller.arm.limits.max_position.copy()
    try:
        controller.arm.limits.max_position[:] = controller.arm.measured.position + 0.05
        controller.arm.limits.min_position.flags.writeable = True
        driver.until("a fault", lambda: driver.mode is LoopMode.FAULT)
    finally:
        controller.arm.limits.max_position[:] = before
    assert any("guided beyond its limit" in each for each in controller.events)
    assert "protective stop" in driver.reason
    controller.arm.push[1] = 0.0
    assert driver.reset() == ACCEPTED
    held(driver)


def test_a_jump_of_the_measured_position_is_a_fault(driver: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    controller = guided(driver, 0.2)
    there = controller.values
    monkeypatch.setattr(
        controller, "values", lambda: there() | {"actual_q": [3.0, -1.0, 1.0, -1.0, -1.0, 0.0]}
    )
    driver.until("a fault", lambda: driver.mode is LoopMode.FAULT)
    assert "jumped" in driver.reason
    driver.run(0.1)
    assert "freedrive ends" in controller.events


def test_without_the_option_the_program_has_no_freedrive(
    connect: Joined, ur: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also the way out on a controller without the functions, which rejects the whole program."""
    functions = ProgramContext.functions
    monkeypatch.setattr(
        ProgramContext,
        "functions",
        lambda self: {name: each for name, each in functions(self).items() if "freedrive" not in name},
    )
    backend, way = opened(connect)
    with pytest.raises(BackendError, match=r"rejects cobot's program.*'end_freedrive_mode' is not defined"):
        hold(backend, way, 5)
    backend, way = opened(connect, freedrive=False)
    hold(backend, way, 5)
    with pytest.raises(BackendError, match=r"robot\.backend\.freedrive is false"):
        backend.begin_guiding()
    hold(backend, way, 5)


def test_rtloop_refuses_it_with_the_reason_of_the_backend(ur: Settings, arm: RobotDescription) -> None:
    settings = with_options(ur, 8, **WITHOUT)
    made = Driver(settings, arm, UrRig(settings, arm.limits))
    try:
        made.start()
        made.run(1.0)
        with pytest.raises(ContractError, match=r"robot\.backend\.freedrive is false"):
            open_session(made, Stream.GUIDED)
        assert made.mode is LoopMode.HOLD
        made.move()
    finally:
        made.close()


def test_a_first_position_that_is_far_from_the_arm_ends_the_program(connect: Joined) -> None:
    """Whatever cobot believes of the arm, such as an old state: the program itself looks where it is."""
    backend, way = opened(connect)
    there = (way.controller.arm.setpoint + 0.2).tolist()
    backend._program.send_position(there, 1)
    for _ in range(20):
        way.pass_period()
    assert "cobot: the first position is too far from the arm" in way.controller.events
    assert way.controller.safety is SafetyMode.NORMAL


def opened(connect: Joined, **more: object) -> tuple[UrBackend, UrLockStep]:
    backend, way = connect(UrControllerOptions(is_on=True), **more)
    backend.open(np.zeros(6))
    backend.enable()
    return backend, way


def test_a_controller_that_reports_backdrive_in_freedrive_ends_it_without_a_fault(
    driver: Driver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The package before the controller has heard of the end still has the robot mode of freedrive."""
    controller = controller_of(driver)
    values = controller.values

    def reported() -> dict[str, Any]:
        mode = {"robot_mode": int(UrRobotMode.BACKDRIVE)} if controller._is_released else {}
        return values() | mode

    monkeypatch.setattr(controller, "values", reported)
    guided(driver, 0.5)
    end_session(driver)
    driver.until("freedrive has ended", lambda: driver.mode is not LoopMode.JOINT_IMPEDANCE)
    driver.until("the arm rests", lambda: driver.mode is not LoopMode.STOPPING)
    assert driver.reason == "the client has ended the session"
    held(driver)
