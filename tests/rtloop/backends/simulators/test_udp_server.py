"""A simulated controller behind a socket: the cabinet of FRI."""

from __future__ import annotations

import socket
from types import SimpleNamespace
from typing import Any

import pytest
from fri_run import free_udp_port
from lockstep_fri import made_cabinet

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends.fri.encoding import encode_command
from rtloop.backends.fri.messages import COMMAND_ID, CommandMessage, FriHeader
from rtloop.backends.fri.simulator.control import ControlServer
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.simulators import udp_server as module
from rtloop.backends.simulators.udp_server import UdpServer


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "0.0.0.0"])
def test_a_client_is_known_by_name_and_by_address(
    settings: Settings, robot: RobotDescription, host: str
) -> None:
    cabinet = made_cabinet(settings, robot)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        server = UdpServer(cabinet, FriNetwork(), (host, client.getsockname()[1]), ControlServer)
        try:
            server._begin_period()
            server._begin_period()  # the first one opens the session
            sequence = cabinet.sequence
            answer = encode_command(CommandMessage(FriHeader(COMMAND_ID, 1, sequence), (0.0,) * 7))
            client.sendto(answer, ("127.0.0.1", server.port))
            server._take()
            assert cabinet.connection.reflected == sequence
        finally:
            server.close()


def test_a_long_answer_arrives_whole(
    settings: Settings, robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Telegrams of RSI are longer than messages of FRI."""
    cabinet = made_cabinet(settings, robot)
    arrived: list[bytes] = []
    monkeypatch.setattr(cabinet, "answer", arrived.append)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        server = UdpServer(cabinet, FriNetwork(), client.getsockname(), ControlServer)
        try:
            server._begin_period()
            client.sendto(bytes(8192), ("127.0.0.1", server.port))
            server._take()
        finally:
            server.close()
    assert arrived == [bytes(8192)]


def test_it_sends_from_the_port_that_a_connected_client_elsewhere_hears(
    settings: Settings, robot: RobotDescription
) -> None:
    """Oracle: the kernel, which gives a connected UDP socket only what comes from its peer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        port = client.getsockname()[1]
        client.connect(("127.0.0.2", port))
        client.settimeout(20.0)
        cabinet = made_cabinet(settings, robot)
        server = UdpServer(
            cabinet, FriNetwork(), ("127.0.0.1", port), ControlServer, address=("127.0.0.2", 0)
        )
        try:
            assert server.port == port
            server._begin_period()
            server._begin_period()
            assert client.recv(4096)
            client.send(
                encode_command(CommandMessage(FriHeader(COMMAND_ID, 1, cabinet.sequence), (0.0,) * 7))
            )
            server._take()
            assert cabinet.connection.reflected == cabinet.sequence
        finally:
            server.close()


@pytest.mark.parametrize("address", ["0.0.0.0", "127.0.0.1"])
def test_it_leaves_the_port_to_a_client_on_its_own_address(
    settings: Settings, robot: RobotDescription, address: str
) -> None:
    port = free_udp_port()
    server = UdpServer(
        made_cabinet(settings, robot), FriNetwork(), ("127.0.0.1", port), ControlServer, address=(address, 0)
    )
    try:
        assert server.port != port
    finally:
        server.close()


def test_a_second_program_that_sends_is_named_once(
    settings: Settings, robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And one that was started anew after a while is no second one."""
    now_s = [100.0]
    clock = SimpleNamespace(monotonic=lambda: now_s[0], time_ns=lambda: 0)
    monkeypatch.setattr(module, "time", clock)
    server = UdpServer(made_cabinet(settings, robot), FriNetwork(), ("127.0.0.1", 30200), ControlServer)
    try:
        server._begin_period()
        events = server._controller.events
        for port, pause_s in ((1, 0.0), (2, 2.0), (2, 0.1), (3, 0.1), (2, 0.1), (3, 0.1), (2, 0.1)):
            now_s[0] += pause_s
            server._answer(b"", ("127.0.0.1", port), 0.0)
        told = [each for each in events if "second program" in each]
        assert told == [
            "a second program sends: packets come from 127.0.0.1:3, and from 127.0.0.1:2 until just now"
        ]
    finally:
        server.close()


class HeldUp:
    """The cabinet's computer and its client's on one made clock: each message takes three periods to be sent,
    and is answered eight tenths of a period after that.
    """

    def __init__(self, server: UdpServer, client: socket.socket) -> None:
        self.server, self._client, self._socket = server, client, server._socket
        self.now_s = self._answers_s = 0.0
        self.sent = 0
        self.ending: list[str] = []

    def sendto(self, packet: bytes, where: tuple[str, int]) -> None:
        self.now_s += 3.0 * self.server._controller.period_s
        self._answers_s = self.now_s + 0.8 * self.server._controller.period_s
        self.sent += 1
        if self.sent == 50:
            self.ending.append("enough")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._socket, name)

    def select(self, readers: object, _: object, __: object, timeout_s: float) -> tuple[Any, Any, Any]:
        """What has come within so long."""
        if not self.now_s < self._answers_s <= self.now_s + timeout_s:
            self.now_s += timeout_s
            return [], [], []
        self.now_s = self._answers_s
        header = FriHeader(COMMAND_ID, self.sent, self.server._controller.sequence)
        self._client.sendto(
            encode_command(CommandMessage(header, (0.0,) * 7)), ("127.0.0.1", self.server.port)
        )
        return [self], [], []


def test_a_cabinet_that_is_held_up_while_it_sends_gives_its_client_the_time_all_the_same(
    settings: Settings, robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    cabinet = made_cabinet(settings, robot)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        server = UdpServer(cabinet, FriNetwork(), ("127.0.0.1", client.getsockname()[1]), ControlServer)
        held = HeldUp(server, client)
        clock = SimpleNamespace(monotonic=lambda: held.now_s, time_ns=lambda: 0)
        monkeypatch.setattr(server, "_socket", held)
        monkeypatch.setattr(module, "time", clock)
        monkeypatch.setattr(module, "select", held)
        try:
            server.run(held.ending)
        finally:
            server.close()
    assert (cabinet.connection.missing, held.sent) == (0, 50)
    assert cabinet.connection.answered > 40
