"""The simulated controller on a network. It uses its own clock, and UDP and TCP to its client."""

from __future__ import annotations

import contextlib
import select
import socket
import time

from rtloop.backends.fanuc.messages import MAX_PACKET
from rtloop.backends.fanuc.simulator.control import FanucControl
from rtloop.backends.fanuc.simulator.controller import FanucController
from rtloop.backends.fanuc.simulator.network import FanucNetwork
from rtloop.backends.fanuc.simulator.rmi import MAX_LINE, RmiAnswers
from rtloop.backends.simulators.arrivals import receive, request_arrival_times
from rtloop.backends.simulators.times import ServerTimes

MAX_AT_ONCE = 256
MIN_SHARE = 0.9
"""Time between two packets, as a share of the period, while the process catches up after a delay."""
ALONE_S = 1.0
"""Time without a packet after which a different client may take over, even if the first one has not stopped
its stream, s.
"""


class RmiServer:
    """Serves the two ports of the Remote Motion Interface, between packets of Stream Motion."""

    def __init__(self, address: str, port: int, answers: RmiAnswers) -> None:
        """Open the two ports. Raises OSError if the address or a port cannot be used."""
        self._answers = answers
        self._door = socket.create_server((address, port))
        try:
            self._room = socket.create_server((address, 0), backlog=1)
        except OSError:
            self._door.close()
            raise
        answers.session_port = self._room.getsockname()[1]
        for each in (self._door, self._room):
            each.setblocking(False)
        self._greeted: dict[socket.socket, bytes] = {}
        self._client: socket.socket | None = None
        self._rest = b""
        self.deaf = False

    @property
    def port(self) -> int:
        port: int = self._door.getsockname()[1]
        return port

    @property
    def sockets(self) -> list[socket.socket]:
        client = [self._client] if self._client is not None else [self._room]
        return [self._door, *self._greeted, *client]

    def serve(self) -> None:
        """Answer the requests that have arrived, without waiting for more."""
        if self._client is None:
            with contextlib.suppress(BlockingIOError):
                self._client, _ = self._room.accept()
                self._client.setblocking(False)
                self._answers.occupied, self._rest = True, b""
        if self._client is not None:
            self._talk(self._client)
        with contextlib.suppress(BlockingIOError):
            greeted, _ = self._door.accept()
            greeted.setblocking(False)
            self._greeted[greeted] = b""
        for each in list(self._greeted):
            self._greet(each)

    def hang_up(self) -> None:
        """Close the session."""
        client, self._client = self._client, None
        if client is not None:
            client.close()
            self._answers.leave()

    def close(self) -> None:
        self.hang_up()
        for each in (self._door, self._room, *self._greeted):
            each.close()

    def _greet(self, client: socket.socket) -> None:
        heard = _heard(client)
        if heard is None:
            return
        self._greeted[client] += heard
        line, end, _ = self._greeted[client].partition(b"\n")
        if end:
            with contextlib.suppress(OSError):
                client.sendall(self._answers.greet(line))
        if end or not heard or len(line) > MAX_LINE:
            del self._greeted[client]
            client.close()

    def _talk(self, client: socket.socket) -> None:
        heard = _heard(client)
        if heard is None:
            return
        *lines, self._rest = (self._rest + heard).split(b"\n")
        if not heard or len(self._rest) > MAX_LINE:
            self.hang_up()
            return
        for line in lines:
            reply = b"" if self.deaf else self._answers.answer(line)
            if reply:
                with contextlib.suppress(OSError):
                    client.sendall(reply)
        if not self._answers.occupied:
            self.hang_up()


def _heard(client: socket.socket) -> bytes | None:
    """Return the received bytes; b"" if the connection is closed, None if nothing has arrived."""
    try:
        return client.recv(MAX_LINE)
    except BlockingIOError:
        return None
    except OSError:
        return b""


