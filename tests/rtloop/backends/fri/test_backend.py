"""The backend against a simulated cabinet, a period at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lockstep_fri import LockStep, fri_settings, joined

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool
from cobot.types import Array
from rtloop.backends import BackendError, Measured, Paced, Reporting, Stepwise, TorqueControlled
from rtloop.backends.beat import CommandTransition
from rtloop.backends.fri import FriBackend
from rtloop.backends.fri.codec import decode_command, decode_monitoring
from rtloop.backends.fri.encoding import encode_command, encode_monitoring
from rtloop.backends.fri.messages import (
    COMMAND_ID,
    MONITORING_ID,
    CommandMessage,
    CommandMode,
    FriHeader,
    MonitoringMessage,
    OperationMode,
    Quality,
    SessionState,
)
from rtloop.backends.fri.options import FriOptions
from rtloop.backends.fri.session import check_entry
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.fri.simulator.options import CabinetOptions
from rtloop.results import Rejected

WAIT_S = 0.25
ENOUGH = 400
"""Periods in which everything that a test waits for has happened."""


class Driven:
    """The backend, driven as rtloop does it."""

    def __init__(self, backend: FriBackend, channel: LockStep) -> None:
        self.backend, self.channel = backend, channel
        self.cabinet, self.network = channel.controller, channel.network
        self.measured = Measured(7)
        self.command = np.zeros((3, 7))
        self.problems: list[str] = []
        self.positions: list[Array] = []

    def cycle(self) -> bool:
        """Whether there was a beat."""
        beat = self.backend.wait(WAIT_S)
        try:
            self.backend.read(self.measured)
            if beat:
                self.backend.write(self.command)
        except BackendError as exc:
            self.problems.append(str(exc))
        self.positions.append(self.cabinet.arm.setpoint.copy())
        return beat

    def until(self, happened: Callable[[], object]) -> None:
        for _ in range(ENOUGH):
            if happened():
                return
            self.cycle()
        raise AssertionError(f"did not happen; {list(self.cabinet.events)}, {self.problems[-3:]}")

    def enable(self) -> None:
        """As after a reset; the command is then where the arm is measured."""
        self.backend.recover_step()
        self.until(self.backend.enable_step)
        self.command[:] = 0.0
        self.command[0] = self.measured.position

    def swing(self, periods: int, amplitude_rad: float = 0.2) -> None:
        """Joint 1 to and fro, with a velocity and an acceleration within the limits."""
        start, rate = self.command[0].copy(), 2.0
        for period in range(1, periods + 1):
            time_s = period * self.cabinet.period_s
            self.command[0] = start
            self.command[0, 0] += amplitude_rad * (1.0 - np.cos(rate * time_s))
            self.cycle()


def answered_by(packet: bytes) -> CommandMessage:
    answer = decode_command(packet)
    assert isinstance(answer, CommandMessage)
    return answer


Make = Callable[..., Driven]


@pytest.fixture
def make(settings: Settings, robot: RobotDescription) -> Make:
    def made(
        cabinet: CabinetOptions | None = None, network: FriNetwork | None = None, **options: Any
    ) -> Driven:
        backend, channel = joined(settings, robot, cabinet, network, **options)
        backend.open(np.zeros(7))
        return Driven(backend, channel)

    return made


def test_goes_through_all_five_states_and_moves_the_arm(make: Make) -> None:
    driven = make()
    assert isinstance(driven.backend, Paced)
    assert isinstance(driven.backend, Reporting)
    assert isinstance(driven.backend, Stepwise)
    assert isinstance(driven.backend, TorqueControlled)
    driven.enable()
    told = " ".join(driven.cabinet.events)
    for state in SessionState:
        assert state.name in told
    start = driven.measured.position.copy()
    driven.swing(400)
    assert not driven.problems
    assert driven.measured.position[0] == pytest.approx(driven.command[0, 0], abs=0.01)
    assert abs(driven.measured.position[0] - start[0]) > 0.1
    assert driven.backend.status().packets_lost == 0


def test_echoes_the_interpolator_while_the_motion_waits(make: Make) -> None:
    driven = make()
    driven.command[0] = 1.0  # far from where the arm is: nobody shall hear of it
    driven.until(lambda: driven.cabinet.state == SessionState.COMMANDING_WAIT)
    driven.channel.answers.clear()
    driven.cycle()
    driven.cycle()
    answer = decode_command(driven.channel.answers[-1])
    assert isinstance(answer, CommandMessage)
    assert answer.position == tuple(driven.cabinet.arm.setpoint.tolist())


def test_sends_no_command_before_it_is_enabled(make: Make) -> None:
    driven = make()
    driven.command[0] = 1.0
    driven.until(lambda: driven.cabinet.state == SessionState.COMMANDING_ACTIVE)
    held = driven.cabinet.arm.setpoint.copy()
    for _ in range(20):
        driven.cycle()
    np.testing.assert_array_equal(driven.cabinet.arm.setpoint, held)
    assert driven.cabinet.state == SessionState.COMMANDING_ACTIVE


@pytest.mark.parametrize("period_ms", [1, 2, 4, 5, 10])
def test_takes_every_period_that_it_says(make: Make, period_ms: int) -> None:
    driven = make(CabinetOptions(period_ms))
    driven.enable()
    driven.swing(500 // period_ms)
    assert not driven.problems


def test_a_wrong_period_is_named(settings: Settings, robot: RobotDescription) -> None:
    _, channel = joined(settings, robot, CabinetOptions(period_ms=4))
    backend = FriBackend(fri_settings(settings, 5), robot.limits, channel=channel, clock=channel.clock)
    with pytest.raises(BackendError, match=r"sends every 4 ms, but rt.period_s is 0.005 s: set it to 0.004"):
        backend.open(np.zeros(7))


@pytest.mark.parametrize(("spoken", "asked"), [("1.x", "2"), ("2.x", "1"), ("2.7", "1"), ("2.x", "2.7")])
def test_the_other_version_is_named(make: Make, spoken: str, asked: str) -> None:
    with pytest.raises(BackendError, match=f"uses FRI {spoken}, but robot.backend.version is {asked}"):
        make(CabinetOptions(version=spoken), version=asked)


@pytest.mark.parametrize(
    ("version", "asked"), [("1.x", "auto"), ("2.x", "auto"), ("2.7", "auto"), ("2.7", "2"), ("2.7", "2.7")]
)
def test_every_version_moves_the_arm(make: Make, version: str, asked: str) -> None:
    driven = make(CabinetOptions(version=version), version=asked)
    driven.enable()
    driven.swing(50)
    assert not driven.problems
    assert driven.backend.status().text == f"FRI {version}"


def test_answers_are_framed_as_the_controllers_messages_are(make: Make) -> None:
    """A client that answers without the frame gets no session, and an event says why."""
    driven = make(CabinetOptions(version="2.7"))
    driven.enable()
    answers = [decode_command(each) for each in driven.channel.answers]
    assert answers
    assert all(isinstance(each, CommandMessage) and each.framed for each in answers)
    plain = encode_command(CommandMessage(FriHeader(COMMAND_ID, 1, driven.cabinet.sequence), (0.0,) * 7))
    driven.cabinet.answer(plain)
    assert driven.cabinet.events[-1] == (
        "a command without the frame of FRI 2.7, but this cabinet uses FRI 2.7"
    )


def test_a_message_of_another_version_in_a_session_is_refused_by_name(make: Make) -> None:
    driven = make(CabinetOptions(version="2.7"))
    driven.enable()
    message = decode_monitoring(driven.cabinet.packet())
    assert isinstance(message, MonitoringMessage)
    driven.channel.injected = [encode_monitoring(replace(message, framed=False))] * 3
    driven.swing(3)
    assert "in a session of FRI 2.7: all messages of a session have one version" in driven.backend._refused


def test_says_that_nobody_is_there_and_what_else_came(settings: Settings, robot: RobotDescription) -> None:
    backend, channel = joined(settings, robot, connect_s=1.0)
    channel.off = True
    with pytest.raises(
        BackendError, match="no packet on UDP port 30200: is the controller's program running"
    ):
        backend.open(np.zeros(7))
    channel.off, channel.controller.packet = (
        False,
        lambda: encode_command(CommandMessage(FriHeader(COMMAND_ID, 1, 1))),
    )
    with pytest.raises(
        BackendError, match="The last packet was rejected: a message 0x34001 instead of 0x245142"
    ):
        backend.open(np.zeros(7))


def test_commands_begin_where_the_interpolator_is(make: Make) -> None:
    """In an impedance the arm is beside it: no jump, and the difference fades."""
    driven = make(CabinetOptions(command_mode=CommandMode.TORQUE, control_mode=2), overlay="torque")
    driven.cabinet.arm.push[:] = [0.0, 0.0, -30.0, 0.0, 0.0, 0.0]
    for _ in range(50):
        driven.cycle()
    driven.enable()
    apart = np.abs(driven.measured.position - driven.cabinet.arm.setpoint).max()
    assert apart > 1e-3
    driven.positions.clear()
    for _ in range(400):
        driven.cycle()
    steps = np.abs(np.diff(driven.positions, axis=0)).max(axis=0)
    assert (
        steps.max() < 3.0 * apart * driven.cabinet.period_s
    )  # smooth: nowhere faster than 1.875 of the mean
    np.testing.assert_allclose(driven.cabinet.arm.setpoint, driven.command[0], atol=1e-9)


def test_an_arm_beside_its_interpolator_is_not_enabled(make: Make) -> None:
    driven = make(entry_rad=0.001)
    driven.cabinet.arm.push[:] = [0.0, 0.0, -140.0, 0.0, 0.0, 0.0]
    with pytest.raises(BackendError, match=r"from the controller's interpolator, allowed: 0.001 rad"):
        driven.enable()


def test_a_position_of_300_digits_is_said_in_a_few(make: Make) -> None:
    message = replace(make().backend._newest, measured_position=(1e300,) * 7)
    result = check_entry(message, FriOptions(), ("joint1",) * 7, (0.0,) * 7)
    assert isinstance(result, Rejected)
    assert result.reason.startswith("joint1 is 1e+300 rad from")


def test_an_arm_that_does_not_follow_is_not_enabled(make: Make) -> None:
    driven = make(min_tracking=1.0, entry_rad=0.2)
    driven.cabinet.arm.push[:] = [0.0, 0.0, -140.0, 0.0, 0.0, 0.0]
    with pytest.raises(
        BackendError,
        match=r"tracking performance of the arm is 0\.\d+; "
        r"at least 1.0 is needed",
    ):
        driven.enable()


def test_another_overlay_is_named(make: Make) -> None:
    driven = make(CabinetOptions(command_mode=CommandMode.TORQUE))
    with pytest.raises(BackendError, match=r"accepts TORQUE, but robot.backend.overlay is position"):
        driven.enable()


@pytest.mark.parametrize("overlay", ["torque", "wrench"])
def test_torques_and_wrenches_are_laid_over(make: Make, overlay: str) -> None:
    control = 2 if overlay == "torque" else 1
    driven = make(
        CabinetOptions(command_mode=CommandMode[overlay.upper()], control_mode=control), overlay=overlay
    )
    driven.enable()
    assert not driven.problems
    rest = driven.cabinet.arm.measured.position.copy()
    if overlay == "torque":
        driven.backend.write_torque(np.array([8.0, 0, 0, 0, 0, 0, 0]))
    else:
        driven.backend.write_wrench(np.array([0.0, 20.0, 0, 0, 0, 0]))
    for _ in range(200):
        driven.cycle()
    moved = driven.cabinet.arm.measured.position - rest
    assert moved[0] > 0.001
    assert np.abs(driven.measured.external_effort).max() < 5.0  # what the client asked for is not external
    assert getattr(driven.backend.capabilities, overlay)


def safety_stop(driven: Driven) -> Callable[[], None]:
    driven.cabinet.stop_safely(1)
    return lambda: driven.cabinet.stop_safely(-1)


def mode_change(driven: Driven) -> Callable[[], None]:
    driven.cabinet.switch_mode(OperationMode.T2)
    return lambda: driven.cabinet.switch_mode(OperationMode.AUT)


def closed_session(driven: Driven) -> Callable[[], None]:
    driven.cabinet.close_session("for a test")
    return lambda: None


def pulled_cable(driven: Driven) -> Callable[[], None]:
    driven.channel.off = True

    def back() -> None:
        driven.channel.off = False

    return back


def loss(driven: Driven) -> Callable[[], None]:
    driven.network.loss = 0.9

    def back() -> None:
        driven.network.loss = 0.0

    return back


def lateness(driven: Driven) -> Callable[[], None]:
    driven.network.delay = 3

    def back() -> None:
        driven.network.delay = 0

    return back


FAULTS = [safety_stop, mode_change, closed_session, pulled_cable, loss, lateness]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda each: each.__name__)
def test_comes_back_after_every_fault_without_a_jump(
    make: Make, fault: Callable[[Driven], Callable[[], None]]
) -> None:
    driven = make()
    driven.enable()
    driven.swing(100)
    end = fault(driven)
    driven.until(lambda: driven.problems)
    reason = driven.problems[-1]
    assert "no commands" in reason or "no packet" in reason
    driven.command[1:] = 0.0
    for _ in range(40):
        driven.cycle()
    end()
    for _ in range(40):
        driven.cycle()
    driven.positions.clear()
    motions = driven.cabinet.motions
    driven.enable()
    driven.problems.clear()
    driven.swing(200)
    assert not driven.problems
    assert driven.cabinet.state == SessionState.COMMANDING_ACTIVE
    assert driven.cabinet.motions <= motions + 1
    limits = driven.cabinet.arm.limits
    steps = np.abs(np.diff(driven.positions, axis=0)) / driven.cabinet.period_s
    assert (steps <= limits.max_velocity).all()


def test_each_cycle_after_an_ended_motion_reports_that_the_arm_does_not_follow(make: Make) -> None:
    """Also the cycles of lost packets, which have no answer. Otherwise rtloop waits for measured values that
    change, and rejects each reset of an arm that rests.
    """
    driven = make()
    driven.enable()
    driven.swing(100)
    end = safety_stop(driven)
    driven.until(lambda: driven.problems)
    end()
    driven.problems.clear()
    driven.network.drop = 10
    for _ in range(12):
        assert driven.cycle()
    assert driven.backend.status().packets_lost >= 10
    assert len(driven.problems) == 12
    assert all("safety stop 1" in each for each in driven.problems)


@pytest.mark.parametrize("speed_rad_s", [0.0, 0.3])
def test_a_motion_that_a_short_safety_stop_has_ended_is_not_begun_anew_before_a_reset(
    make: Make, speed_rad_s: float
) -> None:
    """The cabinet may take commands again while rtloop still brakes, or has come to rest elsewhere."""
    driven = make()
    driven.enable()
    driven.swing(100)
    end = safety_stop(driven)
    driven.until(lambda: driven.problems)
    end()

    def brake() -> None:
        driven.command[0, 0] += speed_rad_s * driven.cabinet.period_s
        driven.command[1, 0] = speed_rad_s
        driven.cycle()

    driven.command[0, 0] += 0.02
    while driven.cabinet.state != SessionState.COMMANDING_ACTIVE:
        brake()
    motions, rest = driven.cabinet.motions, driven.cabinet.arm.setpoint.copy()
    for _ in range(60):
        brake()
    assert np.array_equal(driven.cabinet.arm.setpoint, rest)
    assert "safety stop 1" in driven.problems[-1]
    driven.enable()
    driven.problems.clear()
    driven.swing(200)
    assert not driven.problems
    assert driven.cabinet.motions == motions
    assert abs(driven.measured.position[0] - rest[0]) > 0.1


def test_a_safety_stop_is_named_when_the_robot_is_to_be_enabled(make: Make) -> None:
    driven = make()
    driven.enable()
    driven.cabinet.stop_safely(0)
    driven.until(lambda: driven.problems)
    driven.backend.recover_step()
    with pytest.raises(BackendError, match="safety stop 0: the drives are off and the brakes applied"):
        driven.backend.enable_step()
    status = driven.backend.status()
    assert (status.drives, status.brakes) == ("off", "applied")
    assert status.safety_stop.startswith("safety stop 0")


def test_a_change_of_the_operation_mode_in_a_motion_is_named(make: Make) -> None:
    driven = make()
    driven.enable()
    driven.swing(20)
    driven.cabinet.switch_mode(OperationMode.T1)
    driven.until(lambda: driven.problems)
    assert "the operation mode is T1: a change of the mode ends the motion" in driven.problems[0]


def test_says_in_which_state_it_waited_in_vain(make: Make) -> None:
    driven = make(enable_s=1.0)
    driven.cabinet._may_move = lambda: False
    with pytest.raises(
        BackendError, match=r"has not begun its motion with the FRI overlay \(session MONITORING_R"
    ):
        driven.until(driven.backend.enable_step)


@pytest.mark.parametrize(
    "network", [FriNetwork(1, loss=0.05), FriNetwork(2, reorder=0.05)], ids=["loss", "reorder"]
)
def test_moves_through_five_percent_of_loss_or_reordering(make: Make, network: FriNetwork) -> None:
    driven = make(network=network)
    driven.enable()
    driven.swing(2000)
    assert not driven.problems
    assert driven.cabinet.motions == 1
    assert driven.measured.position[0] == pytest.approx(driven.command[0, 0], abs=0.02)
    assert network.lost or network.reorder


def test_a_cycle_runs_for_every_packet_that_was_lost(make: Make) -> None:
    driven = make()
    driven.enable()
    driven.swing(50)
    driven.network.drop = 3
    before, sequence = len(driven.positions), driven.cabinet.sequence
    seen = []
    for _ in range(8):
        assert driven.cycle()
        seen.append(driven.measured.position[0])
    assert len(driven.positions) - before == (driven.cabinet.sequence - sequence)
    assert driven.backend.status().packets_lost == 3
    assert len(set(seen)) == len(seen)  # none of them stands still


@pytest.mark.parametrize("period_ms", [1, 2, 5])
@pytest.mark.parametrize("pause", [1, 12])
def test_packets_that_pile_up_get_a_cycle_each(make: Make, period_ms: int, pause: int) -> None:
    """On the wire: what was commanded of each packet is where the path is at that packet's time."""
    driven = make(CabinetOptions(period_ms))
    driven.enable()
    path = driven.command[0, 0]
    for _ in range(int(CommandTransition.FADE_S / driven.cabinet.period_s)):
        driven.cycle()
    first, step = driven.cabinet.sequence, 0.5 * driven.cabinet.period_s
    driven.channel.answers.clear()
    for cycle in range(60):
        driven.channel.pause = pause if cycle in (20, 40) else 0
        driven.command[0, 0] += min(cycle + 1, 10) / 10 * step
        assert driven.cycle()
    assert not driven.problems
    sent = [answered_by(packet) for packet in driven.channel.answers]
    assert len(sent) == 60 - 2 * pause
    for answer in sent:
        cycles = np.arange(1, answer.header.reflected - first + 1)
        assert answer.position[0] == pytest.approx(path + (np.minimum(cycles, 10) / 10 * step).sum())


