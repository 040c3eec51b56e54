"""Sockets, timers, and the thread that serves both.

All code in this package holds `Wire.lock` while it changes state.
"""

from __future__ import annotations

import errno
import heapq
import itertools
import logging
import selectors
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from ipaddress import IPv4Interface

from cobot.dds.rtps.errors import NetworkError
from cobot.dds.rtps.network import (
    DISCOVERY_GROUP,
    LOOPBACK,
    MAX_PARTICIPANTS,
    Ports,
    first_addresses,
    local_interfaces,
)
from cobot.dds.rtps.types import Address, ParticipantLimits, ParticipantStatistics

_log = logging.getLogger(__name__)

_BUFFER_BYTES = 4 << 20
_SO_RCVBUFFORCE = 33  # asm-generic/socket.h: for privileged processes, also above the system's limit
_DATAGRAMS_AT_ONCE = 64


class Wire:
    """The UDP sockets of one participant.

    peers: addresses of computers that multicast does not reach.
    loss: a test's model of a bad network; called once per datagram in either direction, True drops it.
    """

    def __init__(
        self,
        domain_id: int,
        interfaces: Sequence[str] | None,
        localhost_only: bool,
        peers: Sequence[str],
        limits: ParticipantLimits,
        loss: Callable[[], bool] | None,
    ) -> None:
        self.lock = threading.RLock()
        self.limits = limits
        self.statistics = ParticipantStatistics()
        self._wanted = (LOOPBACK,) if localhost_only else interfaces
        self.interfaces = local_interfaces(self._wanted)
        self._peers = tuple(peers)
        self._ports = Ports(domain_id)
        self._loss = loss
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._timer_numbers = itertools.count()
        self._wakes_at = 0.0
        self._closing = False
        self._sockets = ExitStack()
        with ExitStack() as opened:
            self._selector = opened.enter_context(selectors.DefaultSelector())
            self._open(opened, LOOPBACK if localhost_only else "")
            self._sockets = opened.pop_all()
        self._thread = threading.Thread(target=self._run, name="rtps-wire", daemon=True)

    def _open(self, opened: ExitStack, listen: str) -> None:
        def udp() -> socket.socket:
            made = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            made.setblocking(False)
            return made

        self.participant_id, unicast = _bind_pair(udp, listen, self._ports)
        self._multicast = udp()
        self._multicast.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._multicast.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self._multicast.bind((DISCOVERY_GROUP, self._ports.discovery))
        self.has_multicast = _join(self._multicast, self.interfaces)
        for receiver in (*unicast, self._multicast):
            _enlarge(receiver)
            self._selector.register(receiver, selectors.EVENT_READ)
        self._wake_in, self._wake_out = (opened.enter_context(end) for end in socket.socketpair())
        self._wake_in.setblocking(False)
        self._wake_out.setblocking(False)
        self._selector.register(self._wake_in, selectors.EVENT_READ)
        self._sender = udp()
        self._sender.bind((listen, 0))
        self._sender.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER_BYTES)
        self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)

    @property
    def metatraffic(self) -> list[Address]:
        """Addresses at which discovery messages reach this participant."""
        port = self._ports.metatraffic(self.participant_id)
        return [(str(interface.ip), port) for interface in self.interfaces]

    @property
    def user(self) -> list[Address]:
        """Addresses at which samples reach this participant."""
        port = self._ports.user(self.participant_id)
        return [(str(interface.ip), port) for interface in self.interfaces]

    @property
    def told_one_by_one(self) -> tuple[str, ...]:
        """Computers to which announcements are also sent by unicast, at the ports of their first
        participants.
        """
        return self._peers if self.has_multicast else (LOOPBACK, *self._peers)

    def look_around(self) -> None:
        """Start to use new networks, and stop using those that are gone."""
        with suppress(NetworkError):  # networks that are gone may come back
            self.interfaces = local_interfaces(self._wanted)
        self.has_multicast = _join(self._multicast, self.interfaces)

    def start(self, on_datagram: Callable[[memoryview, str], None]) -> None:
        """Start the thread, which calls `on_datagram(view, sender's IPv4 address)` with the lock held.

        `on_datagram` must not store the view.
        """
        self._on_datagram = on_datagram
        self._thread.start()

    def send(self, datagram: bytes, address: Address) -> None:
        if self._loss is not None and self._loss():
            self.statistics.datagrams_dropped += 1
            return
        try:
            self._sender.sendto(datagram, address)
        except OSError:  # no route or a full buffer: the same as a loss on the network
            self.statistics.send_errors += 1
        else:
            self.statistics.datagrams_sent += 1

    def multicast(self, datagram: bytes) -> None:
        """Send to the discovery group on every interface. Computers that multicast does not reach get a
        unicast copy at their first ports.
        """
        for address in first_addresses(self.told_one_by_one, self._ports):
            self.send(datagram, address)
        for interface in self.interfaces:
            with suppress(OSError):  # an interface that is down now may be up the next time
                self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface.ip.packed)
                self.send(datagram, (DISCOVERY_GROUP, self._ports.discovery))

    def later(self, delay_s: float, action: Callable[[], None]) -> None:
        """Call `action` on this object's thread with the lock held, after a delay. The call cannot be
        cancelled.
        """
        due_s = time.monotonic() + delay_s
        heapq.heappush(self._timers, (due_s, next(self._timer_numbers), action))
        if due_s < self._wakes_at and threading.current_thread() is not self._thread:
            self._wakes_at = due_s
            self._wake()

    def _wake(self) -> None:
        with suppress(BlockingIOError):  # the pipe is already full of wake-ups
            self._wake_out.send(b"\0")

    def close(self) -> None:
        with self.lock:
            if self._closing:
                return
            self._closing = True
            self._wake()
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self._sockets.close()

    def _run(self) -> None:
        buffer = bytearray(1 << 16)
        while not self._closing:
            with self.lock:
                timeout_s = self._run_timers()
            for key, _ in self._selector.select(timeout_s):
                receiver = key.fileobj
                assert isinstance(receiver, socket.socket)
                if receiver is self._wake_in:
                    receiver.recv(4096)
                else:
                    self._receive(receiver, buffer)

    def _run_timers(self) -> float | None:
        """Run the timers that are due. Returns the time until the next one, in seconds."""
        now_s = time.monotonic()
        while self._timers and self._timers[0][0] <= now_s:
            self._run_guarded(heapq.heappop(self._timers)[2])
        self._wakes_at = self._timers[0][0] if self._timers else float("inf")
        return max(0.0, self._wakes_at - time.monotonic()) if self._timers else None

    def _receive(self, receiver: socket.socket, buffer: bytearray) -> None:
        view = memoryview(buffer)
        for _ in range(_DATAGRAMS_AT_ONCE):
            try:
                size, address = receiver.recvfrom_into(buffer)
            except OSError:  # there is nothing left to read, or an ICMP error for an earlier datagram
                return
            with self.lock:
                self.statistics.datagrams_received += 1
                if self._loss is not None and self._loss():
                    self.statistics.datagrams_dropped += 1
                    continue
                self._run_guarded(partial(self._on_datagram, view[:size], address[0]))

    def _run_guarded(self, action: Callable[[], None]) -> None:
        """Run an action. Its errors are logged, because they must not end this thread."""
        try:
            action()
        except Exception:  # noqa: BLE001 - logged and counted
            self.statistics.failed += 1
            _log.exception("an error in the RTPS wire thread")


