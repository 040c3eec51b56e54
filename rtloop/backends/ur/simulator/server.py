"""A simulated controller on the network, which runs with the control period of its series."""

from __future__ import annotations

import contextlib
import select
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rtloop.backends.simulators.times import ServerTimes
from rtloop.backends.ur import dashboard, enabling, robot_api, rtde
from rtloop.backends.ur.simulator.control import ControlSession, UrControlRequest
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.dashboard_session import DashboardSession
from rtloop.backends.ur.simulator.network import DataNetwork
from rtloop.backends.ur.simulator.primary_session import PrimarySession
from rtloop.backends.ur.simulator.robot_api_session import RobotApiSession
from rtloop.backends.ur.simulator.rtde_session import RtdeSession
from rtloop.backends.ur.simulator.session import UrSession
from rtloop.backends.ur.transport import TcpStream

SECONDARY_PORT = 30002
READ_BYTES = 65_536
MAX_CLIENTS = 16
"""Maximum number of clients per port. Further clients are rejected."""
WAIT_S = 0.0002
CATCH_UP_S = 0.05
"""Maximum delay that the server makes up for, s. After a longer one it skips periods, to avoid a burst."""


class ProgramStream(TcpStream):
    """A connection of a program on the controller. The server can silence, delay and time the connection.

    Attributes:
        commands: number of times that data was received.
        arrived_s: arrival time of the unread data; None if there is none.
        is_closed: whether the program has closed it.
    """

    def __init__(self, made: socket.socket, server: UrServer) -> None:
        super().__init__(made, False)
        self._server = server
        self.commands, self.is_closed = 0, False
        self.arrived_s: float | None = None
        self._held: list[tuple[float, bytes]] = []

    def receive(self) -> bytes:
        server = self._server
        if server.silent:
            return b""
        received = super().receive()
        now_s = time.monotonic()
        if received:
            self.commands += 1
            server.count_answer(self.arrived_s or now_s)
            self.arrived_s = None
            server.watch(self)
        if not server.delay_s and not self._held:
            return received
        if received:
            self._held.append((now_s + server.delay_s, received))
        due = [data for due_s, data in self._held if due_s <= now_s]
        self._held = self._held[len(due) :]
        return b"".join(due)

    def is_connected(self) -> bool:
        connected = super().is_connected()
        if connected:
            self._server.watch(self)
        return connected

    def close(self) -> None:
        self._server.unwatch(self)
        self.is_closed = True
        super().close()


@dataclass(slots=True)
class _Client:
    session: UrSession
    socket: socket.socket
    port: int


