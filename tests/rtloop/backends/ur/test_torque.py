"""Torques by the controller's `direct_torque`, in rtloop's cycle and a simulated controller, step by step.

Oracles: Pinocchio's dynamics of the URDF; the arm behind the controller, its reflexes and its events.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio
import pytest
from lockstep_ur import LateCommands
from ur_arm import ur_urdf, with_options

from cobot.config import Settings
from cobot.contract_checks import ContractError
from cobot.ipc.layout import Stream
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool
from cobot.types import Array, LoopMode
from rtloop.backends import BackendError, Impedance, ImpedanceControlled, Measured
from rtloop.backends.ur import UrBackend, program
from rtloop.backends.ur.fields import RuntimeState, SafetyMode
from rtloop.backends.ur.simulator.lockstep import TORQUE_SOFTWARE, UrLockStep, UrRig, joined
from rtloop.backends.ur.simulator.options import UrControllerOptions
from rtloop.backends.ur.torques import torque_rate
from rtloop.contract.driver import Driver
from rtloop.contract.stream import end_session, open_session
from rtloop.results import ACCEPTED

PERIOD_S = 0.002
ON = UrControllerOptions(is_on=True, software=TORQUE_SOFTWARE)
NONE = np.zeros(6)
Joined = Callable[..., tuple[UrBackend, UrLockStep]]


@pytest.fixture(scope="module")
def own(ur: Settings) -> Settings:
    return with_options(ur, 2, torque=True)


@pytest.fixture(scope="module")
def judge() -> pinocchio.Model:
    return pinocchio.buildModelFromXML(ur_urdf())


@pytest.fixture
def driver(own: Settings, arm: RobotDescription) -> Iterator[Driver]:
    made = Driver(own, arm, UrRig(own, arm.limits))
    try:
        made.start()
        made.until("the arm is held", lambda: made.mode is LoopMode.HOLD and bool(made.heard.commands))
        made.run(1.2)
        yield made
    finally:
        made.close()


def way_of(driver: Driver) -> UrLockStep:
    assert isinstance(driver.rig, UrRig)
    return driver.rig._channel


def stream(driver: Driver, torque: Array | list[float], cycles: int) -> list[Array]:
    """Stream a torque. Returns the arm's position after each cycle."""
    block, places = driver.memory.setpoint, []
    for _ in range(cycles):
        block.data["session"] = driver.memory.session.data["number"]
        block.data["number"] += 1
        block.data["joints"] = torque
        block.publish()
        driver.step()
        places.append(way_of(driver).controller.arm.measured.position.copy())
    return places


def torques_begun(driver: Driver) -> UrLockStep:
    """A stream of torques moves the arm."""
    open_session(driver, Stream.JOINT_TORQUE)
    stream(driver, NONE, 100)
    stream(driver, [6.0, 0.0, 0.0, 0.0, 0.0, 0.0], 100)
    way = way_of(driver)
    assert "direct torque begins" in way.controller.events
    assert way.controller.arm.measured.velocity[0] > 0.3
    return way


def held(driver: Driver) -> None:
    """The arm is in position control, at rest where cobot commands it, and can move."""
    driver.until("the arm is held", lambda: driver.mode is LoopMode.HOLD)
    driver.run(1.2)
    controller = way_of(driver).controller
    assert not controller._exerts
    assert controller.safety is SafetyMode.NORMAL, list(controller.events)
    np.testing.assert_allclose(controller.arm.measured.position, driver.heard.commands[-1][0][0], atol=2e-3)
    driver.move()


def opened(own: Settings, arm: RobotDescription, way: UrLockStep) -> UrBackend:
    backend = UrBackend(own, arm.limits, transport=way)
    backend.open(NONE)
    backend.enable()
    return backend


def run(backend: UrBackend, command: Array, cycles: int) -> Measured:
    measured = Measured(6)
    for _ in range(cycles):
        backend.wait(0.1)
        backend.read(measured)
        backend.write(command)
    return measured


