"""A simulated controller on a network. It uses its own clock, and UDP to its client."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from rtloop.backends.simulators.arrivals import receive, request_arrival_times
from rtloop.backends.simulators.line_server import LineServer
from rtloop.backends.simulators.network import Network
from rtloop.backends.simulators.times import ServerTimes

MAX_PACKET = 65_507
"""Maximum size of a UDP packet, bytes. The controller itself checks the maximum length of its protocol."""
MAX_WAIT_S = 0.02
"""Interval at which the control interface is checked while the server is waiting for a late answer, s."""
MAX_AT_ONCE = 256
"""Maximum number of packets that are read from the socket at the end of a period."""
MIN_SHARE = 0.9
"""Time between two messages, as a share of the period, while the process catches up after a delay."""
ALONE_S = 1.0
"""Time without a packet after which packets from a different port of the client are accepted, because it may
have restarted, s.
"""


def _ipv4_of(host: str) -> str:
    try:
        return socket.gethostbyname(host)
    except (OSError, UnicodeError) as exc:
        raise OSError(
            f"client {host!r} is neither an IPv4 address nor a host name that resolves to one: {exc}"
        ) from exc


def _is_local(host: str) -> bool:
    """Whether an address belongs to this computer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, 0))
        except OSError:
            return False
    return True


def _socket_for(client: tuple[str, int], address: tuple[str, int]) -> socket.socket:
    """Create the socket from which packets are sent.

    A client that knows the controller's address accepts packets only from that address, and only with its own
    port number. So port 0 means the client's port number. If the client may have the simulator's address, it
    already uses that port, and a free port is used instead.
    """
    host, port = address
    elsewhere = host != client[0] if host != "0.0.0.0" else not _is_local(client[0])
    ports = [port] if port or not elsewhere else [client[1], 0]
    problem = ""
    for each in ports:
        found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            found.bind((host, each))
        except OSError as exc:
            found.close()
            problem = f"cannot send from UDP {host}:{each}: {exc.strerror}"
        else:
            return found
    raise OSError(problem)


class SteppedController(Protocol):
    """A simulated controller that counts periods.

    Attributes:
        period_s: time between two of its packets, s.
        events: event descriptions, newest last.
    """

    period_s: float
    events: deque[str]

    @property
    def waits_for_answer(self) -> bool:
        """Whether the controller's last packet still needs an answer."""
        ...

    def packet(self) -> bytes:
        """End a period and begin the next one. Return the packet of the new period; b"" if the server sends
        nothing in this period.
        """
        ...

    def answer(self, packet: bytes) -> None:
        """Process a packet from a client, valid or not."""
        ...


AnyController = TypeVar("AnyController", bound=SteppedController)


