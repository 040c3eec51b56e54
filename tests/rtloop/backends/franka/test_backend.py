"""The Franka backend in the real cycle. Oracles: the published limits on each command that the robot gets,
packets lost or not; the sentences that a user reads."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from franka_settings import franka_settings
from rig import Rig

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.ipc.layout import Command
from cobot.planners.ptp import _in_phase
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import LoopMode
from rtloop.backends import (
    BackendError,
    ImpedanceControlled,
    Measured,
    Paced,
    Reporting,
    make_backend,
)
from rtloop.backends.franka import FrankaBackend, kinematics
from rtloop.backends.franka.bridge import Bridge
from rtloop.backends.franka.link import Knock
from rtloop.backends.franka.stand_in import START, FrankaStandIn
from rtloop.backends.franka.stand_in_library import NetworkException, RobotMode
from rtloop.backends.franka.words import MAX_ERRORS, active_errors, explained, in_words, said

VELOCITY = np.array([2.175] * 4 + [2.61] * 3)
ACCELERATION = np.array([10.0, 7.5, 10.0, 10.0, 10.0, 10.0, 10.0])
JERK = np.array([5000.0, 3750.0, 5000.0, 5000.0, 5000.0, 5000.0, 5000.0])
"""The least of what is published for the FR3 and the Panda: rad/s, rad/s², rad/s³."""
TORQUE_RATE = 1000.0
PERIOD_S = 0.001


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pylibfranka", FrankaStandIn().library)


@pytest.fixture(scope="module")
def franka() -> Settings:
    return franka_settings(address="robot.test")


@pytest.fixture(scope="module")
def fr3(franka: Settings) -> RobotDescription:
    return load_robot(franka)


@pytest.fixture
def rig(franka: Settings, fr3: RobotDescription) -> Iterator[Rig]:
    arm = FrankaStandIn()
    device = FrankaBackend(franka, fr3.limits, library=arm.library, knock=arm.knock)
    made = Rig(franka, fr3, backend=device)
    made.device, made.arm = device, arm
    yield made
    made.close()


def to(rig: Rig, goal: list[float]) -> Trajectory:
    return _in_phase(np.array(rig.loop.controller.safety.position), np.array(goal), rig.limits)


def require_published_limits(positions: list[np.ndarray]) -> None:
    """The robot's own reference, from rest on, keeps what is published."""
    all_of_them = np.array([positions[0]] * 3 + positions)
    for order, bound in enumerate((VELOCITY, ACCELERATION, JERK), start=1):
        rates = np.abs(np.diff(all_of_them, order, axis=0)).max(axis=0) / PERIOD_S**order
        assert (rates < bound).all(), f"derivative {order}: {rates} against {bound}"


GOAL = [0.5, -0.5, 0.3, -2.0, 0.3, 1.9, 0.2]


def test_it_is_what_the_cycle_can_use(rig: Rig, franka: Settings, fr3: RobotDescription) -> None:
    backend = make_backend(franka, fr3.limits)
    assert isinstance(backend, FrankaBackend)
    assert isinstance(backend, Paced)
    assert isinstance(backend, Reporting)
    assert isinstance(backend, ImpedanceControlled)


def test_a_motion_is_commanded_within_the_published_limits(rig: Rig) -> None:
    assert rig.start(to(rig, GOAL)) == ""
    rig.run()
    rig.step(300)
    assert rig.arm.q == pytest.approx(GOAL, abs=1e-3)
    assert rig.arm.q_d == pytest.approx(rig.loop.controller.safety.position, abs=1e-12), "nothing is added"
    require_published_limits(rig.arm.positions)


@pytest.mark.parametrize(("lost", "times", "apart"), [(1, 20, 60), (3, 12, 60), (8, 4, 300)])
def test_lost_packets_are_taken_up_where_the_robot_has_come_by_itself(
    rig: Rig, lost: int, times: int, apart: int
) -> None:
    assert rig.start(to(rig, GOAL)) == ""
    for _ in range(times):
        rig.step(apart)
        rig.arm.lose = lost
    rig.run()
    rig.step(1000)
    assert rig.arm.q == pytest.approx(GOAL, abs=1e-3)
    require_published_limits(rig.arm.positions)