def free_motion(judge: pinocchio.Model, begin: Array, torque: Array, seconds: float) -> Array:
    """Position of an arm without gravity after a constant torque, by Pinocchio."""
    judge = pinocchio.Model(judge)
    judge.gravity.linear[:] = 0.0
    data = judge.createData()
    position, velocity, step_s = begin.copy(), np.zeros(6), 1e-4
    for _ in range(round(seconds / step_s)):
        velocity += step_s * pinocchio.aba(judge, data, position, velocity, torque)
        position += step_s * velocity
    return position


def test_the_simulated_arm_moves_as_pinocchio_computes(
    own: Settings, arm: RobotDescription, judge: pinocchio.Model
) -> None:
    """By a program of `direct_torque` alone: gravity is compensated, and nothing else."""
    way = joined(own, arm.limits, ON)
    controller = way.controller
    controller.advance()
    begin = controller.arm.measured.position.copy()
    torque = np.array([4.0, -6.0, 3.0, 0.3, 0.2, -0.02])
    controller.upload(f"def moves():\n while True:\n  direct_torque({torque.tolist()})\n end\nend\n")
    for _ in range(75):
        controller.advance()
    expected = free_motion(judge, begin, torque, 0.15)
    moved = np.abs(expected - begin)
    assert moved.max() > 0.05
    np.testing.assert_allclose(controller.arm.measured.position, expected, atol=0.02 * moved.max())


def test_a_streamed_torque_moves_the_arm_as_pinocchio_computes(
    driver: Driver, judge: pinocchio.Model
) -> None:
    """Through rtloop's model, its springs, RTDE and the program. The torque rises and the reference lags, so
    the arm may be some periods late."""
    torque = np.array([3.0, -2.0, 1.5, 0.1, 0.05, 0.01])
    open_session(driver, Stream.JOINT_TORQUE)
    begin = stream(driver, NONE, 100)[-1]
    there = stream(driver, torque, 150)[-1]
    moved = there - begin
    assert np.abs(moved).max() > 0.1
    off = [
        np.abs(free_motion(judge, begin, torque, seconds) - there)[:3].max() / np.abs(moved[:3]).max()
        for seconds in (0.27, 0.275, 0.28, 0.285, 0.29)
    ]
    assert min(off) < 0.05, off  # the light joints reach their limit of acceleration
    end_session(driver)
    held(driver)


def test_a_push_is_estimated_in_both_modes(
    own: Settings, arm: RobotDescription, judge: pinocchio.Model
) -> None:
    """Oracle: Pinocchio's Jacobian of `tool0`, and the push in MuJoCo."""
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 50)
    data = judge.createData()
    for impedance in (None, Impedance(False, 0.5 * backend.nominal_stiffness, np.ones(6))):
        backend.set_impedance(impedance)
        way.controller.arm.push[:] = [12.0, -7.0, 9.0, 0.0, 0.0, 0.0]
        measured = run(backend, command, 500)
        jacobian = pinocchio.computeFrameJacobian(
            judge,
            data,
            way.controller.arm.measured.position,
            judge.getFrameId("tool0"),
            pinocchio.LOCAL_WORLD_ALIGNED,
        )
        pinocchio.updateFramePlacements(judge, data)
        turn = data.oMf[judge.getFrameId(own.robot.base_frame)].rotation
        np.testing.assert_allclose(
            measured.external_effort, jacobian[:3].T @ turn @ way.controller.arm.push[:3], atol=0.1
        )
        way.controller.arm.push[:] = 0.0
        measured = run(backend, command, 500)
        np.testing.assert_allclose(measured.external_effort, NONE, atol=0.1)