class UrServer:
    """
    Attributes:
        silent: whether nothing is sent or received, as if the cable were disconnected.
        delay_s: delay with which programs read data, s.
    """

    def __init__(
        self,
        make: Callable[[UrServer], UrController],
        address: str,
        control_port: int,
        network: DataNetwork,
        patience_s: float = 0.0,
        robot_api_port: int = robot_api.PORT,
    ) -> None:
        """
        Args:
            patience_s: maximum time for which the controller stops its clock until a late command arrives, s.
            robot_api_port: TCP port of the Robot API, for PolyScope X.

        Raises:
            OSError: a port is taken.
        """
        self._patience_s = patience_s
        self._program: ProgramStream | None = None
        self.silent, self.delay_s = False, 0.0
        self.clock = time.monotonic
        self._network = network
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        self._times = ServerTimes()
        self._sent_s: float | None = None
        self._missing = 0  # number of data packages without a command before the next package
        self._controller = make(self)
        controller = self._controller
        sessions: dict[int, Callable[[], UrSession]] = {
            enabling.PRIMARY_PORT: lambda: PrimarySession(controller),
            SECONDARY_PORT: lambda: PrimarySession(controller, is_primary=False),
            rtde.PORT: lambda: RtdeSession(controller, network),
        }
        if controller.options.series == "x":
            sessions[robot_api_port] = lambda: RobotApiSession(controller)
        else:
            sessions[dashboard.PORT] = lambda: DashboardSession(controller)
        self._listeners: list[socket.socket] = []
        try:
            for port, session in sessions.items():
                self._listen((address, port), session)
            self.control_port = self._listen(
                ("127.0.0.1", control_port), lambda: ControlSession(controller, network, self._more)
            )
        except OSError as exc:
            self.close()
            raise OSError(
                f"a port of {address} cannot be used: {exc.strerror}; --address picks another"
            ) from exc

    # Methods of `UrTransport`, for programs

    def connect(self, host: str, port: int) -> TcpStream:
        place = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_STREAM)[0][4]
        made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        stream = ProgramStream(made, self)
        made.connect_ex(place)
        self._program = stream
        return stream

    def listen(self, port: int) -> Any:
        raise OSError("a program on the simulated controller cannot listen on a port")

    def wait(self, streams: Sequence[Any], timeout_s: float) -> None:
        """No-op: programs wait for their next period."""

    # The server

    def run(self, ending: list[str]) -> None:
        """Serve until `ending` contains a reason."""
        period_s = self._controller.period_s
        due_s = time.monotonic() + period_s
        while not ending:
            self._serve(max(due_s - time.monotonic(), 0.0))
            now_s = time.monotonic()
            if now_s < due_s or (now_s < due_s + self._patience_s and self._waits_for_command()):
                continue
            self._times.lateness.add(now_s - due_s)
            due_s += period_s
            if now_s - due_s > CATCH_UP_S:
                due_s = now_s + period_s
            self._advance()

    def close(self) -> None:
        for client in list(self._clients):
            self._forget(client)
        for listener in self._listeners:
            listener.close()
        self._selector.close()

    def count_answer(self, now_s: float) -> None:
        """Handle the arrival of a command."""
        if self._sent_s is not None:
            self._times.answers.add(now_s - self._sent_s)
            self._sent_s = None

    def _needs_command(self) -> ProgramStream | None:
        """Return the program if it must still send a command for the newest data package; otherwise None. No
        command is expected from a program that has not sent its first one.
        """
        program = self._program
        if self.silent or self._sent_s is None or program is None or program.is_closed:
            return None
        return program if program.commands > 1 else None

    def _waits_for_command(self) -> bool:
        program = self._needs_command()
        if program is None:
            return False
        poll = select.poll()
        poll.register(program.socket, select.POLLIN)
        waits = not poll.poll(0)
        if waits:
            time.sleep(WAIT_S)
        return waits

    def watch(self, stream: ProgramStream) -> None:
        """Also wait for data on this stream."""
        with contextlib.suppress(KeyError):
            self._selector.register(stream.socket, selectors.EVENT_READ, stream)

    def unwatch(self, stream: ProgramStream) -> None:
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(stream.socket)

    def _advance(self) -> None:
        self._controller.advance()
        for client in list(self._clients):
            client.session.tick()
            if client.port == rtde.PORT and client.session.out:
                self._missing += self._needs_command() is not None
                self._sent_s = time.monotonic()
            self._flush(client)

    def _listen(self, place: tuple[str, int], session: Callable[[], UrSession]) -> int:
        listener = socket.create_server(place)
        listener.setblocking(False)
        self._listeners.append(listener)
        self._selector.register(listener, selectors.EVENT_READ, session)
        port: int = listener.getsockname()[1]
        return port

    def _serve(self, timeout_s: float) -> None:
        for key, _ in self._selector.select(timeout_s):
            if isinstance(key.data, _Client):
                self._hear(key.data)
            elif isinstance(key.data, ProgramStream):
                key.data.arrived_s = time.monotonic()
                self.unwatch(key.data)
            else:
                self._accept(key.fileobj, key.data)  # type: ignore[arg-type]

    def _accept(self, listener: socket.socket, session: Callable[[], UrSession]) -> None:
        try:
            made, _ = listener.accept()
        except OSError:
            return
        made.setblocking(False)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        port = made.getsockname()[1]
        if sum(each.port == port for each in self._clients) >= MAX_CLIENTS:
            made.close()
            return
        client = _Client(session(), made, port)
        self._clients.append(client)
        self._selector.register(made, selectors.EVENT_READ, client)
        self._flush(client)

    def _hear(self, client: _Client) -> None:
        if self.silent and client.port != self.control_port:
            with contextlib.suppress(OSError):
                client.socket.recv(READ_BYTES)
            return
        try:
            received = client.socket.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            received = b""
        if not received:
            self._forget(client)
            return
        client.session.feed(received)
        self._flush(client)

    def _flush(self, client: _Client) -> None:
        session = client.session
        if self.silent and client.port != self.control_port:
            session.out.clear()
            return
        try:
            while session.out:
                sent = client.socket.send(session.out)
                del session.out[:sent]
        except BlockingIOError:
            return
        except OSError:
            self._forget(client)
            return
        if session.is_over:
            self._forget(client)

    def _forget(self, client: _Client) -> None:
        if client not in self._clients:
            return
        self._clients.remove(client)
        client.session.close()
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(client.socket)
        client.socket.close()

    def _more(self, request: UrControlRequest) -> dict[str, Any]:
        """Apply the changes to the server, and return four statistics: the times (s) from a data package to
        the next command, the delays (s) of the server's periods, the number of packages for which no command
        arrived in time, and the number of clients.
        """
        if request.silent is not None:
            self.silent = request.silent
        if request.delay_s is not None:
            self.delay_s = request.delay_s
        return {**self._times.shown(), "missing": self._missing, "clients": len(self._clients)}