@pytest.mark.parametrize("period_ms", [1, 10])
def test_a_long_gap_is_not_caught_up_with(make: Make, period_ms: int) -> None:
    driven = make(CabinetOptions(period_ms), silence_s=5.0)
    driven.enable()
    driven.cabinet.connection._close_after = 1000
    most = 100 // period_ms
    for gap, due in ((most - 1, most - 1), (most, 0)):
        sequence, driven.network.drop = driven.cabinet.sequence, gap
        driven.backend.wait(5.0)
        assert driven.cabinet.sequence - sequence == gap + 1
        assert driven.backend._beat.due == due
        for _ in range(due):
            driven.backend.wait(5.0)


def test_silence_is_a_fault_until_packets_come_again(make: Make) -> None:
    driven = make()
    driven.enable()
    driven.channel.off = True
    assert not driven.cycle()
    assert "no packet from the robot controller for 0.2" in driven.problems[-1]
    assert driven.backend.status().connection == "SILENT"
    driven.channel.off = False
    driven.until(lambda: driven.backend.status().connection != "SILENT")
    driven.problems.clear()
    driven.cycle()
    assert not any("no packet" in problem for problem in driven.problems)


def test_packets_that_are_refused_are_not_called_silence(make: Make) -> None:
    """And what was refused before the network failed is not its cause."""
    driven = make()
    driven.enable()
    six = MonitoringMessage(FriHeader(MONITORING_ID, 1, 0), measured_position=(0.0,) * 6)
    driven.channel.injected = [encode_monitoring(six)]
    driven.cycle()
    driven.channel.off = True
    driven.cycle()
    assert "the network is down" in driven.problems[-1]
    driven.channel.off = False
    driven.cycle()
    problems = len(driven.problems)
    packet = driven.cabinet.packet
    driven.cabinet.packet = lambda: packet() and encode_monitoring(six)
    driven.until(lambda: len(driven.problems) > problems)
    said = "the last one was rejected: the controller's robot has 6 joints, but the model has 7"
    assert said in driven.problems[-1]
    assert "network" not in driven.problems[-1]
    assert said in driven.backend.status().text


