"""FRI's messages against Google's protobuf, and against bytes that are none."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest
from fri_descriptor import fri_messages
from hypothesis import given, settings
from hypothesis import strategies as st

from rtloop.backends.fri.codec import MAX_BYTES, decode_command, decode_monitoring
from rtloop.backends.fri.encoding import encode_command, encode_monitoring
from rtloop.backends.fri.messages import (
    COMMAND_ID,
    MONITORING_ID,
    CommandMessage,
    CommandMode,
    ControlMode,
    DriveState,
    FriHeader,
    IoDirection,
    IoType,
    IoValue,
    MonitoringMessage,
    OperationMode,
    OverlayType,
    Quality,
    SafetyState,
    SessionState,
)

COUNTER = st.integers(0, 2**32 - 1)
VALUE = st.floats(allow_nan=False)
JOINTS = st.lists(VALUE, min_size=7, max_size=7).map(tuple)
ROW = st.one_of(st.just(()), JOINTS)
NAME = st.text(st.characters(codec="ascii", min_codepoint=33), min_size=1, max_size=63)


@st.composite
def io_values(draw: st.DrawFn) -> IoValue:
    kind = draw(st.sampled_from(IoType))
    value = draw(VALUE) if kind == IoType.ANALOG else draw(st.integers(0, 2**64 - 1))
    return IoValue(draw(NAME), kind, draw(st.sampled_from(IoDirection)), value)


MONITORING = st.builds(
    MonitoringMessage,
    header=st.builds(FriHeader, st.just(MONITORING_ID), COUNTER, COUNTER),
    state=st.sampled_from(SessionState),
    quality=st.sampled_from(Quality),
    send_period_ms=st.integers(0, 2**32 - 1),
    receive_multiplier=st.integers(0, 2**32 - 1),
    joints=st.just(7),
    safety=st.sampled_from(SafetyState),
    drives=st.lists(st.sampled_from(DriveState), max_size=7).map(tuple),
    operation_mode=st.sampled_from([None, *OperationMode]),
    control_mode=st.sampled_from(ControlMode),
    command_mode=st.sampled_from(CommandMode),
    overlay=st.sampled_from(OverlayType),
    measured_position=ROW,
    commanded_position=ROW,
    ipo_position=ROW,
    measured_torque=ROW,
    commanded_torque=ROW,
    external_torque=ROW,
    measured_pose=ROW,
    tracking_performance=st.one_of(st.none(), VALUE),
    time_s=st.one_of(st.none(), st.integers(0, 10**6).map(float)),
    io=st.lists(io_values(), max_size=10),
    external_force=st.one_of(st.just(()), st.lists(VALUE, min_size=6, max_size=6).map(tuple)),
)
COMMAND = st.builds(
    CommandMessage,
    header=st.builds(FriHeader, st.just(COMMAND_ID), COUNTER, COUNTER),
    position=ROW,
    torque=ROW,
    wrench=st.one_of(st.just(()), st.lists(VALUE, min_size=6, max_size=6).map(tuple)),
    io=st.lists(io_values(), max_size=10),
)
HEADER = FriHeader(MONITORING_ID, 5, 4)


def oracle(*, packed: bool = False) -> Any:
    pytest.importorskip("google.protobuf", reason="Google's protobuf, the oracle of this test, is missing")
    return fri_messages(packed=packed)


def filled(message: Any, ours: MonitoringMessage) -> Any:
    """The same in Google's message."""
    header = message.header
    header.messageIdentifier, header.sequenceCounter = ours.header.identifier, ours.header.sequence
    header.reflectedSequenceCounter = ours.header.reflected
    message.robotInfo.numberOfJoints, message.robotInfo.safetyState = ours.joints, ours.safety
    message.robotInfo.driveState.extend(ours.drives)
    message.robotInfo.controlMode = ours.control_mode
    if ours.operation_mode is not None:
        message.robotInfo.operationMode = ours.operation_mode
    connection = message.connectionInfo
    connection.sessionState, connection.quality = ours.state, ours.quality
    connection.sendPeriod, connection.receiveMultiplier = ours.send_period_ms, ours.receive_multiplier
    data, ipo = message.monitorData, message.ipoData
    data.SetInParent()
    for row, values in (
        (data.measuredJointPosition, ours.measured_position),
        (data.commandedJointPosition, ours.commanded_position),
        (data.measuredTorque, ours.measured_torque),
        (data.commandedTorque, ours.commanded_torque),
        (data.externalTorque, ours.external_torque),
        (ipo.jointPosition, ours.ipo_position),
    ):
        row.value.extend(values)
    if ours.measured_pose:
        data.measuredCartesianPose.name = "flange"
        data.measuredCartesianPose.element.extend(ours.measured_pose)
    if ours.time_s is not None:
        data.timestamp.sec, data.timestamp.nanosec = int(ours.time_s), 0
    data.externalForce.element.extend(ours.external_force)
    for value in ours.io:
        fill_io(data.readIORequest.add(), value)
    ipo.clientCommandMode, ipo.overlayType = ours.command_mode, ours.overlay
    if ours.tracking_performance is not None:
        ipo.trackingPerformance = ours.tracking_performance
    return message


