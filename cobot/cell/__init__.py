"""The physical cell of a simulated robot: hand, parts, fixtures, belts, switches."""

from cobot.cell.cell import (
    Belt,
    Cell,
    CellPart,
    CellSolid,
    ContactSwitch,
    Cup,
    Distance,
    Hand,
    LightBarrier,
    cell_file,
    load_cell,
)
from cobot.cell.own_hand import AnyHand, OwnHand, SlidingFinger, cell_of, hand_of

__all__ = [
    "AnyHand",
    "Belt",
    "Cell",
    "CellPart",
    "CellSolid",
    "ContactSwitch",
    "Cup",
    "Distance",
    "Hand",
    "LightBarrier",
    "OwnHand",
    "SlidingFinger",
    "cell_file",
    "cell_of",
    "hand_of",
    "load_cell",
]