def test_springs_give_way_by_force_over_stiffness_and_never_jump(
    own: Settings, arm: RobotDescription
) -> None:
    """Oracle: Hooke's law for a wrench at the TCP, and the rate of each torque that is sent."""
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 50)
    stiffness = np.array([1000.0, 800.0, 600.0, 2.0, 2.0, 2.0])
    backend.set_impedance(Impedance(True, stiffness, np.ones(6)))
    run(backend, command, 100)
    before = np.array(way.controller.pose()[:3])
    way.controller.arm.push[:3] = [8.0, -6.0, 5.0]
    run(backend, command, 1500)
    moved = np.array(way.controller.pose()[:3]) - before
    np.testing.assert_allclose(moved, way.controller.arm.push[:3] / stiffness[:3], rtol=0.03)
    sent = np.array(way.torques)
    assert (np.abs(np.diff(sent, axis=0)) <= torque_rate(arm.limits) * PERIOD_S + 2e-6).all()
    assert (np.abs(sent) <= arm.limits.max_effort).all()


@pytest.mark.parametrize("cartesian", [False, True])
def test_the_stiffest_springs_are_stable_with_a_delay_of_8_ms(
    own: Settings, arm: RobotDescription, cartesian: bool
) -> None:
    way = joined(own, arm.limits, ON)
    late = LateCommands(way)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 50)
    most = backend.nominal_cartesian_stiffness if cartesian else 0.999 * backend.nominal_stiffness
    backend.set_impedance(Impedance(cartesian, most, np.full(6, 0.7)))
    late.periods = 4
    way.controller.arm.push[:3] = [10.0, 10.0, 10.0]
    run(backend, command, 300)
    way.controller.arm.push[:] = 0.0
    run(backend, command, 1200)
    assert np.abs(way.controller.arm.measured.velocity).max() < 0.02


def test_springs_of_nominal_stiffness_are_position_control(driver: Driver) -> None:
    """So streams of joint positions are as exact as without the option."""
    open_session(driver, Stream.JOINT_IMPEDANCE)
    driver.run(0.2)
    assert "direct torque begins" not in way_of(driver).controller.events
    end_session(driver)
    driver.until("the session has ended", lambda: driver.mode is LoopMode.HOLD)
    driver.move()
    assert not way_of(driver).torques


def test_without_rtloop_the_torques_fade_and_the_program_brakes_the_arm(driver: Driver) -> None:
    """As after kill -9: the connection is there, and nothing comes.

    Oracle: a coasting arm of the speed at the end, for the timeout, then 10 rad/s².
    """
    way = torques_begun(driver)
    controller = way.controller
    begun_s, speed = controller.time_s, float(np.abs(controller.arm.measured.velocity).max())
    begin = controller.arm.measured.position.copy()
    exerted = []
    while controller.runtime is RuntimeState.PLAYING:
        way.pass_period()
        exerted.append(controller._context.torque)
        assert controller.time_s - begun_s < 0.5
    torques = [each for each in exerted if each is not None]
    assert 8 <= len(torques) <= 13, "about 20 ms"
    assert np.abs(np.diff([each[0] for each in torques])).max() <= 150.0 / 0.05 * PERIOD_S + 1e-9
    assert np.abs(torques[-1]).max() < 1e-9
    assert list(controller.events)[-3:] == [
        "direct torque ends",
        "cobot: no command in time",
        "program cobot_control stopped: it has ended",
    ]
    for _ in range(20):
        way.pass_period()
    assert np.abs(controller.arm.measured.velocity).max() < 1e-2
    assert controller.safety is SafetyMode.NORMAL
    travel = float(np.abs(controller.arm.measured.position - begin).max())
    assert travel < 1.3 * (speed * 0.022 + speed**2 / 20.0)


