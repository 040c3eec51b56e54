"""Publishes rtloop's reports about the parts of a simulated cell."""

from __future__ import annotations

from cobot.ipc.layout import CELL_PARTS
from cobot.ipc.shm import RobotMemory
from rtloop.backends import Backend, BackendError, HasCell
from rtloop.results import ACCEPTED, Accepted, Rejected

PERIOD_S = 0.02
"""Minimum interval between two reports, s."""


class CellWatch:
    """Publishes the poses of the simulated parts. It does nothing if the backend simulates no cell.

    Args:
        poll_s: interval between calls of `report`.
    """

    def __init__(self, memory: RobotMemory, backend: Backend, poll_s: float) -> None:
        self._block = memory.cell
        self._cell = backend if isinstance(backend, HasCell) else None
        self._calls, self._every = 0, max(1, round(PERIOD_S / poll_s))
        if self._cell is not None:
            names = self._cell.part_names[:CELL_PARTS]
            record = self._block.data
            record["count"] = len(names)
            record["names"][: len(names)] = [name.encode() for name in names]

    def report(self) -> None:
        """Publish the poses of all parts."""
        self._calls += 1
        if self._cell is not None and self._calls % self._every == 0:
            self._publish(self._cell)

    def reset(self) -> Accepted | Rejected:
        """Reset the cell to its initial state, and report that state at once."""
        if self._cell is None:
            return Rejected("there is no simulated cell")
        try:
            self._cell.reset_cell()
            self._publish(self._cell)
        except BackendError as exc:
            return Rejected(str(exc))
        return ACCEPTED

    def _publish(self, cell: HasCell) -> None:
        record = self._block.data
        cell.part_poses(record["poses"][: int(record["count"])])
        record["number"] += 1
        self._block.publish()
