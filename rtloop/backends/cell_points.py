"""The inputs and outputs of a simulated cell: their names, kinds, ranges and initial values."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.cell import AnyHand
from cobot.cell.cell import COUNT, CUP, HAND, SPEED, SUCTION, VACUUM, Cell, Distance, LightBarrier
from cobot.robot.io_points import MAX_DIGITAL, IoKind, IoPoint

HAND_POINTS = 6
"""Number of inputs and outputs of the hand, which are listed first: width, speed and force, then measured
width, measured force and moving.
"""


@dataclass(frozen=True, slots=True)
class CellPoint:
    """An input or output of the cell.

    Attributes:
        first: initial value.
        low, high: range of an output.
    """

    name: str
    kind: IoKind
    is_output: bool
    first: float = 0.0
    low: float = float("-inf")
    high: float = float("inf")

    def reported(self, value: float) -> IoPoint:
        return IoPoint(self.name, self.kind, self.is_output, value)


def cell_points(cell: Cell, hand: AnyHand | None) -> tuple[CellPoint, ...]:
    """List all points of a cell: those of its hand or suction cup, the speeds of its belts, its switches, and
    other outputs.
    """
    return (*_of_hand(hand), *_of_cup(cell), *_of_belts(cell), *_of_switches(cell), *_other_outputs(cell))


def _of_hand(hand: AnyHand | None) -> list[CellPoint]:
    analog = IoKind.ANALOG
    if hand is None:
        return []
    stroke, speed, force = hand.stroke_m, hand.max_speed_m_s, hand.max_force_n
    return [
        CellPoint(f"{HAND}.width", analog, True, stroke, hand.closed_m, stroke),
        CellPoint(f"{HAND}.speed", analog, True, 0.5 * speed, 0.001, speed),
        CellPoint(f"{HAND}.force", analog, True, 0.5 * force, 0.0, force),
        CellPoint(f"{HAND}.measured_width", analog, False, stroke),
        CellPoint(f"{HAND}.measured_force", analog, False),
        CellPoint(f"{HAND}.moving", IoKind.BOOLEAN, False),
    ]


def _of_cup(cell: Cell) -> list[CellPoint]:
    if cell.cup is None:
        return []
    return [
        CellPoint(f"{CUP}.{SUCTION}", IoKind.BOOLEAN, True, high=1.0, low=0.0),
        CellPoint(f"{CUP}.{VACUUM}", IoKind.ANALOG, False),
    ]


def _of_belts(cell: Cell) -> list[CellPoint]:
    return [
        CellPoint(f"{name}.{SPEED}", IoKind.ANALOG, True, belt.speed_m_s, -2.0, 2.0)
        for name, belt in cell.belts.items()
    ]


def _of_switches(cell: Cell) -> list[CellPoint]:
    points = []
    for name, switch in cell.switches.items():
        is_analog = isinstance(switch, Distance)
        points.append(CellPoint(name, IoKind.ANALOG if is_analog else IoKind.BOOLEAN, False))
        if isinstance(switch, LightBarrier) and switch.count:
            points.append(CellPoint(f"{name}.{COUNT}", IoKind.DIGITAL, False))
    return points


def _other_outputs(cell: Cell) -> list[CellPoint]:
    high = {IoKind.BOOLEAN: 1.0, IoKind.DIGITAL: float(MAX_DIGITAL), IoKind.ANALOG: 1e9}
    return [
        CellPoint(name, each.kind, True, 0.0, -1e9 if each.kind is IoKind.ANALOG else 0.0, high[each.kind])
        for name, each in cell.outputs.items()
    ]