@pytest.mark.parametrize(("gap", "ends"), [(4, False), (8, False), (20, True)])
def test_late_torques_fade_and_come_back_unless_they_are_too_late(
    driver: Driver, gap: int, ends: bool
) -> None:
    way = torques_begun(driver)
    step = torque_rate(driver.limits) * PERIOD_S + 1e-9
    before, largest = way.controller._context.torque, NONE
    for _ in range(gap):
        way.pass_period()
        torque = way.controller._context.torque
        if before is not None and torque is not None:
            largest = np.maximum(largest, np.abs(torque - before))
        before = torque
    assert (largest <= step).all()
    stream(driver, NONE, 200)
    assert (driver.mode is LoopMode.FAULT) == ends, driver.reason
    assert ("cobot: no command in time" in way.controller.events) == ends
    if ends:
        driver.until("at rest", lambda: driver.reset() == ACCEPTED)
    else:
        end_session(driver)
    held(driver)


def test_lost_packages_end_no_torques(driver: Driver) -> None:
    with driver.fault("loss"):
        torques_begun(driver)
        stream(driver, NONE, 300)
        assert driver.mode is LoopMode.JOINT_TORQUE, driver.reason
    end_session(driver)
    held(driver)


@pytest.mark.parametrize("fault", ["e_stop", "protective_stop", "disconnect", "nan", "frozen"])
def test_a_fault_ends_torques_with_its_reason_and_a_reset_ends_the_fault(driver: Driver, fault: str) -> None:
    way = torques_begun(driver)
    with driver.fault(fault):
        driver.until("a fault", lambda: driver.mode is LoopMode.FAULT)
        driver.run(0.15)
        assert not way.controller._exerts
        driver.run(0.35)
        assert np.abs(way.controller.velocity).max() < 1e-3
    assert np.isfinite(way.torques).all()
    driver.until("reset", lambda: driver.reset() == ACCEPTED)
    held(driver)


def test_a_torque_that_is_not_a_number_stops_the_arm(driver: Driver) -> None:
    way = torques_begun(driver)
    stream(driver, [np.nan, 0.0, 0.0, 0.0, 0.0, 0.0], 1)
    driver.until("an e-stop", lambda: driver.mode is LoopMode.ESTOP)
    assert "torque is not finite" in driver.reason
    driver.run(0.5)
    assert np.abs(way.controller.arm.measured.velocity).max() < 0.01
    assert np.isfinite(way.torques).all()
    driver.until("reset", lambda: driver.reset() == ACCEPTED)
    held(driver)


def test_torques_beyond_the_limits_are_bounded(driver: Driver) -> None:
    """Oracle: the joints' limits in joint_limits.yaml on each torque that is sent, and the reflexes of the
    controller."""
    open_session(driver, Stream.JOINT_TORQUE)
    stream(driver, NONE, 50)
    stream(driver, [1e9, -1e9, 1e9, -1e9, 1e9, -1e9], 100)
    stream(driver, NONE, 50)
    way = way_of(driver)
    sent = np.array(way.torques)
    assert (np.abs(sent) <= driver.limits.max_effort + 1e-6).all()
    assert (np.abs(np.diff(sent, axis=0)) <= torque_rate(driver.limits) * PERIOD_S + 2e-6).all()
    assert way.controller.safety is SafetyMode.NORMAL, list(way.controller.events)
    end_session(driver)
    held(driver)