@pytest.mark.thorough
@given(packets=st.lists(st.binary(max_size=100), max_size=5))
def test_rubbish_between_the_packets_does_not_disturb(
    settings: Settings, robot: RobotDescription, packets: list[bytes]
) -> None:
    backend, channel = joined(settings, robot)
    channel.injected = packets
    backend.open(np.zeros(7))
    channel.injected = packets
    assert backend.wait(WAIT_S)
    assert backend.status().connection == "MONITORING_WAIT"


def test_answers_as_often_as_the_multiplier_says(make: Make) -> None:
    driven = make(CabinetOptions(period_ms=1, multiplier=5))
    driven.enable()
    driven.channel.answers.clear()
    driven.swing(500)
    assert not driven.problems
    assert len(driven.channel.answers) == 100


def test_options_are_checked(settings: Settings, robot: RobotDescription) -> None:
    for options, text in (
        ({"addres": "1.2.3.4"}, "unknown key 'addres'"),
        ({"address": "robot"}, "'robot' is not an IPv4 address"),
        ({"port": 0}, "port"),
        ({"port": True}, "port: must be an integer, got true"),
        ({"overlay": "pose"}, "overlay"),
    ):
        with pytest.raises(ConfigError, match=text):
            FriBackend(fri_settings(settings, 5, **options), robot.limits)