class ControllerServer:
    """Sends a packet in each period, and receives the answers.

    A real controller keeps exact time, but this process may not. So an answer is in time if it arrives before
    the next packet is sent, whenever this process reads it.
    """

    def __init__(
        self,
        controller: FanucController,
        network: FanucNetwork,
        *,
        address: str = "127.0.0.1",
        stream_port: int = 0,
        rmi_port: int = 0,
        control_port: int = 0,
        patience_s: float = 0.0,
    ) -> None:
        """
        Args:
            patience_s: maximum wait for a late answer, s; after it, the answer is missing.

        Raises:
            OSError: an address or port cannot be used.
        """
        self._controller, self._network, self._patience_s = controller, network, patience_s
        self._times = ServerTimes()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((address, stream_port))
            self.rmi = RmiServer(address, rmi_port, RmiAnswers(controller))
            self._control = FanucControl(control_port, controller, network, self._times.shown)
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        request_arrival_times(self._socket)
        self._client: tuple[str, int] | None = None
        self._client_s = self._sent_s = time.monotonic()
        self._expects = self._two = False
        self._deaf = True  # no answer yet, or none since `patience_s` was exceeded

    @property
    def port(self) -> int:
        port: int = self._socket.getsockname()[1]
        return port

    @property
    def control_port(self) -> int:
        return self._control.port

    def run(self, ending: list[str]) -> None:
        """Run until `ending` contains a reason."""
        deadline_s = time.monotonic()
        period_s = self._controller.period_s
        while not ending:
            self._begin_period()
            deadline_s = max(deadline_s, time.monotonic() - (1.0 - MIN_SHARE) * period_s) + period_s
            self._listen(deadline_s, ending)
            self._times.lateness.add(time.monotonic() - deadline_s)
            self._serve()
            for _ in range(MAX_AT_ONCE):
                if not self._take():
                    break

    def close(self) -> None:
        self._control.close()
        self.rmi.close()
        self._socket.close()

    def _serve(self) -> None:
        self._control.serve()
        self.rmi.deaf = self._control.deaf
        if self._control.closes:
            self._control.closes = False
            self.rmi.hang_up()
        self.rmi.serve()

    def _begin_period(self) -> None:
        for packet in self._network.arrived():
            self._hear(packet)
        message = self._controller.step()
        sent = self._network.to_client(message) if message else []
        self._sent_s = time.monotonic()
        for packet in sent:
            self._send(self._network.spoil_packet(packet))
        self._expects = bool(message) and message in sent and self._controller.is_commanded

    def _send(self, packet: bytes) -> None:
        if self._client is not None:
            with contextlib.suppress(OSError):  # no client; the missing answer shows this
                self._socket.sendto(packet, self._client)

    def _listen(self, deadline_s: float, ending: list[str]) -> None:
        """Receive packets until the period is over, or longer if a missing answer may still arrive."""
        while not ending:
            now_s = time.monotonic()
            until_s = deadline_s
            if self._expects and not self._deaf:
                until_s = max(deadline_s, self._sent_s + self._patience_s)
            if now_s >= until_s:
                self._deaf = self._deaf or (self._expects and self._patience_s > 0.0)
                return
            # While waiting for a late answer, serve the other interfaces, too.
            readable = [self._socket, *self.rmi.sockets]
            ready, _, _ = select.select(readable, [], [], min(until_s - now_s, 0.02))
            if self._socket in ready:
                self._take()
            if len(ready) > (self._socket in ready):
                self.rmi.serve()
            if now_s >= deadline_s:
                self._serve()

    def _take(self) -> bool:
        """Process the next packet. Return whether there was one."""
        try:
            packet, sender, arrived_s = receive(self._socket, MAX_PACKET)
        except BlockingIOError:
            return False
        except OSError:
            return True
        if not self._is_client(sender):
            return True
        expected, before = self._expects, self._controller.commands
        lost = self._network.lost
        for arrived in self._network.from_client(packet):
            self._hear(arrived)
        answered = self._controller.commands > before
        kept_back = self._network.lost > lost or self._network.delay > 0 or self._network.reorder > 0.0
        self._expects = expected and not (answered or kept_back)
        self._deaf = self._deaf and not answered
        if expected and answered:
            self._times.answers.add(arrived_s - self._sent_s)
        return True

    def _hear(self, packet: bytes) -> None:
        reply = self._controller.hear(packet)
        if reply:
            self._send(reply)

    def _is_client(self, sender: tuple[str, int]) -> bool:
        """Whether a packet is from the current client. If that client has sent nothing for `ALONE_S`, a
        different client may take over.
        """
        now_s = time.monotonic()
        alone = self._client is None or not self._controller.streams or now_s - self._client_s > ALONE_S
        if sender != self._client and not alone:
            if not self._two:
                self._two = True
                self._controller.alarm("HOST-380 System error 0x30,0x0")
            return False
        self._two = self._two and sender == self._client
        self._client, self._client_s = sender, now_s
        return True
