"""A device that takes whole motions and moves along them by itself, in the real cycle.

Oracle: the toy device, which knows where on its motion it is, and what it was given.
"""

from __future__ import annotations

import itertools
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cobot_run import until
from rig import Rig
from scipy.interpolate import BPoly

from cobot.config import Settings
from cobot.ipc.device_record import device_of
from cobot.ipc.io_record import report_of
from cobot.ipc.layout import Command, MotionResult
from cobot.launch.supervisor.supervisor import STOP_TIMEOUT_S
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.robot.io_points import IoKind, IoPoint
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits, LoopMode, PlannerName, Scaling
from rtloop.backends import (
    BackendError,
    CarriesTool,
    Measured,
    make_backend,
    queued_outputs,
    trajectory_driver,
)
from rtloop.backends.driven_io import DrivenIo
from rtloop.backends.threaded_enabling import MAX_LOOK_AGE_S
from rtloop.backends.trajectory_driver import (
    LAST_CALL_LOG_S,
    LAST_CALL_S,
    TURN_S,
    Motion,
    TrajectoryDriver,
    as_backend,
)
from rtloop.contract.toy_trajectory import STATE_PERIOD_S, ToyArm, ToyDevice
from rtloop.loop import END_LIMIT_S


class Arm(ToyArm):
    """The toy, which notes what it is given.

    Attributes:
        loaded: times and positions of the last motion.
        refuses: why it takes none.
    """

    def __init__(self, settings: Settings, limits: JointLimits, device: ToyDevice) -> None:
        super().__init__(settings, limits, device)
        self._is_new = True
        self.loaded: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
        self.refuses = ""
        self.calls: list[str] = []

    def load(self, times_s: Array, rows: Array) -> None:
        if self.refuses:
            raise BackendError(self.refuses)
        self.calls.append("load")
        self.loaded = times_s, rows
        super().load(times_s, rows)

    def stop(self) -> None:
        self.calls.append("stop")
        super().stop()


class ArmWithIo(Arm):
    """It has one output, which it refuses above 9."""

    capabilities = replace(ToyArm.capabilities, io=True)
    value = 0.0

    def io(self) -> list[IoPoint]:
        return [IoPoint("speed", IoKind.ANALOG, True, self.value)]

    def set_output(self, name: str, value: float) -> None:
        if value > 9.0:
            raise BackendError(f"{name} goes up to 9")
        self.value = value


@pytest.fixture
def arm(settings: Settings, robot: RobotDescription) -> Arm:
    return Arm(settings, robot.limits, ToyDevice(robot.limits.dof, realtime=False))


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription, arm: Arm) -> Iterator[Rig]:
    made = Rig(settings, robot, backend=as_backend(arm, robot.limits.dof, 0.001, threaded=False))
    yield made
    made.close()


def motion(rig: Rig, by_rad: float = 0.2) -> Trajectory:
    here = rig.loop.controller.safety.position.copy()
    goal = here + by_rad
    return plan_ptp(rig.robot, MotionRequest(here, goal, PlannerName.PTP, Scaling(0.5)), goal)


