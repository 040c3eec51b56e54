"""Restarts a simulation."""

from __future__ import annotations

from app.services.rights.ownership import Ownership
from app.services.state.cell import CellService
from app.services.state.link import RobotLink
from cobot.errors import ConflictError, ExecutionError, NotSupportedError
from cobot.types import LoopMode

TIMEOUT_S = 1.5


class SimulationService:
    """Restarts the simulation of one robot."""

    def __init__(self, link: RobotLink, ownership: Ownership, cell: CellService) -> None:
        self._link = link
        self._ownership = ownership
        self._cell = cell

    async def reset(self) -> None:
        """Clear an e-stop or a fault, and return the arm and its cell to their initial state.

        Raises:
            NotSupportedError: the backend moves a real arm. The error names it.
            ConflictError: the arm is moving, a program is running, or the backend is a different simulation.
            NotReadyError: the cause of a fault persists; the error gives rtloop's reason.
            UnavailableError: rtloop does not answer.
        """
        link = self._link
        state = await link.await_fresh_state(TIMEOUT_S)
        named = link.device()
        if named is None:  # The arm may be real. Its e-stop must then stay latched.
            raise ConflictError(
                "the capabilities of the robot's backend cannot be read: try again in a second"
            )
        if named[1].capabilities.hardware:
            raise NotSupportedError(
                f"only a simulation can be reset, but the backend {named[0]} moves a real arm; POST "
                "/robot/reset leaves an e-stop or a fault"
            )
        self._ownership.require_free(None)
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            await link.commands.reset(TIMEOUT_S)
        try:
            await link.commands.restart()
        except ExecutionError as exc:
            raise ConflictError(f"the simulation cannot be reset now: {exc}") from exc
        if self._cell.cell is not None:
            link.events.publish("cell_reset")