def test_a_fault_of_ours_does_not_make_the_command_jump(rig: Rig) -> None:
    assert rig.start(to(rig, GOAL)) == ""
    rig.step(500)
    rig.arm.lose = 19  # the arm is 4 cm further on when the next state comes: no arm moves like that
    rig.step(1500)
    assert rig.mode is LoopMode.FAULT
    assert "jumped" in rig.reason
    assert rig.arm.controlled == "positions"
    velocities = np.diff(rig.arm.positions, axis=0) / PERIOD_S
    assert (np.abs(velocities) < VELOCITY).all()
    assert np.abs(np.diff(velocities, axis=0)).max() / PERIOD_S < 20.0
    assert np.abs(velocities[-1]).max() < 1e-6


@pytest.mark.parametrize("step", [3e-6, 6e-6, 5e-5, 3e-3])
def test_a_step_however_small_is_no_step_for_the_robot(step: float) -> None:
    """A reset goes on where the arm is measured, which is never quite where it was commanded to be."""
    bridge = Bridge(7, PERIOD_S)
    here = np.array([START, np.zeros(7), np.zeros(7)])
    bridge.begin(here[0])
    sent = [bridge.bridge(here, 1)[0].copy() for _ in range(10)]
    here[0] += step
    sent += [bridge.bridge(here, 1)[0].copy() for _ in range(1200)]
    require_published_limits(sent)
    assert sent[-1] == pytest.approx(here[0], abs=1e-12)


def test_what_is_measured_has_the_signs_of_cobot(rig: Rig) -> None:
    measured = Measured(7)
    rig.loop.step()
    rig_backend(rig).read(measured)
    assert measured.position == pytest.approx(rig.arm.q)
    assert measured.effort == pytest.approx(np.ones(7))
    assert measured.external_effort == pytest.approx(np.full(7, -0.25))
    assert measured.wrench == pytest.approx([-1, -2, -3, -4, -5, -6])


def rig_backend(rig: Rig) -> FrankaBackend:
    assert isinstance(rig.device, FrankaBackend)
    return rig.device


def test_a_reflex_is_a_fault_in_words_and_a_reset_recovers(rig: Rig) -> None:
    assert rig.start(to(rig, GOAL)) == ""
    rig.step(300)
    rig.arm.stop_by("joint_reflex")
    rig.step(200)
    assert rig.mode is LoopMode.FAULT
    assert "something pushed a joint harder than the collision thresholds allow" in rig.reason
    there = rig.arm.q.copy()
    assert rig_backend(rig).status().drives == "stopped by a reflex"
    assert reset(rig) == ""
    rig.step(500)
    assert rig.mode is LoopMode.HOLD
    assert rig.arm.recovered == 1
    assert rig.arm.q == pytest.approx(there, abs=2e-3), "it goes on where it is"
    require_published_limits(rig.arm.positions)


