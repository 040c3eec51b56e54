"""Pulls a link of the simulated arm during freedrive, as a hand pulls a real arm.

Only the simulation supports this. It limits the force, and ends each pull `cobot.ipc.layout.PULL_S` after the
last frame, even if the client and the service have died.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from app.services.clients import CLIENT
from app.services.state.link import RobotLink
from app.services.streaming.freedrive import FreedriveService
from cobot.errors import CobotError, ConflictError, ExecutionError, NotSupportedError


class Pulling:
    """Pulls a simulated arm for one client."""

    def __init__(self, link: RobotLink, freedrive: FreedriveService) -> None:
        self._link = link
        self._freedrive = freedrive
        self._pulls = False
        self._task: asyncio.Task[None] | None = None

    async def pull(self, link: str, point: Sequence[float], target: Sequence[float]) -> None:
        """Pull the arm for `PULL_S`, or until the next call.

        Args:
            link: name of a body that is moved by the joints.
            point: point on the link, in the link's frame, m.
            target: position that the point is pulled to, in the base frame, m.

        Raises:
            NotSupportedError: the backend moves a real arm, or is a simulation that does not support this.
                The error names the backend.
            ConflictError: this client is not guiding the arm, or the link cannot be pulled.
            UnavailableError: rtloop does not answer.
        """
        self._require_simulation()
        self._freedrive.require(CLIENT.get())
        self._pulls = True
        try:
            await self._link.commands.pull(link, point, target)
        except ExecutionError as exc:
            raise ConflictError(f"the arm cannot be pulled: {exc}") from exc

    async def let_go(self) -> None:
        """End the pull of this client, if there is one."""
        if self._pulls:
            self._pulls = False
            await self._link.commands.pull("")

    def close(self) -> None:
        """End the pull after the client has disconnected."""
        if self._pulls:
            self._task = asyncio.create_task(self._end(), name="end of a pull")

    async def _end(self) -> None:
        try:
            await self.let_go()
        except CobotError:
            return  # the simulation ends the pull on its own

    def _require_simulation(self) -> None:
        named = self._link.device()
        if named is None:
            raise ConflictError(
                "the capabilities of the robot's backend cannot be read: try again in a second"
            )
        backend, device = named
        if device.capabilities.hardware:
            raise NotSupportedError(
                f"only a simulated arm can be pulled with the mouse, but the backend {backend} moves a "
                "real arm; push it with your hand"
            )
