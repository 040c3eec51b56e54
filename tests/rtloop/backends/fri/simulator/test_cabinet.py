"""The simulated cabinet: its states, its quality, its reflexes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from lockstep_fri import made_cabinet

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends.fri import wire
from rtloop.backends.fri.codec import decode_monitoring
from rtloop.backends.fri.encoding import encode_command
from rtloop.backends.fri.messages import (
    COMMAND_ID,
    CommandMessage,
    CommandMode,
    FriHeader,
    IoDirection,
    IoType,
    IoValue,
    MonitoringMessage,
    OperationMode,
    Quality,
    SafetyState,
    SessionState,
)
from rtloop.backends.fri.simulator.cabinet import Cabinet
from rtloop.backends.fri.simulator.connection import ClientConnection
from rtloop.backends.fri.simulator.options import NEEDED_CONTROL, CabinetOptions

ENOUGH = 300


class Client:
    """The least client: echoes the interpolator, then adds to it what a test says."""

    def __init__(self, cabinet: Cabinet) -> None:
        self.cabinet = cabinet
        self.sequence = 0
        self.add = np.zeros(7)
        self.laid: dict[str, tuple[float, ...]] = {}
        self.silent = False
        self.seen: MonitoringMessage | None = None

    def period(self) -> None:
        packet = self.cabinet.packet()
        if not packet:
            return
        message = decode_monitoring(packet)
        assert isinstance(message, MonitoringMessage)
        self.seen = message
        if self.silent or message.state == SessionState.IDLE:
            return
        self.sequence += 1
        position: tuple[float, ...] = ()
        if message.ipo_position:
            position = tuple((np.array(message.ipo_position) + self.add).tolist())
        header = FriHeader(COMMAND_ID, self.sequence, message.header.sequence)
        self.cabinet.answer(encode_command(CommandMessage(header, position, **self.laid)))

    def until(self, state: SessionState) -> None:
        for _ in range(ENOUGH):
            if self.cabinet.state == state:
                return
            self.period()
        raise AssertionError(list(self.cabinet.events))


Make = Callable[..., Client]


@pytest.fixture
def make(settings: Settings, robot: RobotDescription) -> Make:
    return lambda options=None: Client(made_cabinet(settings, robot, options))


def test_goes_from_state_to_state_with_a_client_that_answers(make: Make) -> None:
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    assert [event.split(":")[0] for event in client.cabinet.events] == [
        "IDLE -> MONITORING_WAIT",
        "MONITORING_WAIT -> MONITORING_READY",
        "MONITORING_READY -> COMMANDING_WAIT",
        "COMMANDING_WAIT -> COMMANDING_ACTIVE",
    ]


def test_waits_for_a_client(make: Make) -> None:
    client = make()
    client.silent = True
    for _ in range(ENOUGH):
        client.period()
    assert client.cabinet.motions == 0
    assert client.cabinet.quality == Quality.POOR
    client.silent = False
    client.until(SessionState.COMMANDING_ACTIVE)


def test_the_interpolator_stays_where_the_motion_began(make: Make) -> None:
    """It is what an overlay is laid on: a client that adds to it does not add to its own command."""
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    begun = np.array(client.seen.ipo_position)
    for _ in range(100):
        client.add[0] += 0.001
        client.period()
    np.testing.assert_array_equal(client.seen.ipo_position, begun)
    assert client.cabinet.arm.setpoint[0] - begun[0] == pytest.approx(0.099, abs=1e-6)
    assert client.seen.measured_position[0] - begun[0] == pytest.approx(0.098, abs=0.005)


@pytest.mark.parametrize(
    ("add", "text"),
    [
        (0.3, "is commanded to move at 60 rad/s, but its limit is 1.484 rad/s"),
        (0.005, "jumps: its velocity changes by 1 rad/s in 5 ms"),
        (float("nan"), "commands a position that is not finite"),
        (float("inf"), "commands a position that is not finite"),
        (5.0, "its limits are -2.970 and 2.970 rad"),
        (1e300, "joint1 is commanded to 1e+300 rad"),
    ],
)
def test_a_command_that_no_robot_takes_ends_the_motion(make: Make, add: float, text: str) -> None:
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    client.period()
    held = client.cabinet.arm.setpoint.copy()
    client.add[0] = add
    client.period()
    assert client.cabinet.state == SessionState.MONITORING_READY
    assert text in client.cabinet.events[-1]
    client.add[:] = 0.0
    client.period()
    np.testing.assert_array_equal(client.cabinet.arm.setpoint, held)
    client.until(SessionState.COMMANDING_ACTIVE)


@pytest.mark.parametrize(
    ("overlay", "value", "text"),
    [
        (CommandMode.TORQUE, float("nan"), "the client commands a torque that is not finite"),
        (CommandMode.TORQUE, float("inf"), "the client commands a torque that is not finite"),
        (CommandMode.WRENCH, float("nan"), "the client commands a wrench that is not finite"),
        (CommandMode.WRENCH, -1e200, "a wrench of -1e+200, allowed: 1000 N or N·m"),
    ],
)
def test_an_overlay_that_no_robot_takes_ends_the_motion_and_moves_nothing(
    make: Make, overlay: CommandMode, value: float, text: str
) -> None:
    name, count = overlay.name.lower(), 7 if overlay == CommandMode.TORQUE else 6
    client = make(CabinetOptions(command_mode=overlay, control_mode=NEEDED_CONTROL[overlay]))
    client.laid[name] = (0.0,) * count
    client.until(SessionState.COMMANDING_ACTIVE)
    client.period()
    measured = client.cabinet.arm.measured.position.copy()
    client.laid[name] = (value,) * count
    client.period()
    assert client.cabinet.state == SessionState.MONITORING_READY
    assert text in client.cabinet.events[-1]
    client.period()
    np.testing.assert_allclose(client.cabinet.arm.measured.position, measured, atol=1e-3)


def test_a_motion_does_not_begin_beside_its_interpolator(make: Make) -> None:
    client = make()
    client.add[2] = 0.01
    for _ in range(60):
        client.period()
    told = " ".join(client.cabinet.events)
    assert "joint3 is commanded 0.01 rad from the interpolator" in told
    assert client.cabinet.motions == 0


def test_the_tcp_is_slow_in_t1(make: Make) -> None:
    for mode, ends in ((OperationMode.AUT, False), (OperationMode.T1, True)):
        client = make(CabinetOptions(operation_mode=mode))
        client.until(SessionState.COMMANDING_ACTIVE)
        for step in range(100):
            client.add[0] += min(0.0006 * step, 0.006)
            client.period()
            if client.cabinet.state != SessionState.COMMANDING_ACTIVE:
                break
        told = any("in T1 the maximum is 0.25 m/s" in event for event in client.cabinet.events)
        assert told is ends


def test_a_client_that_falls_silent_loses_motion_and_session(make: Make) -> None:
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    client.silent = True
    client.until(SessionState.IDLE)
    assert "no answer to 20 messages" in client.cabinet.events[-1]
    told = " ".join(client.cabinet.events)
    assert "COMMANDING_ACTIVE -> MONITORING_WAIT: the quality of the connection is" in told or (
        "COMMANDING_ACTIVE -> IDLE" in told
    )
    client.silent = False
    client.until(SessionState.COMMANDING_ACTIVE)


def test_an_arm_that_moves_brakes_when_its_motion_ends(make: Make) -> None:
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    for step in range(60):
        client.add[0] += min(0.0002 * step, 0.005)
        client.period()
    client.cabinet.stop_safely(1)
    positions = []
    for _ in range(100):
        client.period()
        positions.append(client.cabinet.arm.setpoint[0])
    assert client.cabinet.state == SessionState.MONITORING_READY
    assert client.cabinet.safety == SafetyState.SAFETY_STOP_LEVEL_1
    velocity = np.diff(positions) / 0.005
    assert velocity[0] > 0.5
    assert velocity[-1] == 0.0
    assert np.abs(np.diff(velocity)).max() / 0.005 == pytest.approx(10.0, rel=0.01)
    client.cabinet.stop_safely(-1)
    client.add[:] = 0.0
    client.until(SessionState.COMMANDING_ACTIVE)


def test_rubbish_is_counted_and_nothing_else(make: Make) -> None:
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    client.cabinet.answer(b"rubbish")
    assert client.cabinet.malformed == 1
    client.period()
    assert client.cabinet.state == SessionState.COMMANDING_ACTIVE


@pytest.mark.parametrize(
    ("kind", "value", "text"),
    [
        (IoType.BOOLEAN, float("nan"), "Out is boolean: the value must be 0 or 1, got nan"),
        (IoType.BOOLEAN, 7.0, "Out is boolean: the value must be 0 or 1, got 7"),
        (
            IoType.DIGITAL,
            float("inf"),
            "Out is digital: the value must be a whole number from 0 to 9007199254740991, got inf",
        ),
        (
            IoType.DIGITAL,
            -1.0,
            "Out is digital: the value must be a whole number from 0 to 9007199254740991, got -1",
        ),
        (IoType.ANALOG, float("-inf"), "Out: the value is not finite"),
    ],
)
def test_an_output_that_is_no_number_of_its_kind_is_not_set(
    make: Make, kind: IoType, value: float, text: str
) -> None:
    client = make(CabinetOptions(io=(IoValue("Out", kind, IoDirection.OUTPUT, 1.0),)))
    client.until(SessionState.COMMANDING_ACTIVE)
    output = wire.bytes_field(1, b"Out") + wire.number_field(2, kind) + wire.number_field(3, 1)
    output = wire.bytes_field(2, wire.bytes_field(5, output + wire.double_field(5, value)))
    client.cabinet.packet()
    header = FriHeader(COMMAND_ID, client.sequence + 1, client.cabinet.sequence)
    client.cabinet.answer(encode_command(CommandMessage(header)) + output)
    client.silent = True
    client.period()
    assert text in client.cabinet.events[-1]
    assert client.seen.io[0].value == 1.0


def test_answers_of_the_past_and_of_the_future_do_not_count(make: Make) -> None:
    client = make()
    client.until(SessionState.COMMANDING_ACTIVE)
    ahead = client.cabinet.sequence + 5
    client.cabinet.answer(encode_command(CommandMessage(FriHeader(COMMAND_ID, 10_000, ahead), (9.0,) * 7)))
    client.cabinet.answer(
        encode_command(CommandMessage(FriHeader(COMMAND_ID, 1, client.cabinet.sequence), (9.0,) * 7))
    )
    client.period()
    assert client.cabinet.state == SessionState.COMMANDING_ACTIVE


@pytest.mark.parametrize(
    ("every", "quality"),
    [(1, Quality.EXCELLENT), (10, Quality.GOOD), (2, Quality.FAIR), (1000, Quality.POOR)],
)
def test_quality_is_what_share_of_the_messages_is_answered(every: int, quality: Quality) -> None:
    connection = ClientConnection(period_ms=5, multiplier=1)
    for number in range(100):
        answered = every == 1 or (number % every == 0) != (every == 10)
        if answered and every != 1000:
            assert connection.take_answer(number + 1, number, number)
        connection.judge(number)
    assert connection.quality == quality


def test_answers_that_are_a_period_late_are_worth_half() -> None:
    connection = ClientConnection(period_ms=5, multiplier=1)
    for number in range(100):
        if number:
            connection.take_answer(number, number - 1, number)
        connection.judge(number)
    assert connection.quality in (Quality.POOR, Quality.FAIR)
    assert connection.late > 90


@pytest.mark.parametrize("period_ms", [0, 101])
def test_periods_are_those_of_fri(period_ms: int) -> None:
    with pytest.raises(ValueError, match="FRI allows 1 to 100 ms"):
        CabinetOptions(period_ms)


@pytest.mark.parametrize("period_ms", [1, 10, 100])
def test_the_arm_stands_still_while_nobody_moves_it(make: Make, period_ms: int) -> None:
    client = make(CabinetOptions(period_ms))
    client.until(SessionState.COMMANDING_ACTIVE)
    np.testing.assert_allclose(client.seen.measured_position, client.seen.ipo_position, atol=1e-3)