def test_no_cycle_of_a_reset_waits_for_more_than_one_reply(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot takes tens of milliseconds to reply to each."""
    replies: list[str] = []
    connection = type(rig.arm.connection)

    def note(name: str) -> None:
        inner: Any = getattr(connection, name)

        def noted(self: object, *values: object) -> object:
            replies.append(name)
            return inner(self, *values)

        monkeypatch.setattr(connection, name, noted)

    note("set_collision_behavior")
    note("set_joint_impedance")
    note("set_load")
    note("automatic_error_recovery")
    note("start_joint_position_control")
    backend = rig_backend(rig)
    backend._options = backend._options.model_copy(update={"joint_stiffness": [3000.0] * 7})
    rig.arm.stop_by("joint_reflex")
    rig.step(200)
    command, counts = rig.send(Command.RESET), []
    while rig.mode is LoopMode.FAULT:
        before = len(replies)
        rig.step()
        counts.append(len(replies) - before)
    assert rig.answer(command) == ""
    assert len(set(replies)) == len(replies) == 5
    assert max(counts) == 1


def test_a_reset_that_was_cut_short_is_begun_anew(rig: Rig) -> None:
    backend, arm = rig_backend(rig), rig.arm
    arm.stop_by("joint_reflex")
    rig.step(200)
    backend.recover_step()
    assert not backend.enable_step()
    arm.stop_by("joint_reflex")
    rig.step(5)
    assert reset(rig) == ""
    assert arm.recovered == 2


def reset(rig: Rig) -> str:
    return rig.answer(rig.send(Command.RESET))


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        (RobotMode.UserStopped, "the user stop is pressed"),
        (RobotMode.Guiding, "the arm is guided by hand"),
        (RobotMode.Other, "activate FCI in Desk"),
    ],
)
def test_what_only_a_hand_can_change_is_said(rig: Rig, mode: RobotMode, said: str) -> None:
    robot = rig.arm
    robot.stop_by("joint_reflex")
    rig.step(5)
    robot.mode, robot.errors = mode, set()
    rig.step(5)
    assert said in reset(rig)
    robot.mode = RobotMode.Idle
    rig.step(5)
    assert reset(rig) == ""


def test_a_model_of_another_arm_is_refused(
    franka: Settings, fr3: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle of the right one: the kinematics that Franka Robotics publishes, in the stand-in."""
    arm = FrankaStandIn()
    backend = FrankaBackend(franka, fr3.limits, library=arm.library, knock=arm.knock)
    arm.q = np.array([0.4, 0.3, -0.5, -1.9, 0.6, 1.2, 0.9])
    backend.open(arm.q)
    monkeypatch.setattr(kinematics, "FLANGE_M", 0.127)
    with pytest.raises(BackendError, match=r": 20.0 mm and 0.0 degrees apart"):
        backend.open(arm.q)
    told = FrankaBackend(
        franka_settings(address="robot.test", check_pose=False),
        fr3.limits,
        library=arm.library,
        knock=arm.knock,
    )
    told.open(arm.q)


def test_a_lost_connection_is_named(rig: Rig) -> None:
    rig.arm.fail = NetworkException("libfranka: UDP receive: Timeout")
    rig.step(5)
    assert rig.mode is LoopMode.FAULT
    assert "robot.test is lost: UDP receive: Timeout" in rig.reason
    assert rig_backend(rig).status().connection.startswith("the connection to robot.test is lost")
    rig.arm.faults.add("disconnect")
    assert "no answer" in reset(rig)
    rig.arm.faults.clear()
    assert reset(rig) == "", "by a connection of its own"
    rig.step(500)
    assert rig.mode is LoopMode.HOLD
    assert rig_backend(rig).status().connection == "connected"
    require_published_limits(rig.arm.positions)


def test_it_gives_way_by_torques_that_never_jump(rig: Rig) -> None:
    assert rig.stream(stiffness=200.0) == ""
    robot = rig.arm
    assert robot.controlled == "torques"
    rig.step(200)
    for _ in range(100):
        robot.q = robot.q + np.array([0.0005, 0, 0, 0, 0, 0, 0])
        rig.step()
    rig.step(10)
    torques = np.array(robot.torques)
    rates = np.abs(np.diff(np.vstack([np.zeros(7), torques]), axis=0)) / PERIOD_S
    assert rates.max() < TORQUE_RATE
    assert torques[-1][0] == pytest.approx(-200.0 * 0.05, rel=0.05), "the spring pulls it back"
    rig.end_stream()
    rig.step(500)
    assert robot.controlled == "positions"
    require_published_limits(robot.positions)


def test_springs_on_a_position_that_is_no_number_send_none(rig: Rig) -> None:
    """Oracle: each torque, and the published rate at which it may change."""
    assert rig.stream(stiffness=200.0) == ""
    robot = rig.arm
    for _ in range(100):
        robot.q = robot.q + np.array([0.0005, 0, 0, 0, 0, 0, 0])
        rig.step()
    assert abs(robot.torques[-1][0]) > 5.0
    robot.faults.add("nan")
    rig.step(200)
    assert rig.mode is LoopMode.FAULT
    torques = np.array(robot.torques)
    assert np.isfinite(torques).all()
    assert (np.abs(np.diff(torques, axis=0)) / PERIOD_S).max() < TORQUE_RATE
    assert not torques[-1].any()
    robot.faults.clear()
    rig.step(3000)
    assert reset(rig) == ""
    rig.step(500)
    assert rig.mode is LoopMode.HOLD


def test_a_robot_that_refuses_an_impedance_refuses_the_session(rig: Rig) -> None:
    rig.arm.refuses = "torques"
    assert "the robot cannot be made compliant: the robot rejects the command" in rig.stream(stiffness=200.0)
    rig.step(5)
    assert rig.mode is LoopMode.FAULT, "nobody controls it now"
    rig.arm.refuses = ""
    assert reset(rig) == ""
    assert rig.stream(stiffness=200.0) == ""


def test_a_robot_that_cannot_be_held_after_a_session_is_a_fault(rig: Rig) -> None:
    assert rig.stream(stiffness=200.0) == ""
    rig.step(100)
    rig.arm.refuses = "positions"
    rig.end_stream()
    rig.step(5000)
    assert rig.mode is LoopMode.FAULT
    assert "the robot cannot be held at its position: the robot rejects the command" in rig.reason
    assert "the robot rejects the command" in reset(rig)
    rig.arm.refuses = ""
    assert reset(rig) == ""
    rig.step(500)
    assert rig.mode is LoopMode.HOLD
    assert rig.arm.controlled == "positions"


def test_it_is_told_its_load_while_nobody_controls_it(rig: Rig) -> None:
    tool = Tool(version=1, mass=0.7, centre=(0.0, 0.0, 0.05))
    backend = rig_backend(rig)
    backend.set_tool(tool)
    assert rig.arm.told["set_load"] == (0.7, [0.0, 0.0, 0.05], [0.0] * 9)
    assert rig.arm.controlled == "positions"
    assert rig.start(to(rig, GOAL)) == ""
    rig.step(300)
    with pytest.raises(BackendError, match="this is possible only at rest"):
        backend.set_tool(Tool(version=2, mass=0.1))


def test_its_state_is_shown_in_words(rig: Rig) -> None:
    rig.step(10)
    rig.arm.lose = 2
    rig.step(10)
    status = rig_backend(rig).status()
    assert (status.connection, status.drives, status.packets_lost) == ("connected", "moving", 2)
    assert status.quality == "99 % of the commands arrive in time"
    assert status.text == status.safety_stop == ""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"address": "127.0.0.9"}, "cannot connect to 127.0.0.9, port 1337: Connection refused"),
        ({"address": "robot.test", "realtime": "enforce"}, "robot.backend.realtime: ignore"),
    ],
)
def test_what_keeps_it_from_opening_is_said(
    fr3: RobotDescription, options: dict[str, object], said: str
) -> None:
    arm = FrankaStandIn()
    arm.real_time = False
    knock = Knock if options["address"] != "robot.test" else arm.knock
    backend = FrankaBackend(franka_settings(**options), fr3.limits, library=arm.library, knock=knock)
    with pytest.raises(BackendError, match=said):
        backend.open(np.array(START))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"address": ""}, "robot.backend.address"),
        ({"adress": "robot.test"}, "adress"),
        ({"address": "robot.test", "joint_stiffness": [1.0]}, "robot.backend.joint_stiffness"),
        ({"address": "robot.test", "collision_force": [1e6] * 6}, "robot.backend.collision_force"),
    ],
)
def test_wrong_options_are_named(fr3: RobotDescription, options: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        make_backend(franka_settings(**options), fr3.limits)


def test_without_the_package_it_is_named(
    franka: Settings, fr3: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    with pytest.raises(BackendError, match=r"pip install 'cobot\[franka\]'"):
        FrankaBackend(franka, fr3.limits)


def test_another_arm_is_refused(franka: Settings) -> None:
    with pytest.raises(BackendError, match="a Franka has 7 joints, but this robot has 2"):
        FrankaBackend(franka, SimpleNamespace(dof=2))


class Silent(Exception):
    def __str__(self) -> str:
        raise SystemExit


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (NetworkException("libfranka: gone\n  for good"), "gone for good"),
        (NetworkException("\x1b[31mgone\0\ud800"), r"\x1b[31mgone\x00\ud800"),
        (Silent(), "(a Silent without a text, because its str() raises SystemExit)"),
    ],
)
def test_what_the_library_says_is_one_printable_line(error: Exception, words: str) -> None:
    assert said(error) == words


def test_what_the_library_says_is_bounded() -> None:
    """10 MB of text, and a state with ten thousand errors whose names are long."""
    text = said(NetworkException("[" + "cartesian_reflex, " * 600_000 + "]"))
    assert len(explained(text)) < 10_000
    state = SimpleNamespace(
        current_errors=SimpleNamespace(**{f"e{i}_" + "x" * 9_000: True for i in range(500)})
    )
    assert len(active_errors(state)) == MAX_ERRORS
    assert len(in_words(active_errors(state))) < 200 * MAX_ERRORS
    assert in_words(["joint_reflex", "new\x1b_error"]).endswith(r"; new\x1b error")
