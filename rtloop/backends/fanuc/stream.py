"""Stream Motion over UDP: the socket, and the requests that are made before the controller sends its
state.
"""

from __future__ import annotations

import select
import socket
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from rtloop.backends import BackendError
from rtloop.backends.fanuc.codec import (
    decode_received,
    encode_capability_request,
    encode_io_config,
    encode_limits_request,
    encode_stop,
)
from rtloop.backends.fanuc.limits_table import LimitsTable
from rtloop.backends.fanuc.messages import (
    MAX_PACKET,
    MIN_VERSION,
    CapabilityPacket,
    IoBlock,
    IoConfigRequest,
    IoConfigResult,
    LimitsPacket,
    LimitsRequest,
)

MAX_AT_ONCE = 256
AGAIN_S = 0.1
"""Interval at which a request is repeated, s, because packets may be lost."""
NEWEST_VERSION = 99
ReplyT = TypeVar("ReplyT")


class StreamChannel(Protocol):
    """Interface for sending packets to one controller and receiving packets from it."""

    def receive(self, timeout_s: float) -> list[bytes]:
        """Wait for a packet, and return all packets that have arrived, oldest first. Return [] after
        `timeout_s`.
        """
        ...

    def send(self, packet: bytes) -> None: ...

    def close(self) -> None: ...


class UdpClient:
    """A `StreamChannel` over UDP. The kernel drops packets that are not from the controller's address."""

    def __init__(self, host: str, port: int) -> None:
        """
        Raises:
            BackendError: the name is unknown, or the network cannot reach the address.
        """
        self._where = f"{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect((host, port))
        except OSError as exc:
            self._socket.close()
            raise BackendError(f"robot.backend.address: {self._where}: {exc.strerror}") from exc
        self._socket.setblocking(False)

    def receive(self, timeout_s: float) -> list[bytes]:
        packets: list[bytes] = []
        # Not poll, whose timeout is in whole milliseconds, which may be longer than a period.
        if not select.select([self._socket], [], [], max(timeout_s, 0.0))[0]:
            return packets
        for _ in range(MAX_AT_ONCE):
            try:
                packets.append(self._socket.recv(MAX_PACKET))
            except BlockingIOError:
                break
            except OSError:  # an error because an earlier packet went to a closed port
                continue
        return packets

    def send(self, packet: bytes) -> None:
        try:
            self._socket.send(packet)
        except ConnectionRefusedError:  # caused by an earlier packet; silence is detected elsewhere
            pass
        except OSError as exc:
            raise BackendError(f"cannot send to {self._where}: {exc.strerror}") from exc

    def close(self) -> None:
        self._socket.close()


class Handshake:
    """Requests to a controller that does not send its state yet. Each request waits for its reply."""

    def __init__(
        self, channel: StreamChannel, clock: Callable[[], float], timeout_s: float, where: str
    ) -> None:
        self._channel, self._clock, self._timeout_s, self._where = channel, clock, timeout_s, where
        self._heard = ""

    def capability(self) -> CapabilityPacket:
        """End a stream that an earlier client may have left open, and request the controller's capabilities.

        Raises:
            BackendError: there is no reply, or the version is too old.
        """
        self._channel.send(encode_stop(MIN_VERSION))
        found = self._ask(encode_capability_request(MIN_VERSION), CapabilityPacket, lambda _: True)
        if found is None:
            raise BackendError(
                f"no Stream Motion on UDP {self._where}: is option J519 installed, and does a firewall "
                f"block the packets?{self._heard}"
            )
        if not MIN_VERSION <= found.version <= NEWEST_VERSION:
            raise BackendError(
                f"the controller speaks Stream Motion {found.version}; version {MIN_VERSION} or later "
                "is needed: update its software to V9.40P/81 (R-30iB Mini Plus P/77, R-50iA "
                "V10.10P/26) or later"
            )
        return found

    def limits(self, version: int, dof: int) -> LimitsTable:
        """Request the limits table.

        Raises:
            BackendError: the controller has no limits table.
        """
        table = LimitsTable(dof)
        for axis, rate in list(table.missing()):

            def fits(packet: LimitsPacket, axis: int = axis, rate: int = rate) -> bool:
                return packet.axis == axis and packet.rate == rate

            found = self._ask(encode_limits_request(LimitsRequest(version, axis, rate)), LimitsPacket, fits)
            if found is None:
                raise BackendError(
                    f"the controller does not send the {rate.name.lower()} limits of axis {axis}: does it "
                    "have as many axes as the model? If robot.backend.limits is set to model, cobot "
                    "does not request this table, and only the controller's alarms enforce its limits"
                )
            table.take(found)
        return table

    def configure(self, version: int, blocks: Sequence[IoBlock]) -> None:
        """Choose the inputs and outputs that the packets contain.

        Raises:
            BackendError: the controller rejects them.
        """
        request = IoConfigRequest(version, tuple(blocks))
        found = self._ask(encode_io_config(request), IoConfigResult, lambda _: True)
        if found is None or found.result:
            said = f"error {found.result}" if found is not None else "no reply"
            raise BackendError(
                f"robot.backend.io: the controller does not accept these inputs and outputs ({said}): each "
                f"must be assigned at the controller, and at most 32 are allowed for each millisecond of its "
                f"period"
            )

    def _ask(self, packet: bytes, kind: type[ReplyT], fits: Callable[[ReplyT], bool]) -> ReplyT | None:
        """Send a request repeatedly until its reply arrives. Return None if no reply arrives in time."""
        deadline_s = self._clock() + self._timeout_s
        while (now_s := self._clock()) < deadline_s:
            self._channel.send(packet)
            again_s = min(now_s + AGAIN_S, deadline_s)
            while (left_s := again_s - self._clock()) > 0.0:
                for data in self._channel.receive(left_s):
                    found = decode_received(data)
                    if isinstance(found, kind) and fits(found):
                        return found
                    if isinstance(found, str):
                        self._heard = f" The last packet was rejected: {found}"
        return None
