"""The simulated cell of a robot."""

from __future__ import annotations

from app.services.state.link import RobotLink
from cobot.cell import Cell
from cobot.errors import ConflictError, ExecutionError, NotFoundError, UnavailableError
from cobot.robot.io_points import IoPoint
from cobot.types import Numbers7

TIMEOUT_S = 1.5


class CellService:
    """Reads and resets the cell.

    Attributes:
        cell: the content of the cell file; None if there is no cell.
    """

    def __init__(self, link: RobotLink, cell: Cell | None) -> None:
        self.cell = cell
        self._link = link

    def require(self) -> Cell:
        """Return the simulated cell. Raises NotFoundError, with advice, if the robot has none."""
        if self.cell is None:
            raise NotFoundError(
                "this robot has no simulated cell; start it with cobot run --cell FILE, or set robot.cell"
            )
        return self.cell

    def parts(self) -> dict[str, Numbers7]:
        """Return the poses of the parts in the base frame.

        Raises:
            NotFoundError: there is no cell.
            UnavailableError: the poses cannot be read.
        """
        self.require()
        poses = self._link.cell()
        if poses is None:
            raise UnavailableError("rtloop has not reported the parts of the cell yet")
        return poses

    def switches(self) -> list[IoPoint]:
        """Return the inputs that report the switches and their counters.

        Raises:
            NotFoundError: there is no cell.
            UnavailableError: the inputs cannot be read.
        """
        names = self.require().switches
        report = self._link.io()
        if report is None:
            raise UnavailableError("rtloop has not reported its inputs and outputs yet")
        return [
            point for point in report.points if not point.is_output and point.name.partition(".")[0] in names
        ]

    async def reset(self) -> None:
        """Reset the parts, the hand, the outputs and the counters to their initial state. The arm stays where
        it is.

        Raises:
            NotFoundError: there is no cell.
            ConflictError: the arm is moving.
            UnavailableError: rtloop does not answer.
        """
        self.require()
        await self._link.await_fresh_state(TIMEOUT_S)
        try:
            await self._link.commands.reset_cell()
        except ExecutionError as exc:
            raise ConflictError(f"the cell cannot be reset now: {exc}") from exc
        self._link.events.publish("cell_reset")
