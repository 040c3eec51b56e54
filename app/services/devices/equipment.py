"""The equipment of one robot: registers, named variables, inputs and outputs, devices, and messages to
people.
"""

from __future__ import annotations

from enum import IntEnum

from app.services.devices.io_banks import IoBanks
from app.services.devices.modbus import Modbus
from app.services.devices.registers import Registers, Variables
from app.services.devices.serial_ports import SerialPorts
from app.services.devices.sockets import Sockets
from app.services.devices.traces import Level, Traces
from app.services.rights.speed_override import SpeedOverride
from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from cobot.errors import CobotError

STOP_TIMEOUT_S = 4.0


class WatchdogAction(IntEnum):
    """The action that a watchdog runs when it expires. A message is written in any case."""

    NONE = 0
    PAUSE = 1  # the arm stops on its path
    STOP = 2  # program and motion end
    PROTECTIVE_STOP = 3  # the program and the motion end, and nothing moves until it is unlocked


class Equipment:
    """The equipment of one robot.

    Attributes:
        simulated: whether the arm is simulated.
        registers, variables, io, modbus, sockets, serial_ports, traces: the parts of the equipment; see their
            classes.
    """

    def __init__(
        self, link: RobotLink, stopping: StopService, speed_override: SpeedOverride, *, simulated: bool
    ) -> None:
        self._link = link
        self._stopping = stopping
        self._speed_override = speed_override
        self.simulated = simulated
        self.registers = Registers()
        self.variables = Variables(self._expire)
        self.io = IoBanks(simulated=simulated)
        self.modbus = Modbus()
        self.sockets = Sockets()
        self.serial_ports = SerialPorts()
        self.traces = Traces()

    def close_left_open(self, token: str) -> None:
        """Close the connections that a program has left open. The program is identified by its token."""
        self.sockets.close_left_open(token)
        self.serial_ports.close_left_open(token)

    def close(self) -> None:
        """Close all devices."""
        self.variables.close()
        self.modbus.remove_all()
        self.sockets.close_all()
        self.serial_ports.close_all()

    async def _expire(self, name: str, action: int) -> None:
        done = WatchdogAction(action)
        reason = StopReason(f"stopped by the watchdog {name}", "watchdog")
        text = f"watchdog {name}: not written in time; action: {done.name.lower()}"
        self.traces.add("alarm", text, Level.ERROR if action else Level.WARNING)
        try:
            match done:
                case WatchdogAction.PAUSE:
                    await self._speed_override.pause()
                case WatchdogAction.STOP:
                    await self._stopping.stop(STOP_TIMEOUT_S, reason)
                case WatchdogAction.PROTECTIVE_STOP:
                    self._link.request_estop()
                    await self._stopping.stop(STOP_TIMEOUT_S, reason)
        except CobotError as exc:  # a motion that cannot pause must stop
            self.traces.add("alarm", f"watchdog {name}: {exc}; the arm is stopped", Level.ERROR)
            await self._stopping.stop(STOP_TIMEOUT_S, reason)
