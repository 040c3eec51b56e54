"""The physical cell of a simulated robot: hand, parts, fixtures, belts, switches."""

from cobot.cell.cell import (
    Belt,
    Cell,
    ContactSwitch,
    Distance,
    Hand,
    LightBarrier,
    Part,
    Solid,
    cell_file,
    load_cell,
)

__all__ = [
    "Belt",
    "Cell",
    "ContactSwitch",
    "Distance",
    "Hand",
    "LightBarrier",
    "Part",
    "Solid",
    "cell_file",
    "load_cell",
]