def test_the_program_bounds_torques_by_itself(own: Settings, arm: RobotDescription) -> None:
    """Whatever comes over the network."""
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    found = []
    for _ in range(40):
        backend._program.send_torque([2000.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        way.pass_period()
        found.append(way.controller._context.torque)
    torques = np.array([each for each in found if each is not None])
    assert np.abs(torques).max() <= 150.0
    assert np.abs(np.diff(torques[:, 0])).max() <= 150.0 / 0.05 * PERIOD_S + 1e-9


def test_a_joint_that_is_too_fast_ends_the_torques(
    driver: Driver, own: Settings, arm: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "SPEED_SHARE", 0.05)
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    for _ in range(300):
        backend._program.send_torque([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        way.pass_period()
    controller = way.controller
    assert "cobot: a joint is faster than its limit, the torques have ended" in controller.events
    assert np.abs(controller.arm.measured.velocity).max() < 1e-2
    assert controller.runtime is RuntimeState.STOPPED


def test_torques_do_not_begin_while_the_arm_moves(own: Settings, arm: RobotDescription) -> None:
    """Neither by the backend, nor by the program."""
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 600)
    for cycle in range(200):
        command[0, 3] += 0.001 * min(cycle / 50, 1.0)
        run(backend, command, 1)
    soft = Impedance(False, 0.5 * backend.nominal_stiffness, np.ones(6))
    with pytest.raises(BackendError, match=r"moving at 0\.5 rad/s.*begin only at rest"):
        backend.set_impedance(soft)
    run(backend, command, 1)
    assert not way.torques
    backend._program.send_torque(NONE.tolist())
    for _ in range(60):
        way.pass_period()
    assert "cobot: torques begin only while the arm stands still" in way.controller.events
    assert "direct torque begins" not in way.controller.events
    assert np.abs(way.controller.velocity).max() < 1e-6


@pytest.mark.parametrize("cycles", [0, 1, 5, 20])
def test_a_motion_right_after_torques_does_not_jump(
    own: Settings, arm: RobotDescription, cycles: int
) -> None:
    """Oracle: the reflex of a jump in the simulated controller."""
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 50)
    backend.set_impedance(Impedance(False, 0.1 * backend.nominal_stiffness, np.ones(6)))
    way.controller.arm.push[:3] = [0.0, 3.0, 0.0]
    run(backend, command, 1000)
    command[0] = way.controller.arm.measured.position
    way.controller.arm.push[:] = 0.0
    run(backend, command, 1000)
    backend.set_impedance(None)
    run(backend, command, cycles)
    begin = command[0].copy()
    for cycle in range(629):
        command[0] = begin + 0.3 * (1.0 - np.cos(0.01 * cycle))
        run(backend, command, 1)
    controller = way.controller
    assert list(controller.events)[-2:] == ["direct torque begins", "direct torque ends"]
    assert controller.safety is SafetyMode.NORMAL
    np.testing.assert_allclose(controller.arm.measured.position, command[0], atol=5e-3)


def test_the_load_counts_for_the_estimate(own: Settings, arm: RobotDescription) -> None:
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    tool = Tool(version=1, mass=2.0, centre=(0.0, 0.0, 0.1))
    backend.set_tool(tool)
    way.controller.arm._drives.set_tool(tool)
    measured = run(backend, command, 300)
    np.testing.assert_allclose(measured.external_effort, NONE, atol=0.1)


@pytest.mark.parametrize(
    ("controller", "needed"),
    [
        (UrControllerOptions("e"), r"software 5\.17\.0\.128000 has no direct_torque: update it to 5\.23 or"),
        (UrControllerOptions("e", software=(5, 22, 9, 0)), r"update it to 5\.23 or later"),
        (UrControllerOptions("x", software=(10, 10, 0, 0)), r"update it to 10\.11 or later"),
    ],
)
def test_a_controller_without_direct_torque_is_rejected(
    connect: Joined, controller: UrControllerOptions, needed: str
) -> None:
    backend, _ = connect(controller, 2, torque=True)
    with pytest.raises(BackendError, match=needed):
        backend.open(NONE)


@pytest.mark.parametrize(("series", "software"), [("e", (5, 23, 0, 0)), ("x", (10, 11, 0, 0))])
def test_the_first_versions_with_direct_torque_are_accepted(
    connect: Joined, series: str, software: tuple[int, int, int, int]
) -> None:
    backend, way = connect(UrControllerOptions(series, software=software), 2, torque=True)
    backend.open(NONE)
    backend.enable()
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 20)
    backend.set_impedance(Impedance(False, 0.5 * backend.nominal_stiffness, np.ones(6)))
    run(backend, command, 20)
    assert "direct torque begins" in way.controller.events


def test_another_period_is_rejected(connect: Joined) -> None:
    with pytest.raises(BackendError, match=r"rt\.period_s is 0\.004 s; set it to 0\.002"):
        connect(ON, 4, torque=True)


def test_without_the_option_nothing_is_different(ur: Settings, arm: RobotDescription) -> None:
    settings = with_options(ur, 2)
    backend = UrRig(settings, arm.limits).backend()
    assert not isinstance(backend, ImpedanceControlled)
    text = program.script(backend._options, arm.limits, "127.0.0.1", 1, 1, PERIOD_S)
    assert "direct_torque" not in text
    made = Driver(settings, arm, UrRig(settings, arm.limits))
    try:
        made.start()
        made.run(0.5)
        with pytest.raises(ContractError, match="a stream of torques needs torque control"):
            open_session(made, Stream.JOINT_TORQUE)
    finally:
        made.close()


def test_values_that_repeat_at_rest_end_the_torques(own: Settings, arm: RobotDescription) -> None:
    """The springs balance a push, and see neither its end nor the motion that follows.

    Oracle: the speed of the arm behind the controller, whose reflex stops it otherwise.
    """
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 50)
    backend.set_impedance(Impedance(False, 0.5 * backend.nominal_stiffness, np.ones(6)))
    way.controller.arm.push[1] = 15.0
    run(backend, command, 1500)
    assert np.abs(way.controller.arm.measured.velocity).max() < 1e-3
    way.network.spoil = "frozen"
    run(backend, command, 3)
    way.controller.arm.push[:] = 0.0
    with pytest.raises(BackendError, match=r"repeated the position and the motor currents 10 times"):
        run(backend, command, 100)
    fastest = 0.0
    for _ in range(200):
        way.pass_period()
        fastest = max(fastest, float(np.abs(way.controller.arm.measured.velocity).max()))
    assert fastest < 1.5
    assert way.controller.safety is SafetyMode.NORMAL, list(way.controller.events)
    assert not way.controller._exerts
    assert np.abs(way.controller.velocity).max() < 1e-3


