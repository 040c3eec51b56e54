"""The physical cell of a simulated robot: hand, parts, fixtures, belts, switches."""

from cobot.cell.cell import (
    Belt,
    Cell,
    CellPart,
    CellSolid,
    ContactSwitch,
    Distance,
    Hand,
    LightBarrier,
    cell_file,
    load_cell,
)

__all__ = [
    "Belt",
    "Cell",
    "CellPart",
    "CellSolid",
    "ContactSwitch",
    "Distance",
    "Hand",
    "LightBarrier",
    "cell_file",
    "load_cell",
]
