"""Whose packets count, on real sockets of this computer."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import numpy as np
import pytest
from fri_run import free_udp_port
from lockstep_fri import fri_settings

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends import BackendError, Measured
from rtloop.backends.channel import RELEASE_S
from rtloop.backends.fri import FriBackend
from rtloop.backends.fri.channel import fri_channel
from rtloop.backends.fri.encoding import encode_monitoring
from rtloop.backends.fri.messages import MONITORING_ID, FriHeader, MonitoringMessage, Quality, SessionState

WAIT_S = 20.0


class Sender:
    """Whoever sends to the channel from a socket of its own."""

    def __init__(self, port: int) -> None:
        self._to = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(WAIT_S)

    def send(self, packet: bytes) -> None:
        self.socket.sendto(packet, self._to)

    def answers(self) -> int:
        """So many are there; loopback delivers before `sendto` returns."""
        self.socket.setblocking(False)
        count = 0
        try:
            while self.socket.recv(4096):
                count += 1
        except BlockingIOError:
            return count


class Clock:
    time_s = 0.0

    def __call__(self) -> float:
        return self.time_s


def monitoring(sequence: int, position: float = 0.0) -> bytes:
    return encode_monitoring(
        MonitoringMessage(
            FriHeader(MONITORING_ID, sequence, 0),
            state=SessionState.MONITORING_READY,
            quality=Quality.GOOD,
            send_period_ms=5,
            receive_multiplier=1,
            joints=7,
            measured_position=(position,) * 7,
        )
    )


class Line:
    """A channel, its controller and a stranger on the same computer."""

    def __init__(self, address: str | None = None) -> None:
        self.port, self.clock = free_udp_port(), Clock()
        self.channel = fri_channel("127.0.0.1", self.port, address, clock=self.clock)
        self.controller, self.stranger = Sender(self.port), Sender(self.port)

    def close(self) -> None:
        for each in (self.controller.socket, self.stranger.socket, self.channel):
            each.close()


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.close()


def test_nobody_takes_over_what_the_controller_has_begun(line: Line) -> None:
    line.controller.send(monitoring(1))
    assert line.channel.receive(WAIT_S) == [monitoring(1)]
    for packet in (monitoring(2, 1.0), b"rubbish"):
        line.stranger.send(packet)
    line.controller.send(monitoring(2))
    line.stranger.send(monitoring(3, 1.0))
    assert line.channel.receive(WAIT_S) == [monitoring(2)]
    assert line.channel.strangers == 3
    line.channel.send(b"an answer")
    assert (line.controller.answers(), line.stranger.answers()) == (1, 0)


def test_what_is_no_fri_is_heard_but_not_answered(line: Line) -> None:
    """So that it can be said that it has come."""
    line.stranger.send(b"rubbish")
    assert line.channel.receive(WAIT_S) == [b"rubbish"]
    line.channel.send(b"an answer")
    line.controller.send(monitoring(1))
    line.stranger.send(b"rubbish")
    assert line.channel.receive(WAIT_S) == [monitoring(1)]
    line.channel.send(b"an answer")
    assert (line.controller.answers(), line.stranger.answers()) == (1, 0)


def test_a_controller_that_was_started_anew_may_have_another_port(line: Line) -> None:
    line.controller.send(monitoring(1))
    line.channel.receive(WAIT_S)
    line.clock.time_s = RELEASE_S
    line.stranger.send(b"rubbish")
    assert line.channel.receive(WAIT_S) == []
    line.stranger.send(monitoring(1, 1.0))
    assert line.channel.receive(WAIT_S) == [monitoring(1, 1.0)]
    line.channel.send(b"an answer")
    assert (line.controller.answers(), line.stranger.answers()) == (0, 1)


def test_only_the_configured_address_counts() -> None:
    line = Line("192.0.2.1")
    try:
        line.controller.send(monitoring(1))
        assert line.channel.receive(WAIT_S) == []
        assert line.channel.strangers == 1
    finally:
        line.close()


def test_the_backend_is_where_its_controller_says_and_tells_of_the_others(
    settings: Settings, robot: RobotDescription
) -> None:
    line = Line()
    try:
        backend = FriBackend(fri_settings(settings), robot.limits, channel=line.channel, clock=line.clock)
        line.controller.send(monitoring(1, 0.25))
        backend.open(np.zeros(7))
        line.stranger.send(monitoring(5, 1.0))
        line.controller.send(monitoring(2, 0.25))
        assert backend.wait(WAIT_S)
        measured = Measured(7)
        backend.read(measured)
        np.testing.assert_allclose(measured.position, 0.25)
        backend.write(np.zeros((3, 7)))
        assert (line.controller.answers(), line.stranger.answers()) == (1, 0)
        assert "1 packets from addresses other than the controller's were ignored" in backend.status().text
    finally:
        line.close()


def test_a_port_that_is_taken_is_named(line: Line) -> None:
    with pytest.raises(BackendError, match=f"cannot listen on UDP 127.0.0.1:{line.port}"):
        fri_channel("127.0.0.1", line.port, None)