@pytest.mark.parametrize("version", ["1.x", "2.x"])
def test_an_arm_that_is_not_where_the_model_has_it_is_refused(
    settings: Settings, robot: RobotDescription, version: str
) -> None:
    """FRI 2.x tells where the flange is, 1.x does not."""
    cell = CabinetOptions(version=version)
    for off_mm, refused in ((3.0, False), (8.0, version == "2.x")):
        backend, channel = joined(settings, robot, cell)
        pose = channel.controller.arm.pose()
        channel.controller.arm.pose = lambda pose=pose, off_mm=off_mm: (pose[0] + off_mm, *pose[1:])
        if refused:
            with pytest.raises(BackendError, match=r": 8.0 mm and 0.0 degrees apart"):
                backend.open(np.zeros(7))
            backend, other = joined(settings, robot, cell, check_pose=False)
            other.controller.arm.pose = channel.controller.arm.pose
        backend.open(np.zeros(7))


def test_planned_motions_keep_the_reduced_speed_of_t1(make: Make, robot: RobotDescription) -> None:
    """Oracle: no pose and direction of the joints' greatest speeds makes the TCP faster than 0.25 m/s,
    neither that of the model nor that of a tool.
    """
    driven = make(CabinetOptions(operation_mode=OperationMode.T1))
    rng, limits, model = np.random.default_rng(7), robot.limits, robot.model
    for beyond_m in (0.0, 0.4):
        driven.backend.set_tool(Tool(1, tcp=(beyond_m, *model.file_tcp_in_flange[1:])))
        share, fastest = driven.backend.status().speed_scaling, 0.0
        for joints in rng.uniform(limits.min_position, limits.max_position, (500, 7)):
            velocity = share * limits.max_velocity * rng.choice([-1.0, 1.0], (32, 7))
            lever = np.array(
                quaternion.rotated(model.forward(joints).quaternion.tolist(), [beyond_m, 0.0, 0.0])
            )
            moves, turns = np.split(velocity @ model.jacobian(joints).T, 2, axis=1)
            fastest = max(fastest, float(np.linalg.norm(moves + np.cross(turns, lever), axis=1).max()))
        assert 0.12 < fastest < 0.25
    driven.cabinet.switch_mode(OperationMode.T2)
    driven.cycle()
    driven.cycle()
    assert driven.backend.status().speed_scaling == 1.0