class UdpServer(Generic[AnyController]):
    """Sends one packet per period, and receives the answers.

    A real controller keeps exact time, but this process may not. So an answer is in time if it arrives before
    the next message is sent, whenever this process reads it.
    """

    def __init__(
        self,
        controller: AnyController,
        network: Network,
        client: tuple[str, int],
        control: Callable[[int, AnyController, Network, Callable[[], dict[str, Any]]], LineServer],
        *,
        address: tuple[str, int] = ("0.0.0.0", 0),
        control_port: int = 0,
        patience_s: float = 0.0,
    ) -> None:
        """
        Args:
            control: function that makes the control interface.
            patience_s: maximum wait for a late answer, s; after it, the answer is missing.

        Raises:
            OSError: the client's name is unknown, or an address or port cannot be used.
        """
        self._controller, self._network = controller, network
        # Resolved, because answers come from an address even if the client was given by name.
        self._client = _ipv4_of(client[0]), client[1]
        self._patience_s = patience_s
        self._socket = _socket_for(self._client, address)
        self._socket.setblocking(False)
        request_arrival_times(self._socket)
        self._times = ServerTimes()
        self._control = control(control_port, controller, network, self._times.shown)
        self._sender: tuple[str, int] | None = None
        self._sender_s = 0.0
        self._two = False  # whether a second sender has been reported
        self._deaf = True  # no answer yet, or none since `patience_s` was exceeded
        self._sent_s = time.monotonic()

    @property
    def port(self) -> int:
        port: int = self._socket.getsockname()[1]
        return port

    @property
    def period_ms(self) -> int:
        return round(1e3 * self._controller.period_s)

    @property
    def control_port(self) -> int:
        return self._control.port

    def run(self, ending: list[str]) -> None:
        """Run until `ending` contains a reason."""
        deadline_s = time.monotonic()
        while not ending:
            self._begin_period()
            # Delays of this process before or during the wait are not the client's fault.
            gone_s = time.monotonic()
            deadline_s = max(deadline_s, gone_s - (1.0 - MIN_SHARE) * self._controller.period_s)
            deadline_s += self._controller.period_s
            self._listen(deadline_s, ending)
            self._times.lateness.add(time.monotonic() - deadline_s)
            self._control.serve()
            for _ in range(MAX_AT_ONCE):
                if not self._take():
                    break

    def close(self) -> None:
        self._control.close()
        self._socket.close()

    def _begin_period(self) -> None:
        for packet in self._network.arrived():
            self._controller.answer(packet)
        message = self._controller.packet()
        sent = self._network.to_client(message)
        # Taken before sending, because the client may answer before this process continues.
        self._sent_s = time.monotonic()
        for packet in sent:
            with contextlib.suppress(OSError):  # no client; the missing answer shows this
                self._socket.sendto(self._network.spoil_packet(packet), self._client)
        self._expects = message in sent and self._controller.waits_for_answer

    def _listen(self, deadline_s: float, ending: list[str]) -> None:
        """Receive answers until the period is over, or longer if a missing answer may still arrive."""
        while not ending:
            now_s = time.monotonic()
            until_s = deadline_s
            if self._expects and not self._deaf:
                until_s = max(deadline_s, self._sent_s + self._patience_s)
            if now_s >= until_s:
                self._deaf = self._deaf or (self._expects and self._patience_s > 0.0)
                return
            if now_s >= deadline_s:
                self._control.serve()
            ready, _, _ = select.select([self._socket], [], [], min(until_s - now_s, MAX_WAIT_S))
            if ready:
                self._take()

    def _take(self) -> bool:
        """Process the next packet. Return whether there was one."""
        try:
            packet, sender, arrived_s = receive(self._socket, MAX_PACKET)
        except OSError:
            return False
        self._answer(packet, sender, arrived_s - self._sent_s)
        return True

    def _answer(self, packet: bytes, sender: tuple[str, int], took_s: float) -> None:
        if self._client[0] not in ("0.0.0.0", sender[0]):
            return
        self._report_second_sender(sender)
        expected = self._expects
        self._deaf = False
        before = self._network.lost
        for arrived in self._network.from_client(packet):
            self._controller.answer(arrived)
        # Do not wait for packets that the network delays. An answer to an older message is not the answer to
        # this one.
        kept_back = self._network.lost > before or self._network.delay > 0 or self._network.reorder > 0.0
        self._expects = expected and not kept_back and self._controller.waits_for_answer
        if expected and not self._expects:
            self._times.answers.add(took_s)

    def _report_second_sender(self, sender: tuple[str, int]) -> None:
        """Report once that two programs send answers, because each would end the other's motion."""
        now_s = time.monotonic()
        if sender == self._sender or self._sender is None or now_s - self._sender_s > ALONE_S:
            self._two = self._two and sender == self._sender
            self._sender, self._sender_s = sender, now_s
        elif not self._two:
            self._two = True
            first, second = (f"{host}:{port}" for host, port in (self._sender, sender))
            self._controller.events.append(
                f"a second program sends: packets come from {second}, and from {first} until just now"
            )