def test_it_is_given_the_whole_motion_and_followed(rig: Rig, arm: Arm) -> None:
    planned = motion(rig)
    assert rig.start(planned) == ""
    rig.step(round(0.5 * planned.duration_s / 0.001))
    times_s, rows = arm.loaded
    assert times_s[-1] == pytest.approx(planned.duration_s)
    np.testing.assert_allclose(rows[0], planned.sample(times_s), atol=1e-9)
    np.testing.assert_allclose(rows[1], planned.sample(times_s, 1), atol=1e-9)
    done_s = rig.loop.controller.clock.path_time_s
    assert 0.0 < done_s < planned.duration_s
    np.testing.assert_allclose(rig.loop.controller.safety.position, planned.sample([done_s])[0], atol=1e-9)
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    np.testing.assert_allclose(rig.loop.controller.safety.position, planned.end, atol=1e-6)
    assert rig.start(motion(rig, -0.2)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_its_outputs_are_set_by_the_thread_that_asks_it(
    settings: Settings, robot: RobotDescription, caplog: pytest.LogCaptureFixture
) -> None:
    arm = ArmWithIo(settings, robot.limits, ToyDevice(robot.limits.dof, realtime=False))
    rig = Rig(settings, robot, backend=as_backend(arm, robot.limits.dof, 0.001, threaded=False))
    record, period = rig.memory.output.data, round(STATE_PERIOD_S / 0.001)
    for value in (2.5, 12.0, 3.0):
        record["name"], record["value"] = b"speed", value
        rig.memory.output.publish()
        before = arm.value
        assert rig.answer(rig.send(Command.OUTPUT)) == ""
        assert arm.value == before
        rig.step(period)
        assert arm.value == (before if value > 9.0 else value)
    assert "speed goes up to 9" in caplog.text
    rig.step(300)
    assert rig.memory.io.try_read()
    assert [each.value for each in report_of(rig.memory.io.data).points] == [3.0]
    rig.close()


def test_an_output_that_has_waited_for_a_hanging_device_is_not_set_when_it_answers(
    settings: Settings, robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = ArmWithIo(settings, robot.limits, ToyDevice(robot.limits.dof, realtime=False))
    io = DrivenIo(arm)
    monkeypatch.setattr(queued_outputs, "time", SimpleNamespace(monotonic=lambda: 100.0))
    io.set_output("speed", 2.5)
    monkeypatch.setattr(queued_outputs, "time", SimpleNamespace(monotonic=lambda: 102.5))
    io.ask()
    assert arm.value == 0.0
    io.set_output("speed", 3.0)
    io.ask()
    assert arm.value == 3.0


def test_a_stop_lets_it_rest_on_its_path(rig: Rig, arm: Arm) -> None:
    planned = motion(rig)
    assert rig.start(planned) == ""
    rig.step(round(0.4 * planned.duration_s / 0.001))
    rig.request()
    rig.run()
    assert (rig.mode, rig.result) == (LoopMode.HOLD, MotionResult.STOPPED)
    assert arm.calls[-1] == "stop"
    here = rig.loop.controller.safety.position
    np.testing.assert_allclose(here, planned.sample([rig.path_times[-1]])[0], atol=1e-6)
    assert rig.start(motion(rig)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_a_fast_stop_switches_it_off_when_it_rests(rig: Rig, arm: Arm) -> None:
    assert rig.start(motion(rig)) == ""
    rig.step(300)
    rig.loop.controller.fast_stop("fast stop requested")
    rig.run()
    assert rig.mode is LoopMode.ESTOP
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.start(motion(rig)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED


class Noisy(Arm):
    """The velocity of joint4 is never measured as 0, as with a driver with a noisy sensor.

    Attributes:
        creeps_rad_s: speed of joint2, which moves although the device does nothing.
        noise_rad_s: alternating error of the velocity of joint4.
    """

    creeps_rad_s = noise_rad_s = 0.0
    crept_rad = 0.0

    def state(self, measured: Measured) -> None:
        super().state(measured)
        self.noise_rad_s *= -1.0
        self.crept_rad += self.creeps_rad_s * STATE_PERIOD_S
        measured.position[1] += self.crept_rad
        measured.velocity[1] += self.creeps_rad_s
        measured.velocity[3] += self.noise_rad_s


@pytest.fixture
def noisy(settings: Settings, robot: RobotDescription) -> Iterator[tuple[Noisy, Rig]]:
    arm = Noisy(settings, robot.limits, ToyDevice(robot.limits.dof, realtime=False))
    made = Rig(settings, robot, backend=as_backend(arm, robot.limits.dof, 0.001, threaded=False))
    assert made.start(motion(made)) == ""
    made.step(300)
    yield arm, made
    made.close()


def test_a_reset_does_not_wait_for_ever_for_a_velocity_that_is_only_noise(noisy: tuple[Noisy, Rig]) -> None:
    """The measured position is what tells that the arm rests. Before that, the message names the joint."""
    arm, rig = noisy
    arm.noise_rad_s = 0.02
    rig.loop.controller.fault("a fault")
    rig.step(600)
    said = rig.answer(rig.send(Command.RESET))
    assert said == (
        "the arm is not at rest yet: joint4 moves at 0.0200 rad/s, the maximum at rest is 0.005 rad/s "
        "(rt.settle_velocity_rad_s)"
    )
    rig.step(1100)
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.mode is LoopMode.HOLD


def test_a_motion_after_a_stop_does_not_wait_for_a_velocity_that_is_only_noise(
    noisy: tuple[Noisy, Rig],
) -> None:
    arm, rig = noisy
    arm.noise_rad_s = 0.02
    rig.request()
    rig.run()
    assert rig.mode is LoopMode.HOLD
    assert "not settled 2.0 s after the end of the motion: joint4 is 0.0000 rad away" in rig.reason
    assert rig.reason.endswith("; the maximum at rest is 0.005 rad/s (rt.settle_velocity_rad_s)")
    assert rig.start(motion(rig)) == ""


def test_a_reset_waits_for_an_arm_that_creeps(noisy: tuple[Noisy, Rig]) -> None:
    arm, rig = noisy
    arm.creeps_rad_s = 0.01
    rig.loop.controller.fault("a fault")
    rig.step(5000)
    assert "not at rest yet: joint2 moves at 0.0100 rad/s" in rig.answer(rig.send(Command.RESET))
    arm.creeps_rad_s = 0.0
    rig.step(200)
    assert rig.answer(rig.send(Command.RESET)) == ""


@pytest.mark.parametrize("polls", [1, 2, 3])
def test_an_arm_does_not_seem_at_rest_between_two_values_of_a_slow_device(
    settings: Settings, robot: RobotDescription, polls: int
) -> None:
    """Oracle: the velocity of the motion. At rest, the velocity is soon zero."""

    class Rare(ToyArm):
        """It has new values once in so many polls, and measures no velocity."""

        capabilities = replace(ToyArm.capabilities, measured=frozenset({"position"}))
        asked = 0

        def state(self, measured: Measured) -> None:
            super().state(measured)
            measured.velocity[:] = 0.0
            self.asked += 1
            if self.asked % polls == 1 % polls:
                self.shown = measured.position.copy()
            measured.position[:] = self.shown

    device = ToyDevice(robot.limits.dof, realtime=False)
    device.place(np.array(robot.positions["home"].joints))
    driver = as_backend(Rare(settings, robot.limits, device), 7, 0.001, threaded=False)
    assert isinstance(driver, TrajectoryDriver)
    made = Rig(settings, robot, backend=driver)
    planned = motion(made, 0.5)
    assert made.start(planned) == ""
    measured = Measured(7)
    seen: list[float] = []
    while made.mode is LoopMode.TRAJECTORY:
        made.step()
        measured.values[:] = driver._said.values
        seen.append(measured.velocity[0])
    quarter = len(seen) // 4
    peak = np.abs(planned.sample(np.linspace(0.0, planned.duration_s, 500), 1)[:, 0]).max()
    assert min(seen[quarter : 2 * quarter]) > 0.2 * peak
    assert max(seen) < 1.1 * peak
    assert seen[-1] == pytest.approx(0.0, abs=settings.rt.settle_velocity_rad_s)
    made.close()


def test_what_it_cannot_do_is_refused_by_name(rig: Rig) -> None:
    assert "takes whole motions only" in rig.stream()
    assert rig.start(motion(rig)) == ""
    rig.step(200)
    assert "not slowed down" in rig.answer(rig.send(Command.SET_RATE, value=0.5))
    planned = motion(rig)
    rig.memory.slots[1].write(1, planned)
    replaced = rig.send(Command.REPLACE, slot=1, motion_id=1, value=0.0)
    assert "not led on to another motion" in rig.answer(replaced)
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_a_motion_that_it_does_not_take_is_a_fault_with_its_words(rig: Rig, arm: Arm) -> None:
    arm.refuses = "more than 100 points"
    assert rig.start(motion(rig)) == ""
    rig.step(200)
    assert rig.mode is LoopMode.FAULT
    assert "rejects the motion: more than 100 points" in rig.reason
    arm.refuses = ""
    rig.step(300)
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.start(motion(rig)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_a_first_contact_is_as_slow_as_with_any_robot(rig: Rig, arm: Arm) -> None:
    rig.loop.controller.clock.scale(0.1)
    planned = motion(rig, 0.02)
    assert rig.start(planned) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert arm.loaded[0][-1] == pytest.approx(10.0 * planned.duration_s)


def test_its_capability_is_told(rig: Rig) -> None:
    capabilities = device_of(rig.memory.device.data).capabilities
    assert capabilities.trajectories
    assert "whole motions only" in capabilities.words


def test_a_device_that_cannot_be_asked_is_a_fault_and_one_that_hangs_keeps_nobody_waiting(
    settings: Settings, robot: RobotDescription
) -> None:
    """Its thread is the real one; a clock is waited for only until something happens."""
    hangs, going = threading.Event(), threading.Event()
    going.set()

    class Hanging(ToyArm):
        def state(self, measured: Measured) -> None:
            if hangs.is_set():
                going.wait()
            super().state(measured)

    backend = as_backend(Hanging(settings, robot.limits), robot.limits.dof, 0.001)
    assert isinstance(backend, TrajectoryDriver)
    measured = Measured(robot.limits.dof)
    backend.open(np.array(robot.positions["home"].joints))
    try:
        backend.enable()
        backend.read(measured)
        planned = Trajectory(np.array([0.0, 0.1]), np.zeros((1, robot.limits.dof, 6)))
        backend.begin(planned.breakpoints_s, planned.coefficients, 1.0)

        def arrived() -> bool:
            backend.read(measured)
            return backend.done_s() == planned.duration_s

        until(arrived)
        going.clear()
        hangs.set()

        def silent() -> bool:
            begun_s = time.monotonic()
            try:
                backend.read(measured)
            except BackendError as exc:
                return "has not answered for" in str(exc)
            assert time.monotonic() - begun_s < 30.0
            return False

        until(silent)
    finally:
        hangs.clear()
        going.set()
        backend.close()


class SlowToEnable(ToyArm):
    """It is enabled as soon as `may_go` is set, and notes what its drives are told."""

    capabilities = replace(ToyArm.capabilities, stops={1: False, 2: False})

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self.calls: list[str] = []
        self.may_go = threading.Event()
        self.may_go.set()

    def enable(self) -> None:
        self.calls.append("enable")
        self.may_go.wait(60.0)
        super().enable()
        self.calls.append("enabled")

    def disable(self) -> None:
        self.calls.append("disable")


@pytest.fixture
def slow(settings: Settings, robot: RobotDescription) -> Iterator[tuple[SlowToEnable, Rig]]:
    """A rig with an arm that is slow to enable."""
    arm = SlowToEnable(settings, robot.limits)
    rig = Rig(settings, robot, backend=as_backend(arm, robot.limits.dof, 0.001))
    yield arm, rig
    arm.may_go.set()
    rig.loop.close()
    rig.close()


class Unanswering(SlowToEnable):
    """Polls of it hang while `hangs` is set."""

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self.hangs, self.is_hanging = threading.Event(), threading.Event()
        self.refusals = 0

    def state(self, measured: Measured) -> None:
        while self.hangs.is_set():
            self.is_hanging.set()
            time.sleep(0.001)
        self.is_hanging.clear()
        super().state(measured)

    def disable(self) -> None:
        super().disable()
        if self.refusals:
            self.refusals -= 1
            raise BackendError("the drives do not answer")


@pytest.fixture
def unanswering(settings: Settings, robot: RobotDescription) -> Iterator[tuple[Unanswering, Rig]]:
    """A device and the cycle, in FAULT with the drives on."""
    arm = Unanswering(settings, robot.limits)
    rig = Rig(settings, robot, backend=as_backend(arm, robot.limits.dof, 0.001))
    try:
        rig.loop.controller.fault("drive 3 is hot")
        rig.step(300)
        yield arm, rig
    finally:
        arm.hangs.clear()
        arm.may_go.set()
        rig.loop.close()
        rig.close()


def switched_off(rig: Rig) -> None:
    """A stop of category 1, after which the cycle counts the drives as off."""
    rig.memory.requests.data["fast_stops"] += 1
    rig.request()
    until(lambda: rig.step(100) or rig.loop.controller.drives.off)


def test_a_cycle_that_switches_off_a_device_whose_reset_has_not_begun_switches_it_off(
    unanswering: tuple[Unanswering, Rig],
) -> None:
    """The thread still waits for a poll. Oracle: the device."""
    arm, rig = unanswering
    arm.hangs.set()
    assert arm.is_hanging.wait(60.0)
    rig.send(Command.RESET)
    rig.step(10)
    switched_off(rig)
    arm.hangs.clear()
    until(lambda: rig.step() or arm.calls[-1] == "disable")
    assert arm.calls == ["enable", "enabled", "disable"]


def test_drives_are_off_after_a_second_reset_that_waited_for_the_first(
    unanswering: tuple[Unanswering, Rig],
) -> None:
    arm, rig = unanswering
    arm.may_go.clear()
    rig.send(Command.RESET)
    until(lambda: rig.step() or arm.calls[-1] == "enable")
    rig.request()
    rig.send(Command.RESET)
    rig.step(10)
    switched_off(rig)
    arm.may_go.set()
    until(lambda: rig.step() or arm.calls[-1] == "disable")
    rig.step(200)
    assert arm.calls == ["enable", "enabled", "enable", "enabled", "disable"]
    assert rig.loop.controller.drives.off


def test_a_device_that_answers_again_is_not_switched_on_for_a_reset_that_has_ended(
    unanswering: tuple[Unanswering, Rig],
) -> None:
    arm, rig = unanswering
    arm.hangs.set()
    assert arm.is_hanging.wait(60.0)
    reset = rig.send(Command.RESET)
    rig.step(10)
    rig.request()
    assert rig.answer(reset, 10) == "a stop has been requested in the meantime"
    time.sleep(MAX_LOOK_AGE_S)
    arm.hangs.clear()
    until(lambda: not arm.is_hanging.is_set())
    time.sleep(0.2)
    rig.step(10)
    assert arm.calls == ["enable", "enabled"]
    again = rig.send(Command.RESET)
    until(lambda: rig.step() or rig.mode is LoopMode.HOLD)
    assert rig.answer(again) == ""


def test_drives_that_cannot_be_switched_off_after_a_hanging_reset_are_switched_off_later(
    unanswering: tuple[Unanswering, Rig], caplog: pytest.LogCaptureFixture
) -> None:
    arm, rig = unanswering
    arm.may_go.clear()
    rig.send(Command.RESET)
    until(lambda: rig.step() or arm.calls[-1] == "enable")
    switched_off(rig)
    rig.step(300)
    assert not device_of(rig.memory.device.data).drives_off, "a client must not read that they are off"
    arm.refusals = 3
    arm.may_go.set()
    until(lambda: rig.step() or arm.calls.count("disable") == 4)
    until(lambda: rig.step() or device_of(rig.memory.device.data).drives_off)
    time.sleep(0.2)
    assert arm.calls == ["enable", "enabled", "enable", "enabled", *["disable"] * 4]
    assert caplog.text.count("could not be switched off after a stop: the drives do not answer") == 1


def test_a_shutdown_during_a_reset_leaves_the_drives_off(settings: Settings, robot: RobotDescription) -> None:
    arm = Unanswering(settings, robot.limits)
    backend = as_backend(arm, robot.limits.dof, 0.001)
    assert isinstance(backend, TrajectoryDriver)
    backend.open(np.array(robot.positions["home"].joints))
    arm.hangs.set()
    try:
        assert arm.is_hanging.wait(60.0)
        backend.recover_step()
        backend.disable()
        ending = threading.Thread(target=backend.close)
        ending.start()
        until(lambda: backend._ending)
    finally:
        arm.hangs.clear()
    ending.join(60.0)
    until(lambda: arm.calls == ["disable"])


@pytest.fixture
def opened(settings: Settings, robot: RobotDescription) -> Iterator[tuple[Unanswering, TrajectoryDriver]]:
    arm = Unanswering(settings, robot.limits)
    backend = as_backend(arm, robot.limits.dof, 0.001)
    assert isinstance(backend, TrajectoryDriver)
    backend.open(np.array(robot.positions["home"].joints))
    try:
        yield arm, backend
    finally:
        arm.hangs.clear()
        arm.may_go.set()


def test_a_shutdown_while_a_poll_hangs_leaves_the_drives_off(
    opened: tuple[Unanswering, TrajectoryDriver], monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, backend = opened
    monkeypatch.setattr(trajectory_driver, "TURN_S", 0.01)
    arm.hangs.set()
    assert arm.is_hanging.wait(60.0)
    with pytest.raises(BackendError, match="has not answered for"):
        backend.disable()
    monkeypatch.setattr(trajectory_driver, "LAST_CALL_LOG_S", 60.0)
    ending = threading.Thread(target=backend.close)
    ending.start()
    until(lambda: backend._ending)
    arm.hangs.clear()
    ending.join(60.0)
    assert arm.calls == ["disable"]


def test_drives_that_a_hanging_reset_may_leave_on_at_the_end_are_logged(
    opened: tuple[Unanswering, TrajectoryDriver],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The thread switches them off itself if the process still exists when the device answers."""
    arm, backend = opened
    monkeypatch.setattr(trajectory_driver, "LAST_CALL_LOG_S", 0.01)
    monkeypatch.setattr(trajectory_driver, "LAST_CALL_S", 0.02)
    arm.may_go.clear()
    backend.recover_step()
    until(lambda: backend.enable_step() or arm.calls == ["enable"])
    backend.disable()
    backend.close()
    assert "its drives may stay on: check them before you approach the arm" in caplog.text
    arm.may_go.set()
    until(lambda: arm.calls == ["enable", "enabled", "disable"])


def test_the_supervisor_waits_longer_than_the_last_call_to_a_device_may_take() -> None:
    """Also for an arm that must come to rest before: then at least the line of the log comes in time."""
    with_reset_s = TURN_S + LAST_CALL_S
    with_motion_s = END_LIMIT_S + TURN_S + LAST_CALL_LOG_S
    assert max(with_reset_s, with_motion_s) < STOP_TIMEOUT_S


def test_the_cycle_goes_on_while_a_device_hangs_in_a_reset_and_a_stop_ends_it(
    slow: tuple[SlowToEnable, Rig],
) -> None:
    """Oracle: the device. In the cycle it would have waited to its end before the cycle went on."""
    arm, rig = slow
    rig.loop.controller.fault("drive 3 is hot")
    rig.step(300)
    arm.may_go.clear()
    reset = rig.send(Command.RESET)
    until(lambda: rig.step() or arm.calls[-1] == "enable")
    rig.step(300)
    assert arm.calls == ["enable", "enabled", "enable"]
    assert "a reset is enabling the robot" in device_of(rig.memory.device.data).status.text
    rig.request()
    assert rig.answer(reset, 10) == "a stop has been requested in the meantime"
    assert rig.mode is LoopMode.FAULT
    again = rig.send(Command.RESET)
    rig.step(10)
    arm.may_go.set()
    until(lambda: rig.step() or rig.mode is LoopMode.HOLD)
    assert rig.answer(again) == ""
    assert arm.calls == ["enable", "enabled"] * 3


def test_drives_that_a_hanging_reset_switches_on_after_an_estop_are_switched_off_again(
    slow: tuple[SlowToEnable, Rig],
) -> None:
    arm, rig = slow
    rig.loop.controller.fast_stop("fast stop requested")
    until(lambda: rig.step() or rig.loop.controller.drives.off)
    assert arm.calls == ["enable", "enabled", "disable"]
    arm.may_go.clear()
    reset = rig.send(Command.RESET)
    until(lambda: rig.step() or arm.calls[-1] == "enable")
    rig.request("estops")
    assert rig.answer(reset, 10) == "a stop has been requested in the meantime"
    arm.may_go.set()
    until(lambda: arm.calls == ["enable", "enabled", "disable", "enable", "enabled", "disable"])
    rig.step(10)
    assert rig.loop.controller.drives.off
    assert rig.mode is LoopMode.ESTOP


class SlowToLoad(Arm):
    """It takes a motion as soon as `may_load` is set."""

    def __init__(self, settings: Settings, limits: JointLimits, device: ToyDevice) -> None:
        super().__init__(settings, limits, device)
        self.may_load = threading.Event()
        self.may_load.set()

    def load(self, times_s: Array, rows: Array) -> None:
        self.calls.append("loading")
        self.may_load.wait(60.0)
        super().load(times_s, rows)

    def start(self) -> None:
        self.calls.append("start")
        super().start()


def test_a_stop_while_a_motion_is_loaded_waits_for_the_stop_of_the_device_also_after_an_earlier_stop(
    settings: Settings, robot: RobotDescription
) -> None:
    """Oracle: the device, which starts the motion that it was loading. Until it is stopped, the arm moves."""
    arm = SlowToLoad(settings, robot.limits, ToyDevice(robot.limits.dof))
    rig = Rig(settings, robot, backend=as_backend(arm, robot.limits.dof, 0.001))
    try:
        assert rig.start(motion(rig)) == ""
        until(lambda: rig.step() or "start" in arm.calls)
        rig.request()
        until(lambda: rig.step() or rig.mode is LoopMode.HOLD)
        arm.may_load.clear()
        assert rig.start(motion(rig)) == ""
        until(lambda: rig.step() or arm.calls[-1] == "loading")
        rig.request()
        rig.step(500)
        assert rig.mode is LoopMode.STOPPING
        arm.may_load.set()
        until(lambda: rig.step() or rig.mode is LoopMode.HOLD)
        assert arm.calls[-3:] == ["load", "start", "stop"]
    finally:
        arm.may_load.set()
        rig.loop.close()
        rig.close()


def test_a_tool_is_refused_in_words_while_the_device_hangs(
    settings: Settings, robot: RobotDescription
) -> None:
    hangs, going = threading.Event(), threading.Event()

    class Carrying(ToyArm):
        tool: Tool | None = None

        def state(self, measured: Measured) -> None:
            if hangs.is_set():
                going.wait(60.0)
            super().state(measured)

        def set_tool(self, tool: Tool) -> None:
            self.tool = tool

    arm = Carrying(settings, robot.limits)
    backend = as_backend(arm, robot.limits.dof, 0.001)
    assert isinstance(backend, CarriesTool)
    backend.open(np.array(robot.positions["home"].joints))
    try:
        backend.set_tool(BARE)
        arm.tool = None
        hangs.set()

        def refused() -> str:
            try:
                backend.set_tool(BARE)
            except BackendError as exc:
                return str(exc)
            arm.tool = None
            return ""

        assert until(refused) == "the device has not answered for 0.5 s"
        assert arm.tool is None
        with pytest.raises(BackendError, match="has not answered for"):
            backend.disable()
    finally:
        going.set()
        backend.close()


def test_its_thread_is_not_as_urgent_as_the_cycle(settings: Settings, robot: RobotDescription) -> None:
    """Oracle: the kernel's word. SCHED_BATCH is inherited as SCHED_FIFO is, and any process may have it."""
    seen: dict[str, int] = {}

    class Looking(ToyArm):
        def state(self, measured: Measured) -> None:
            seen[threading.current_thread().name] = os.sched_getscheduler(0)
            super().state(measured)

    backend = as_backend(Looking(settings, robot.limits), robot.limits.dof, 0.001)

    def open_it() -> None:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        backend.open(np.array(robot.positions["home"].joints))

    cycle = threading.Thread(target=open_it, name="cycle")
    cycle.start()
    cycle.join()
    try:
        until(lambda: "device" in seen)
    finally:
        backend.close()
    assert seen == {"cycle": os.SCHED_BATCH, "device": os.SCHED_OTHER}


def test_it_is_made_from_the_settings(settings: Settings, robot: RobotDescription) -> None:
    section = settings.robot.backend.model_copy(update={"type": "rtloop.contract.toy_trajectory:ToyArm"})
    arm = settings.model_copy(update={"robot": settings.robot.model_copy(update={"backend": section})})
    made = make_backend(arm, robot.limits)
    assert isinstance(made, TrajectoryDriver)
    assert made.capabilities.trajectories
    assert made.device.state_period_s == STATE_PERIOD_S  # type: ignore[attr-defined]


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_a_device_with_quintics_between_the_points_keeps_the_jerk_of_the_path(
    robot: RobotDescription, share: float
) -> None:
    """Oracle: scipy's polynomials with these positions, velocities and accelerations. With even steps they
    need up to 1.7 times the jerk."""
    limits = robot.limits
    random = np.random.default_rng(7)
    places = random.uniform(0.9 * limits.min_position, 0.9 * limits.max_position, (6, limits.dof))
    for start, goal in itertools.pairwise(places):
        path = plan_ptp(robot, MotionRequest(start, goal, PlannerName.PTP, Scaling(1.0)), goal)
        times_s, rows = Motion(1, path.breakpoints_s, path.coefficients, share).points(0.02)
        steps_s = np.diff(times_s)
        assert (times_s[0], times_s[-1]) == (0.0, pytest.approx(path.duration_s / share))
        assert steps_s.min() >= 0.002 - 1e-9
        assert steps_s.max() <= 0.02 + 1e-9
        every_s = np.arange(0.0, times_s[-1], 1e-4)
        jerk = np.abs(BPoly.from_derivatives(times_s, rows.transpose(1, 0, 2))(every_s, 3))
        planned = np.abs(path.stretched(1.0 / share).sample(every_s, 3))
        assert (jerk / limits.max_jerk).max() <= 1.2 * (planned / limits.max_jerk).max()