def test_the_program_ends_only_after_it_has_braked_a_fast_joint(
    own: Settings, arm: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the arm behind the controller is at rest when the program ends."""
    monkeypatch.setattr(program, "SPEED_SHARE", 0.2)
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    controller = way.controller
    while controller.runtime is RuntimeState.PLAYING:
        backend._program.send_torque([40.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        way.pass_period()
        assert controller.time_s < 5.0
    assert "cobot: a joint is faster than its limit, the torques have ended" in controller.events
    assert np.abs(controller.velocity).max() < 1e-3


def test_a_controller_that_loses_direct_torque_is_named(own: Settings, arm: RobotDescription) -> None:
    """As after a change of its software, or of the controller, while cobot runs."""
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    measured = run(backend, command, 20)
    way.controller.options = UrControllerOptions(is_on=True)
    way.off = True
    for _ in range(10):
        way.pass_period()
    for session, pipe in way._sessions:
        session.close()
        pipe.close()
    way._sessions, way.off = [], False
    for _ in range(1000):
        backend.wait(0.1)
        if backend._link.version is not None and backend._link.version < (5, 23):
            break
    backend.wait(0.1)
    with pytest.raises(BackendError, match=r"software 5\.17\.0\.128000 has no direct_torque"):
        backend.read(measured)


def test_the_end_of_a_program_with_torques_is_explained(
    own: Settings, arm: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program, "SPEED_SHARE", 0.02)
    way = joined(own, arm.limits, ON)
    backend = opened(own, arm, way)
    command = np.zeros((3, 6))
    command[0] = way.controller.arm.setpoint
    run(backend, command, 50)
    backend.set_impedance(Impedance(False, 0.1 * backend.nominal_stiffness, np.ones(6)))
    way.controller.arm.push[1] = 15.0
    with pytest.raises(BackendError, match=r"commands were missing for 0\.02 s, or a joint was faster than"):
        run(backend, command, 500)
