"""The inputs and outputs of a robot's device, by name."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace

from app.services.state.link import POLL_S, RobotLink
from cobot.errors import DeviceError, DeviceTimeout, ExecutionError, NotFoundError, UnavailableError
from cobot.ipc.io_record import IoReport
from cobot.robot.io_points import IoPoint, number_of, output_of
from cobot.strict import shown


class IoService:
    """Reads the values that the device has reported, and sets outputs one at a time."""

    def __init__(self, link: RobotLink) -> None:
        self._link = link
        self._turn = asyncio.Lock()

    def points(self) -> tuple[str, list[IoPoint] | None]:
        """Return the backend's name, and its inputs and outputs. The inputs and outputs are None if the
        backend cannot have any.

        Raises:
            UnavailableError: the inputs and outputs cannot be read.
        """
        named = self._link.device()
        if named is None:
            raise UnavailableError("the real-time loop has not reported its robot yet: try again in a second")
        backend, device = named
        return backend, list(self._report().points) if device.capabilities.io else None

    async def set_output(self, name: str, value: float, timeout_s: float) -> IoPoint:
        """Set an output and wait until the device reports the new value.

        Args:
            value: true or false, or a number, according to the kind of the output.

        Raises:
            NotFoundError: there is no such output; the error lists the existing ones.
            InputError, LimitError: the name belongs to an input, or the value is invalid.
            DeviceError: the device rejects the value; the error gives the device's reason.
            DeviceTimeout: the device has not reported the value in time.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._link.await_fresh_state(timeout_s)
            backend, points = self.points()
            if points is None:
                raise NotFoundError(
                    f"there is no output {shown(name)}, because the backend {backend} has no inputs and "
                    "outputs"
                )
            number = number_of(output_of(points, name), value)
            try:
                await self._link.commands.set_output(name, number)
            except ExecutionError as exc:
                raise DeviceError(str(exc)) from exc
            return await self._await_report(name, number, timeout_s)

    async def _await_report(self, name: str, number: float, timeout_s: float) -> IoPoint:
        deadline_s, before = self._link.clock.now_s() + timeout_s, self._report().number
        while True:
            report = self._report()
            point = output_of(report.points, name)
            if report.number != before and point.has(number):
                return point
            if self._link.clock.now_s() > deadline_s:
                wanted = replace(point, value=number)
                raise DeviceTimeout(
                    f"{name} was sent to the device, which has not reported {json.dumps(wanted.shown)} "
                    f"within {timeout_s:g} s; it reports {json.dumps(point.shown)}"
                )
            await asyncio.sleep(POLL_S)

    def _report(self) -> IoReport:
        report = self._link.io()
        if report is None:
            raise UnavailableError("the device's inputs and outputs cannot be read")
        return report
