"""The reflexes of the simulated controller.

Oracle: numbers by hand; the behaviour that docs/fanuc.md states.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from lockstep_fanuc import BENT, made_controller

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends.fanuc.codec import (
    decode_received,
    encode_command,
    encode_start,
    encode_status,
    encode_stop,
)
from rtloop.backends.fanuc.messages import CommandPacket, RobotFlag, StatusPacket
from rtloop.backends.fanuc.simulator.controller import E_STOP, FanucController
from rtloop.backends.fanuc.simulator.options import FanucControllerOptions
from rtloop.backends.fanuc.simulator.rmi import RmiAnswers

PERIOD_S = 0.008


class Client:
    """The least client: it answers each state."""

    def __init__(self, controller: FanucController) -> None:
        self.controller = controller
        self.rmi = RmiAnswers(controller)
        self.position = BENT.copy()
        self.state: StatusPacket | None = None

    def ask(self, **request: Any) -> dict[str, Any]:
        reply = self.rmi.answer(json.dumps(request).encode())
        return dict(json.loads(reply)) if reply else {}

    def begin(self) -> None:
        self.controller.hear(encode_start(3))
        for _ in range(10):
            self.step()
        assert self.ask(Command="FRC_Initialize")["ErrorID"] == 0
        number = self.ask(Command="FRC_GetStatus")["NextSequenceID"]
        assert self.ask(Instruction="FRC_Call", SequenceID=number, ProgramName="STREAM_MOTN") == {}
        for _ in range(10):
            self.step()
        assert self.controller.motion_possible

    def step(self) -> None:
        found = decode_received(self.controller.step())
        assert isinstance(found, StatusPacket)
        self.state = found

    def send(self, **more: Any) -> None:
        assert self.state is not None
        packet = {"version": 3, "sequence": self.state.sequence, **more}
        packet.setdefault("position", self.controller.units.to_device(self.position))
        self.controller.hear(encode_command(CommandPacket(**packet)))

    def drive(self, positions: Array) -> None:
        """Joint 1, as rows of time."""
        for value in positions:
            self.step()
            self.position[0] = value
            self.send()


@pytest.fixture
def client(crx: Settings, arm: RobotDescription) -> Client:
    found = Client(made_controller(crx, arm, FanucControllerOptions()))
    found.begin()
    return found


def ramp(velocity: float, acceleration: float, jerk: float, periods: int) -> Array:
    """From rest: jerk until the acceleration, that until the velocity; sampled each period."""
    times = np.arange(1, periods * 50 + 1) * PERIOD_S / 50
    rates = np.minimum(jerk * times, acceleration)
    speeds = np.minimum(np.cumsum(rates) * PERIOD_S / 50, velocity)
    return np.asarray(BENT[0] + np.cumsum(speeds)[49::50] * PERIOD_S / 50)


def test_it_takes_commands_within_its_limits(client: Client) -> None:
    limits = client.controller.arm.limits
    client.drive(ramp(9.0, 0.9 * limits.max_acceleration[0], 0.9 * limits.max_jerk[0], 20))
    assert client.controller.alarms == []
    assert client.controller.arm.setpoint[0] > BENT[0] + 0.03
    peaks = client.controller.peaks
    assert 0.3 < peaks["velocity"][0] < 0.5
    assert 0.3 < peaks["acceleration"][0] < 0.45  # of three times the model's, at low speed


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        ((1.2, 1.0, 1.0), "the velocity of joint1"),
        ((9.0, 3.5, 2.0), "the acceleration of joint1"),
        ((1.0, 1.0, 3.5), "the jerk of joint1"),
    ],
)
def test_it_stops_at_commands_beyond_them(
    client: Client, shares: tuple[float, float, float], said: str
) -> None:
    """Without load and slowly, acceleration and jerk may be three times the model's."""
    limits = client.controller.arm.limits
    rates = limits.max_velocity[0], limits.max_acceleration[0], limits.max_jerk[0]
    client.drive(ramp(*(share * rate for share, rate in zip(shares, rates, strict=True)), 150))
    assert said in client.controller.alarms[-1]
    assert not client.controller.motion_possible
    assert client.state is not None
    assert client.state.robot_status & RobotFlag.ERROR
    for _ in range(100):
        client.step()
    assert not np.abs(client.controller._velocity).any()


@pytest.mark.parametrize(
    ("packet", "said"),
    [
        ({"style": 0}, "MOTN-625 the data style is 0; for joints it must be 65535"),
        ({"position": (np.nan,) * 6}, "a position that is not finite"),
        ({"position": (0.0,) * 6}, "the first command of joint5 is 0.698 away"),
        ({"version": 4}, "HOST-380 System error 0x19,0x0"),
    ],
)
def test_it_stops_at_what_is_no_command(client: Client, packet: dict[str, Any], said: str) -> None:
    """A data style of 0 would be a pose: the real one would move there."""
    client.step()
    client.send(**packet)
    assert said in client.controller.alarms[0]