def test_says_how_it_is(make: Make) -> None:
    driven = make(CabinetOptions(operation_mode=OperationMode.T1))
    driven.enable()
    status = driven.backend.status()
    assert (status.connection, status.quality) == ("COMMANDING_ACTIVE", "EXCELLENT")
    assert (status.operation_mode, status.drives, status.brakes) == ("T1", "on", "released")
    assert status.device_time_s == pytest.approx(driven.cabinet.sequence * 0.005)


def test_starts_before_the_controllers_program_and_takes_over_by_a_reset(make: Make) -> None:
    driven = make(enable_s=1.0)
    driven.cabinet.stop_safely(1)
    driven.backend.enable()
    driven.cycle()
    assert "accepts no commands: safety stop 1" in driven.problems[-1]
    with pytest.raises(BackendError, match="safety stop 1"):
        driven.backend.enable()
    driven.cabinet.stop_safely(-1)
    driven.cycle()
    driven.backend.enable()
    driven.problems.clear()
    driven.command[0] = driven.cabinet.arm.setpoint
    driven.swing(50)
    assert not driven.problems


def test_enabling_answers_each_packet_once_before_it_waits_for_the_next(make: Make) -> None:
    """A controller that is patient sends none before it is answered: both would wait for each other."""
    driven = make()
    first = driven.cabinet.sequence
    driven.backend.enable()
    reflected = [answered_by(packet).header.reflected for packet in driven.channel.answers]
    assert reflected == list(range(first, driven.cabinet.sequence + 1))
    assert driven.cabinet.connection.missing == 0
    driven.backend.write(driven.command)  # of the cycle that has enabled it: far from where the arm is
    assert len(driven.channel.answers) == len(reflected)


