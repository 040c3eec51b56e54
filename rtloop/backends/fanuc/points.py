"""Inputs and outputs in the packets of Stream Motion.

Points with consecutive numbers form a block. Blocks follow each other in the packets' bytes; each begins at a
multiple of four bytes. Eight boolean points share a byte; an analog point has two bytes. Outputs have a block
in the status packets, with their current values, and another one in the commands.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from cobot.robot.io_points import IoKind, IoPoint
from rtloop.backends import BackendError
from rtloop.backends.fanuc.messages import IO_BYTES, IoBlock, IoBlockKind, PointType

OUTPUTS = (PointType.DO, PointType.RO, PointType.AO, PointType.F)
ANALOG = (PointType.AO, PointType.AI)
ALIGNMENT = 4
MAX_ANALOG = 0xFFFF
_WORD = struct.Struct("<H")


def is_output(kind: PointType) -> bool:
    return kind in OUTPUTS


def split(name: str) -> tuple[PointType, int]:
    """Split the name of a point such as DO[1] into its kind and number."""
    kind, _, number = name.rstrip("]").partition("[")
    return PointType[kind], int(number)


@dataclass(slots=True)
class PointLayout:
    """The position of each point in the bytes of a packet.

    Attributes:
        places: for each name, the index of the first byte, and the bit within it for a boolean point.
    """

    kind: IoBlockKind
    blocks: list[IoBlock] = field(default_factory=list)
    places: dict[str, tuple[int, int]] = field(default_factory=dict)
    size: int = 0

    def add(self, block: IoBlock) -> None:
        analog = block.type in ANALOG
        for index in range(block.length):
            place = (self.size + 2 * index, 0) if analog else (self.size + index // 8, index % 8)
            self.places[f"{block.type.name}[{block.start + index}]"] = place
        self.blocks.append(block)
        length = 2 * block.length if analog else -(-block.length // 8)
        self.size += -(-length // ALIGNMENT) * ALIGNMENT

    def read(self, data: bytes, name: str) -> int:
        at, bit = self.places[name]
        if split(name)[0] in ANALOG:
            value: int = _WORD.unpack_from(data, at)[0]
            return value
        return data[at] >> bit & 1

    def write(self, data: bytearray, name: str, value: int) -> None:
        at, bit = self.places[name]
        if split(name)[0] in ANALOG:
            _WORD.pack_into(data, at, value)
        else:
            data[at] = data[at] & ~(1 << bit) | value << bit


def layout_of(blocks: Sequence[IoBlock], kind: IoBlockKind) -> PointLayout:
    """Return the layout of the blocks of one kind."""
    found = PointLayout(kind)
    for block in blocks:
        if block.kind == kind:
            found.add(block)
    return found


def blocks_of(names: Sequence[str]) -> tuple[IoBlock, ...]:
    """Return the smallest set of blocks that contains these points.

    Raises:
        BackendError: the blocks do not fit into a packet.
    """
    points = sorted({split(name) for name in names})
    starts = [index for index, pair in enumerate(pairwise([(None, 0), *points])) if not _follows(*pair)]
    runs = [points[begin:end] for begin, end in pairwise([*starts, len(points)])]
    found = [IoBlock(IoBlockKind.STATE, run[0][0], run[0][1], len(run)) for run in runs]
    found += [
        IoBlock(IoBlockKind.COMMAND, run[0][0], run[0][1], len(run)) for run in runs if is_output(run[0][0])
    ]
    sizes = [layout_of(found, kind).size for kind in (IoBlockKind.STATE, IoBlockKind.COMMAND)]
    if len(found) > 32 or max(sizes) > IO_BYTES:
        raise BackendError(
            f"robot.backend.io: the {len(points)} points need {len(found)} blocks, allowed: 32; choose "
            "consecutive numbers, or fewer points"
        )
    return tuple(found)


def _follows(before: tuple[PointType | None, int], after: tuple[PointType | None, int]) -> bool:
    return before[0] == after[0] and before[1] + 1 == after[1]


class Points:
    """The configured inputs and outputs: the values that the controller reports, and the outputs to set.

    Real-time safe. It takes almost no time if no points are configured.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.blocks = blocks_of(names)
        self._state = layout_of(self.blocks, IoBlockKind.STATE)
        self._command = layout_of(self.blocks, IoBlockKind.COMMAND)
        self._bytes = bytearray(IO_BYTES)

    @property
    def outputs(self) -> list[str]:
        return [name for name in self.names if name in self._command.places]

    def begin(self, values: Mapping[str, int]) -> None:
        """Copy the current values of all outputs, so that the first command changes no output."""
        for name, value in values.items():
            self._command.write(self._bytes, name, value)

    def reported(self, data: bytes) -> list[IoPoint]:
        found = []
        for name in self.names:
            analog = split(name)[0] in ANALOG
            value = float(self._state.read(data, name)) if data else 0.0
            kind = IoKind.DIGITAL if analog else IoKind.BOOLEAN
            found.append(IoPoint(name, kind, name in self._command.places, value))
        return found

    def set(self, name: str, value: float) -> None:
        """Set an output with the next command.

        Raises:
            BackendError: there is no such output, or the value is out of range.
        """
        if name not in self._command.places:
            known = ", ".join(self.outputs) or "none"
            raise BackendError(f"{name} is not one of the outputs in robot.backend.io: {known}")
        if not 0 <= value <= MAX_ANALOG:
            raise BackendError(f"{name}: the value is {value:g}, allowed: 0 to {MAX_ANALOG}")
        self._command.write(self._bytes, name, int(value))

    @property
    def data(self) -> bytes:
        """Return the output bytes to send with a command."""
        return bytes(self._bytes)
