"""rtloop's reports about its device, and the speed that the device's state permits."""

from __future__ import annotations

import logging
import math
from dataclasses import replace

import numpy as np

from cobot.errors import CobotError
from cobot.foreign import plain_error
from cobot.ipc.device_record import fill_capabilities, fill_status
from cobot.ipc.io_record import fill_points
from cobot.ipc.layout import IO_NAME_BYTES, IO_POINTS, text
from cobot.ipc.shm import RobotMemory, encoded
from cobot.robot.io_points import IoPoint, io_points, output_of, require_number
from cobot.strict import shown
from cobot.types import Array
from rtloop.backends import (
    Backend,
    BackendError,
    HasIo,
    Reporting,
    Simulated,
    SwitchesOffLater,
    capabilities_of,
)
from rtloop.backends.guarded import ForeignError
from rtloop.cell_watch import CellWatch
from rtloop.results import ACCEPTED, Accepted, Rejected

POLL_S = 0.2
"""Interval between polls of a device, s, unless its backend defines `report_period_s`."""
MIN_POLL_S = 0.001
NO_SIMULATION = "only the simulation of cobot can do this, and the backend is another one"
ENABLING = "a reset is enabling the robot"
FIRST_SHARE = 0.1
"""Speed of real hardware until its first contact is acknowledged, as a share of the planned speed."""

log = logging.getLogger("cobot.rtloop")


