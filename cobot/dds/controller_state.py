"""The state that a joint trajectory controller publishes: the positions of its joints. It is also published
while the arm does not move.

Releases of control_msgs differ in the fields after the second point of the message. So only the beginning is
read: the header, the joint names, the reference, and the measured state.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from cobot.dds.inbox import SampleInbox
from cobot.dds.names import topic_name, type_name
from cobot.dds.node import DdsNode
from cobot.dds.rtps import Qos, Sample
from cobot.errors import InputError

TYPE = "control_msgs/msg/JointTrajectoryControllerState"
MAX_ITEMS = 1000
ROWS = 4
"""Rows of numbers in a point: positions, velocities, accelerations, efforts."""


class ControllerState:
    """Reads the state of one controller."""

    def __init__(self, node: DdsNode, controller: str, take: Callable[[dict[str, float]], None]) -> None:
        """
        Args:
            take: called with the measured positions by the joint names.
        """
        self._take_positions, self._node = take, node
        topic = f"{controller}/controller_state"
        self._inbox = SampleInbox(topic, node.loop, self._take)
        qos = Qos(reliable=False, depth=None)
        self._reader = node.participant.create_reader(
            topic_name(topic), type_name(TYPE), qos, self._inbox.put
        )
        node.graph.add(self._reader.guid)

    def close(self) -> None:
        """Stop listening."""
        self._node.graph.remove(self._reader.guid)
        self._reader.close()

    def _take(self, sample: Sample) -> None:
        try:
            positions = measured_positions(sample.payload)
        except InputError:
            return
        self._take_positions(positions)


def measured_positions(content: bytes) -> dict[str, float]:
    """The measured positions in a message, in CDR of either byte order.

    Raises:
        InputError: the content is not a valid message.
    """
    try:
        return _measured(_Cdr(content))
    except (struct.error, IndexError, UnicodeDecodeError) as exc:
        raise InputError(f"{TYPE}: is not readable as CDR: {exc}") from exc


def _measured(cdr: _Cdr) -> dict[str, float]:
    cdr.number("i")
    cdr.number("I")
    cdr.text()
    names = [cdr.text() for _ in range(cdr.count())]
    positions: list[float] = []
    for _ in range(2):
        positions, *_ = [cdr.doubles() for _ in range(ROWS)]
        cdr.number("i")
        cdr.number("I")
    if len(positions) != len(names):
        raise InputError(f"{TYPE}: has {len(names)} joints and {len(positions)} positions")
    return dict(zip(names, positions, strict=True))


class _Cdr:
    """Reads plain CDR from its beginning."""

    def __init__(self, content: bytes) -> None:
        self._order = "<" if content[1] & 1 else ">"
        self._data, self._at = content[4:], 0

    def number(self, code: str) -> int:
        """Read an integer in the given `struct` format."""
        return int(self._values(code)[0])

    def count(self) -> int:
        """Read the number of items that follow."""
        count = self.number("I")
        if count > MAX_ITEMS:
            raise InputError(f"{TYPE}: has a list of {count} items, allowed: {MAX_ITEMS}")
        return count

    def text(self) -> str:
        """Read the length of a string, and then the string."""
        (found,) = self._values(f"{self.count()}s")
        return str(found.rstrip(b"\0"), "utf-8")

    def doubles(self) -> list[float]:
        """Read a list of numbers."""
        count = self.count()
        return list(self._values(f"{count}d")) if count else []  # an empty list is not padded

    def _values(self, code: str) -> tuple[Any, ...]:
        """Skip the padding, and read the next values. `code` is their format for `struct`."""
        self._at += -self._at % struct.calcsize(code[-1])
        found = struct.unpack_from(self._order + code, self._data, self._at)
        self._at += struct.calcsize(code)
        return found