def _bind_pair(
    udp: Callable[[], socket.socket], listen: str, ports: Ports
) -> tuple[int, tuple[socket.socket, socket.socket]]:
    """Bind the sockets. Returns the lowest participant number whose two ports are free, and the sockets."""
    metatraffic, user = udp(), udp()
    for number in range(MAX_PARTICIPANTS):
        try:
            metatraffic.bind((listen, ports.metatraffic(number)))
        except OSError:
            continue
        try:
            user.bind((listen, ports.user(number)))
        except OSError:
            metatraffic.close()  # a bound socket cannot be bound again
            metatraffic = udp()
            continue
        return number, (metatraffic, user)
    raise NetworkError(f"all {MAX_PARTICIPANTS} participant ports of domain {ports.domain_id} are taken")


def _join(receiver: socket.socket, interfaces: Sequence[IPv4Interface]) -> bool:
    """Join the discovery group on each interface with multicast. Returns whether there is such an
    interface.
    """
    group = socket.inet_aton(DISCOVERY_GROUP)
    joined = False
    for interface in interfaces:
        try:
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + interface.ip.packed)
        except OSError as exc:
            joined = joined or exc.errno == errno.EADDRINUSE  # already joined on this interface
        else:
            joined = True
    return joined


def _enlarge(receiver: socket.socket) -> None:
    """Enlarge a receive buffer for bursts. If the system denies this, retransmission repairs the losses."""
    try:
        receiver.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
    except PermissionError:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
