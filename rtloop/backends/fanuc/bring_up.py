"""Uses the Remote Motion Interface to enable motion, and to report values that Stream Motion lacks.

These methods run on the worker's thread.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

from rtloop.backends import BackendError
from rtloop.backends.fanuc.options import FanucOptions
from rtloop.backends.fanuc.points import MAX_ANALOG, split
from rtloop.backends.fanuc.rmi import RmiClient, RmiStatus, number_of

SERVO_S, LOOK_S = 2.0, 0.1
"""Timeout for the servos to become ready after a reset, and the interval between checks, s."""
RELEASE_S = 0.5
"""Time for the controller to notice that a connection is closed, s. Measured on a CRX: 0.2 s."""
PORT_TYPES = {"F": "FLAG"}
PENDANT = "the teach pendant is on (T1 or T2): select AUTO and switch it off"


@dataclass(frozen=True, slots=True)
class RmiReport:
    """The report of the Remote Motion Interface.

    Attributes:
        drives: "on" or "off"; "" if unknown.
        text: alarms and other information for users.
    """

    drives: str = ""
    text: str = ""


class BringUp:
    """Prepares the controller for motion, with requests in the order that it requires."""

    def __init__(
        self,
        rmi: RmiClient,
        options: FanucOptions,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._rmi, self._options, self._clock, self._sleep = rmi, options, clock, sleep
        self._lost = ""  # reason why the last report failed

    def begin(self) -> None:
        """Clear the alarms, and start the program of Stream Motion.

        Raises:
            BackendError: the controller does not permit motion; the error gives the reason.
        """
        rmi = self._rmi
        if self._status().pendant:
            raise BackendError(PENDANT)
        rmi.command("Reset", "clear its alarms")
        self._await_servos()
        try:
            rmi.command("Initialize", "start remote motion")
        except BackendError:
            rmi.connect()
            rmi.command("Abort", "abort its program")
            rmi.command("Reset", "clear its alarms")
            rmi.command("Initialize", "start remote motion")
        if self._options.override is not None:
            rmi.command("SetOverRide", "set its speed override", Value=self._options.override)
        if self._options.payload_schedule is not None:
            number = self._options.payload_schedule
            rmi.command("SetPayloadID", f"select payload schedule {number}", ScheduleNumber=number)
        rmi.call(self._options.program, rmi.status().next_sequence or 1)

    def end(self) -> None:
        """Abort the program and end the session."""
        if self._rmi.is_connected:
            with contextlib.suppress(BackendError):
                self._rmi.command("Abort", "abort its program")
            self._rmi.disconnect()

    def report(self) -> RmiReport:
        """Return the current state. A lost connection is part of the report."""
        try:
            if not self._rmi.is_connected:
                why = f" ({self._lost})" if self._lost else ""
                return RmiReport(
                    text=f"the Remote Motion Interface is not connected{why}; a reset connects it"
                )
            self._lost = ""
            status = self._rmi.status()
            alarms = self._rmi.alarms()
        except BackendError as exc:
            self._lost = str(exc)
            return RmiReport(text=str(exc))
        reduced = status.override is not None and status.override < 100
        override = f"its speed override is {status.override} %, Stream Motion needs 100 %" if reduced else ""
        drives = "on" if status.servo_ready else "off"
        return RmiReport(drives, "; ".join(filter(None, (alarms, override))))

    def output(self, name: str) -> int:
        """Read the current value of an output."""
        kind, number = split(name)
        reply = self._rmi.command(
            "ReadIOPort",
            f"report {name}",
            PortType=PORT_TYPES.get(kind.name, kind.name),
            PortNumber=number,
        )
        value = number_of(reply.get("PortValue"))
        if not 0 <= value <= MAX_ANALOG:
            raise BackendError(f"the controller does not report the value of {name}")
        return int(value)

    def _status(self) -> RmiStatus:
        """Read the status. Begin a new session if the last one was lost."""
        self._rmi.connect()
        try:
            return self._rmi.status()
        except BackendError:
            self._rmi.drop()
            self._sleep(RELEASE_S)
            self._rmi.connect()
            return self._rmi.status()

    def _await_servos(self) -> None:
        deadline_s = self._clock() + SERVO_S
        while not self._rmi.status().servo_ready:
            if self._clock() > deadline_s:
                alarms = self._rmi.alarms()
                raise BackendError(
                    f"the arm's servos are off: {alarms}" if alarms else "the arm's servos are off"
                )
            self._sleep(LOOK_S)