class DeviceWatch:
    """Polls the device several times a second, between cycles. It also stores, across restarts of rtloop,
    whether a user has acknowledged the first contact, and whether the drives are off.

    Attributes:
        asks: whether the device reports anything that can be polled.
        capabilities: capabilities of the device.
        period_s: interval between polls of the device.
        cell: reports the simulated cell.
        t1_share: permitted share of the joints' maximum speed for streams in T1; None in other modes.
        unacknowledged: findings of the first contact that a user must still acknowledge; "" if there are
            none.
        is_enabling: whether a reset that takes several cycles is in progress.
    """

    def __init__(self, memory: RobotMemory, backend: Backend) -> None:
        self._block, self._io_block = memory.device, memory.io
        self._device = backend if isinstance(backend, Reporting) else None
        self.capabilities = capabilities_of(backend)
        self._io = backend if isinstance(backend, HasIo) and self.capabilities.io else None
        is_real = self.capabilities.hardware
        self._simulation = backend if isinstance(backend, Simulated) and not is_real else None
        self._switching = backend if isinstance(backend, SwitchesOffLater) else None
        self._read_input = getattr(backend, "read_input", None) if self._io is not None else None
        self._points: tuple[IoPoint, ...] | None = None
        self._left_out: list[str] = []
        self.asks = any(each is not None for each in (self._device, self._io, self._switching))
        self.period_s = _report_period_s(backend)
        self.cell = CellWatch(memory, backend, self.period_s)
        record = self._block.data
        known = self._block.sequence > 0 and self._block.try_read()
        self._off = bool(known and record["drives_off"])
        self._acknowledged = bool(known and record["hardware"] and not record["unacknowledged"])
        self.unacknowledged = ""
        self.is_enabling = False
        self._scaling = self._slowed = 1.0
        self.t1_share: float | None = None
        fill_capabilities(record, self.capabilities)
        record["says"] = 0
        self._publish()

    @property
    def share(self) -> float:
        """The permitted speed of planned motions, as a share of their planned speed, 0 to 1."""
        return self._slowed * self._scaling * (FIRST_SHARE if self.unacknowledged else 1.0)

    @property
    def drives_off(self) -> bool:
        """Whether the drives are off after a category 1 stop; False until they have been switched off."""
        return self._off and not (self._switching is not None and self._switching.is_switching_off())

    def slow_down(self, share: float) -> None:
        """Slow down all planned motions to this share of their speed, because of the device's own limits."""
        self._slowed = share
        self._publish()

    def meet(self, found: str) -> None:
        """Handle the first contact with real hardware. The user need not acknowledge it again after a restart
        of rtloop.

        Args:
            found: sentences about the arm's position and load.
        """
        if not self._acknowledged:
            self.unacknowledged = found
            log.warning("%s", found)
        self._publish()

    def acknowledge(self) -> None:
        """Record that a user has checked the findings against the arm."""
        self._acknowledged, self.unacknowledged = True, ""
        self._publish()

    def set_drives(self, *, off: bool) -> None:
        """Record whether the drives are off."""
        self._off = off
        self._publish()

    def ask(self) -> None:
        """Publish the device's report. Values that the device cannot report stay unchanged.

        Raises:
            ForeignError: a report is unusable, or the device's class has a bug.
        """
        reports = (("io", self._report_io), ("part_poses", self.cell.report), ("status", self._report_status))
        for name, report in reports:
            try:
                report()
            except ForeignError:
                raise
            except BackendError:
                continue
            except Exception as exc:
                raise ForeignError(
                    f"the backend's {name}() returns an unusable value: {plain_error(exc)}"
                ) from exc
        if bool(self._block.data["drives_off"]) != self.drives_off:
            self._publish()

    def _report_status(self) -> None:
        if self._device is None:
            return
        status = self._device.status()
        scaling: object = status.speed_scaling
        if not (isinstance(scaling, int | float | np.number) and math.isfinite(scaling) and scaling >= 0.0):
            raise ForeignError(
                f"the backend's status().speed_scaling is {shown(scaling)}; it must be a number of 0 or more"
            )
        if self.is_enabling:
            status = replace(status, text="; ".join(filter(None, (ENABLING, status.text))))
        fill_status(self._block.data, status)
        if not self.capabilities.trajectories:  # a device that executes whole motions slows them down itself
            self._scaling = min(float(scaling), 1.0)
        self.t1_share = self._scaling if status.operation_mode == "T1" else None
        self._publish()

    def set_output(self, name: str, value: float) -> Accepted | Rejected:
        """Set an output of the device."""
        if self._io is None:
            return Rejected("the device has no outputs")
        try:
            require_number(output_of(self._points or (), name), value)
            self._io.set_output(name, value)
        except (CobotError, BackendError) as exc:
            return Rejected(str(exc))
        return ACCEPTED

    def restart(self, position: Array) -> Accepted | Rejected:
        """Reset the simulated arm and its cell to their initial state."""
        if self._simulation is None:
            return Rejected(NO_SIMULATION)
        try:
            self._simulation.restart(position)
        except BackendError as exc:
            return Rejected(str(exc))
        return ACCEPTED

    def pull(self, record: np.ndarray) -> Accepted | Rejected:
        """Pull the simulated arm, or release it.

        Args:
            record: record of the type `cobot.ipc.layout.PULL`.
        """
        if self._simulation is None:
            return Rejected(NO_SIMULATION)
        try:
            if link := text(record["link"]):
                self._simulation.pull(link, record["point"], record["target"])
            else:
                self._simulation.let_go()
        except BackendError as exc:
            return Rejected(str(exc))
        return ACCEPTED

    def read_input(self, name: str) -> float:
        """Return the current value of an input. Real-time safe if the device's own method is.

        Raises:
            BackendError: there is no such input, or the device cannot read it.
        """
        if self._read_input is not None:
            return float(self._read_input(name))
        points = () if self._io is None else self._io.io()
        for point in points:
            if point.name == name:
                return float(point.value)
        raise BackendError(f"there is no input {shown(name)}")

    def _report_io(self) -> None:
        if self._io is None:
            return
        points = io_points(self._io.io())
        record = self._io_block.data
        if points != self._points:
            left_out = fill_points(record, points)
            if left_out != self._left_out:
                log.warning(
                    "these inputs and outputs of the device are not shown: %s; cobot shows up to %d, with "
                    "names of up to %d bytes",
                    ", ".join(left_out) or "none",
                    IO_POINTS,
                    IO_NAME_BYTES,
                )
            self._points, self._left_out = points, left_out
        record["number"] += 1
        self._io_block.publish()

    def _publish(self) -> None:
        record = self._block.data
        record["share"], record["drives_off"] = self.share, self.drives_off
        record["unacknowledged"] = encoded(self.unacknowledged, record.dtype["unacknowledged"].itemsize)
        self._block.publish()


def _report_period_s(backend: Backend) -> float:
    """Return the interval between polls of this backend, s.

    Raises:
        BackendError: the backend's interval is not a number from 0.001 s to `POLL_S`.
    """
    period_s = getattr(backend, "report_period_s", POLL_S)
    if not (isinstance(period_s, int | float) and MIN_POLL_S <= period_s <= POLL_S):
        raise BackendError(
            f"the backend's report_period_s is {shown(period_s)}; it must be from "
            f"{MIN_POLL_S:g} to {POLL_S:g} s"
        )
    return float(period_s)