def test_a_stream_that_is_stopped_in_a_motion_is_an_alarm(client: Client) -> None:
    client.drive(np.full(3, BENT[0]))
    client.controller.hear(encode_stop(3))
    assert "stopped in a motion" in client.controller.alarms[0]
    assert client.controller.step() == b""


def test_a_start_of_another_version_is_an_alarm(client: Client) -> None:
    client.controller.hear(encode_start(4))
    assert client.controller.alarms == ["HOST-380 System error 0x30,0x0"]


def test_without_commands_it_goes_straight_on_and_ends(client: Client) -> None:
    client.drive(ramp(0.3, 1.5, 10.0, 60))
    client.step()
    speed = client.controller._velocity[0]
    before = client.controller.arm.setpoint[0]
    for _ in range(12):
        client.step()
        assert client.controller._velocity[0] == pytest.approx(speed)
    assert client.controller.arm.setpoint[0] == pytest.approx(before + 12 * PERIOD_S * speed)
    client.step()
    assert not client.controller.motion_possible
    assert "no command for 104 ms" in client.controller.events[-1]
    assert client.controller.alarms == []


def test_old_numbers_are_ignored_and_early_commands_wait(client: Client) -> None:
    client.drive(np.full(3, BENT[0]))
    assert client.state is not None
    answered, number = client.controller.commands, client.state.sequence
    client.send(sequence=number)
    client.send(sequence=number - 1)
    assert client.controller.commands == answered
    assert f"command {number - 1} comes after command {number}" in client.controller.events[-1]
    client.step()
    for early, place in enumerate((1e-4, 3e-4, 6e-4), start=1):
        client.position[0] = BENT[0] + place
        client.send(sequence=number + early)
    for place in (1e-4, 3e-4, 6e-4):
        client.step()
        assert client.controller.arm.setpoint[0] == pytest.approx(BENT[0] + place, abs=1e-12)


def test_a_reset_clears_what_has_no_cause(client: Client) -> None:
    client.controller.press(E_STOP)
    client.controller.alarm("SRVO-023 Stop error excess")
    assert client.ask(Command="FRC_GetStatus")["ServoReady"] == 0
    assert client.ask(Command="FRC_Initialize")["ErrorID"] == 2556935
    client.ask(Command="FRC_Reset")
    assert client.ask(Command="FRC_ReadError", Count=5)["ErrorData"] == E_STOP
    client.controller.release(E_STOP)
    client.ask(Command="FRC_Reset")
    assert client.ask(Command="FRC_ReadError")["ErrorData"] == "No Error"
    for _ in range(10):
        client.step()
    assert client.ask(Command="FRC_GetStatus")["ServoReady"] == 1


@pytest.mark.parametrize(
    "line",
    [b"", b"x", b"[]", b"{}", b'{"Command": 7}', b'{"Command": "FRC_Nothing"}', b"[" * 3000, b"\xff",
     b'{"Command": "FRC_SetOverRide", "Value": 1e400}', b'{"Command": "FRC_SetOverRide", "Value": "9"}',
     b'{"Command": "FRC_ReadIOPort", "PortType": [], "PortNumber": {}}',
     b'{"Command": "FRC_WriteIOPort", "PortType": "DO", "PortNumber": 1, "PortValue": true}',
     b'{"Instruction": "FRC_Call", "SequenceID": "1", "ProgramName": null}'],
)  # fmt: skip
def test_any_request_has_an_error(client: Client, line: bytes) -> None:
    reply = json.loads(client.rmi.answer(line))
    assert reply["ErrorID"] > 0
    assert client.controller.override == 100


def test_both_interfaces_report_the_same_arm(client: Client) -> None:
    """Joint 3 of the Remote Motion Interface is measured from the horizon."""
    client.step()
    assert client.state is not None
    angles = client.ask(Command="FRC_ReadJointAngles")["JointAngle"]
    stream = client.state.joints
    assert angles["J3"] == pytest.approx(stream[2] - stream[1], abs=2e-3)
    assert angles["J2"] == pytest.approx(stream[1], abs=2e-3)
    position = client.ask(Command="FRC_ReadCartesianPosition")["Position"]
    assert [position[name] for name in "XYZWPR"] == pytest.approx(client.state.pose[:6], abs=2e-3)


def test_versions_have_their_status_packets(crx: Settings, arm: RobotDescription) -> None:
    lengths = {}
    for version in (3, 4):
        controller = made_controller(crx, arm, FanucControllerOptions(version=version))
        controller.hear(encode_start(version))
        lengths[version] = len(controller.step())
        assert encode_status(controller.status())
    assert lengths == {3: 388, 4: 416}
