"""Restarts a simulation, and changes its time factor."""

from __future__ import annotations

from app.services.rights.ownership import Ownership
from app.services.state.cell import CellService
from app.services.state.link import RobotLink
from cobot.errors import ConflictError, ExecutionError, NotSupportedError
from cobot.types import LoopMode

TIMEOUT_S = 1.5


class SimulationService:
    """Restarts the simulation of one robot, and changes its time factor."""

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
        if backend := self._real_backend():
            raise NotSupportedError(
                f"only a simulation can be reset, but the backend {backend} moves a real arm; POST "
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

    async def set_time_factor(self, factor: float) -> None:
        """Set the time factor: robot time per wall time while a planned motion runs.

        Raises:
            NotSupportedError: the backend moves a real arm. The error names it.
            ConflictError: another client is moving the arm or has control, the robots of a synchronous motion
                move, or the robot does not use the computer's clock.
            UnavailableError: rtloop does not answer.
        """
        await self._link.await_fresh_state(TIMEOUT_S)
        if backend := self._real_backend():
            raise NotSupportedError(
                f"only a simulation has a time factor, but the backend {backend} moves a real arm; POST "
                "/robot/speed_override slows its motions down"
            )
        self._ownership.require_control()
        self._ownership.require_mover("change the time factor")
        await self._ownership.speed_override.set_time_factor(factor)

    def _real_backend(self) -> str:
        """Return the name of the backend if it moves a real arm; otherwise "".

        Raises:
            ConflictError: this is unknown. The arm may be real. Its e-stop must then stay latched.
        """
        named = self._link.device()
        if named is None:
            raise ConflictError(
                "the capabilities of the robot's backend cannot be read: try again in a second"
            )
        return named[0] if named[1].capabilities.hardware else ""