def test_a_session_that_begins_anew_just_after_it_was_enabled_is_no_fault(make: Make) -> None:
    """As when this computer takes its time between opening and the first cycle."""
    driven = make()
    driven.enable()
    driven.cabinet.close_session("for a test")
    driven.command[0] = driven.cabinet.arm.setpoint
    driven.backend._options = driven.backend._options.model_copy(update={"silence_s": 5.0})
    driven.until(lambda: driven.cabinet.motions == 2)
    driven.swing(50)
    assert not driven.problems


def test_a_motion_while_the_session_begins_anew_is_a_fault_that_names_it(make: Make) -> None:
    """Nothing takes its commands: the arm would fall behind by as much as is tolerated."""
    driven = make()
    driven.enable()
    driven.cabinet.switch_mode(OperationMode.T1)
    driven.command[1, 0] = 0.1
    driven.swing(3)
    assert "accepts no commands: the controller's program has not begun its motion" in driven.problems[0]


def test_a_command_far_from_the_interpolator_is_never_sent(make: Make) -> None:
    driven = make()
    driven.enable()
    held = driven.cabinet.arm.setpoint.copy()
    driven.command[0, 3] += 0.06
    for _ in range(20):
        driven.cycle()
    assert "joint4 is commanded 0.0600 rad from the controller's interpolator" in driven.problems[-1]
    assert driven.cabinet.state == SessionState.COMMANDING_ACTIVE
    np.testing.assert_array_equal(driven.cabinet.arm.setpoint, held)


def test_what_was_commanded_last_is_held_while_the_quality_is_low(make: Make) -> None:
    """Not the interpolator's position: that is where the motion began."""
    driven = make()
    driven.enable()
    begun = driven.cabinet.arm.setpoint[0]
    driven.swing(100)
    driven.channel.answers.clear()
    packet = driven.cabinet._message

    def poor() -> MonitoringMessage:
        return replace(packet(), quality=Quality.FAIR)

    driven.cabinet._message = poor
    driven.cycle()
    answer = decode_command(driven.channel.answers[-1])
    assert isinstance(answer, CommandMessage)
    np.testing.assert_allclose(answer.position, driven.cabinet.arm.setpoint, atol=5e-3)
    assert abs(answer.position[0] - begun) > 0.05
    assert "accepts commands from GOOD on" in driven.problems[-1]
