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
from cobot.cell.own_hand import (
    AnyHand,
    AnyOwnHand,
    OwnHand,
    SlidingFinger,
    TurningHand,
    TurningJoint,
    cell_of,
    hand_of,
    kind_of_hand,
)

__all__ = [
    "AnyHand",
    "AnyOwnHand",
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
    "TurningHand",
    "TurningJoint",
    "cell_file",
    "cell_of",
    "hand_of",
    "kind_of_hand",
    "load_cell",
]
