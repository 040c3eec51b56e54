"""The simulated cabinet behind a socket."""

from __future__ import annotations

import socket

import pytest
from lockstep_fri import made_cabinet

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends.fri.encoding import encode_command
from rtloop.backends.fri.messages import COMMAND_ID, Command, Header
from rtloop.backends.fri.simulator.network import Network
from rtloop.backends.fri.simulator.server import CabinetServer


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "0.0.0.0"])
def test_a_client_is_known_by_name_and_by_address(
    settings: Settings, robot: RobotDescription, host: str
) -> None:
    cabinet = made_cabinet(settings, robot)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", 0))
        server = CabinetServer(cabinet, Network(), (host, client.getsockname()[1]))
        try:
            server._begin_period()
            server._begin_period()  # the first one opens the session
            sequence = cabinet.sequence
            answer = encode_command(Command(Header(COMMAND_ID, 1, sequence), (0.0,) * 7))
            client.sendto(answer, ("127.0.0.1", server.port))
            server._take()
            assert cabinet.connection.reflected == sequence
        finally:
            server.close()