def fill_io(message: Any, value: IoValue) -> None:
    message.name, message.type, message.direction = value.name, value.type, value.direction
    if value.type == IoType.ANALOG:
        message.analogValue = value.value
    else:
        message.digitalValue = value.value


@settings(deadline=None, max_examples=100)
@given(ours=MONITORING)
@pytest.mark.parametrize("packed", [False, True])
def test_reads_what_googles_protobuf_has_written(packed: bool, ours: MonitoringMessage) -> None:
    message = filled(oracle(packed=packed).FRIMonitoringMessage(), ours)
    message.endOfMessageData.messageLength = 3
    assert decode_monitoring(message.SerializeToString()) == ours


@settings(deadline=None, max_examples=100)
@given(ours=MONITORING)
def test_googles_protobuf_reads_what_the_simulator_writes(ours: MonitoringMessage) -> None:
    messages = oracle()
    read = messages.FRIMonitoringMessage.FromString(encode_monitoring(ours))
    assert decode_monitoring(read.SerializeToString()) == ours
    assert list(read.monitorData.measuredJointPosition.value) == list(ours.measured_position)


@settings(deadline=None, max_examples=100)
@given(ours=COMMAND)
def test_googles_protobuf_reads_our_commands_as_they_are(ours: CommandMessage) -> None:
    read = oracle().FRICommandMessage.FromString(encode_command(ours))
    assert list(read.commandData.jointPosition.value) == list(ours.position)
    assert list(read.commandData.jointTorque.value) == list(ours.torque)
    assert list(read.commandData.cartesianWrenchFeedForward.element) == list(ours.wrench)
    assert [each.name for each in read.commandData.writeIORequest] == [each.name for each in ours.io]
    assert (read.header.sequenceCounter, read.header.reflectedSequenceCounter) == (
        ours.header.sequence,
        ours.header.reflected,
    )
    assert decode_command(read.SerializeToString()) == ours


@settings(deadline=None, max_examples=100)
@given(ours=MONITORING)
def test_a_monitoring_message_comes_back_as_it_was(ours: MonitoringMessage) -> None:
    assert decode_monitoring(encode_monitoring(ours)) == ours


@settings(deadline=None, max_examples=100)
@given(ours=COMMAND)
def test_a_command_comes_back_as_it_was(ours: CommandMessage) -> None:
    assert decode_command(encode_command(ours)) == ours


@settings(deadline=None, max_examples=500)
@given(packet=st.binary(max_size=400))
def test_random_bytes_are_refused_in_words(packet: bytes) -> None:
    assert isinstance(decode_monitoring(packet), MonitoringMessage | str)
    assert isinstance(decode_command(packet), CommandMessage | str)


@settings(deadline=None, max_examples=50)
@given(ours=MONITORING, seed=st.integers(0, 2**32 - 1))
def test_damaged_packets_are_refused_in_words(ours: MonitoringMessage, seed: int) -> None:
    whole, rng = encode_monitoring(ours), random.Random(seed)
    for _ in range(20):
        packet = bytearray(whole)
        for _ in range(rng.randrange(9)):
            packet[rng.randrange(len(packet))] = rng.randrange(256)
        found = decode_monitoring(bytes(packet[: len(packet) - rng.randrange(40)]))
        assert isinstance(found, MonitoringMessage | str)
        assert found


def test_says_what_is_wrong_with_a_packet() -> None:
    assert "instead of 0x245142" in str(
        decode_monitoring(encode_command(CommandMessage(FriHeader(COMMAND_ID, 1, 1))))
    )
    assert "header is incomplete" in str(decode_monitoring(b""))
    assert f"at most {MAX_BYTES}" in str(decode_monitoring(bytes(MAX_BYTES + 1)))
    odd = MonitoringMessage(HEADER, joints=7, measured_position=(0.0,) * 6)
    assert decode_monitoring(encode_monitoring(odd)) == (
        "no monitoring message of FRI: the message contains values of 6 joints, but the robot has 7"
    )


def test_a_state_that_nobody_knows_is_named() -> None:
    packet = encode_monitoring(MonitoringMessage(HEADER, state=SessionState.COMMANDING_ACTIVE))
    assert packet.count(b"\x22\x08\x08\x04") == 1
    assert "session state is 9" in str(
        decode_monitoring(packet.replace(b"\x22\x08\x08\x04", b"\x22\x08\x08\x09"))
    )


def test_the_versions_are_told_apart() -> None:
    seven = (0.0,) * 7
    assert MonitoringMessage(HEADER, commanded_position=seven).version == "1.x"
    assert MonitoringMessage(HEADER, measured_pose=seven).version == "2.x"
    assert MonitoringMessage(HEADER).version == ""


def test_what_is_not_finite_is_left_to_the_session() -> None:
    message = MonitoringMessage(HEADER, joints=1, measured_position=(math.nan,))
    found = decode_monitoring(encode_monitoring(message))
    assert isinstance(found, MonitoringMessage)
    assert math.isnan(found.measured_position[0])
