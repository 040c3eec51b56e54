"""A simulated controller with RSI and the backend in one process, driven as rtloop does it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends import BackendError, Measured
from rtloop.backends.rsi import RsiBackend
from rtloop.backends.rsi.simulator.controller import RsiController
from rtloop.backends.rsi.simulator.lockstep import controller_for, with_options
from rtloop.backends.rsi.simulator.network import RsiNetwork
from rtloop.backends.rsi.simulator.options import ControllerOptions
from rtloop.backends.simulators.lockstep import LockStep

WAIT_S = 0.05
ENOUGH = 1000
"""Periods in which everything that a test waits for has happened."""
MICRO = Decimal("0.000001")


def rsi_settings(settings: Settings, period_ms: int = 4, **options: Any) -> Settings:
    """The shipped iiwa as A1 to A6 and E1, with corrections as far as its joints go."""
    own = with_options(settings, **{"max_correction": 170.0, **options})
    return own.model_copy(update={"rt": own.rt.model_copy(update={"period_s": period_ms * 1e-3})})


class Driven:
    """The backend, not open yet, and its controller."""

    def __init__(
        self,
        settings: Settings,
        robot: RobotDescription,
        options: ControllerOptions | None = None,
        theirs: dict[str, Any] | None = None,
        **ours: Any,
    ) -> None:
        """
        Args:
            theirs: options of the backend that the controller's files were written for, if they differ.
            ours: options of the backend.
        """
        options = options or ControllerOptions(in_a_row=True)
        own = rsi_settings(settings, options.period_ms, **ours)
        start = np.array(robot.positions[settings.robot.start_position].joints)
        made_for = rsi_settings(settings, options.period_ms, **(ours if theirs is None else theirs))
        self.controller: RsiController = controller_for(made_for, robot.limits, options, start)
        self.network = RsiNetwork(self.controller.layout)
        self.channel: LockStep[RsiController] = LockStep(self.controller, self.network)
        self.backend = RsiBackend(own, robot.limits, channel=self.channel, clock=self.channel.clock)
        self.period_s = options.period_ms * 1e-3
        self.measured = Measured(robot.limits.dof)
        self.command = np.zeros((3, robot.limits.dof))
        self.problems: list[str] = []

    def opened(self) -> Driven:
        self.backend.open(self.command[0])
        self.backend.read(self.measured)
        return self

    def enabled(self) -> Driven:
        """Open and, as after a reset, commanded to be where it is."""
        self.opened()
        self.backend.enable()
        return self.reset()

    def reset(self) -> Driven:
        self.backend.recover_step()
        self.until(self.backend.enable_step)
        self.problems.clear()
        self.command[:] = 0.0
        self.command[0] = self.measured.position
        return self

    def cycle(self) -> bool:
        """Whether there was a packet."""
        beat = self.backend.wait(WAIT_S)
        try:
            self.backend.read(self.measured)
            if beat:
                self.backend.write(self.command)
        except BackendError as exc:
            self.problems.append(str(exc))
        return beat

    def run(self, cycles: int) -> None:
        for _ in range(cycles):
            self.cycle()

    def until(self, happened: Callable[[], object]) -> None:
        for _ in range(ENOUGH):
            if happened():
                return
            self.cycle()
        raise AssertionError(f"did not happen; {list(self.controller.events)}, {self.problems[-3:]}")

    def swing(self, cycles: int, amplitude: Array | float = 0.2, rate: float = 2.0) -> None:
        """All joints to and fro from where they are, smoothly: position, velocity and acceleration agree."""
        start = self.command[0].copy()
        for cycle in range(1, cycles + 1):
            time_s = cycle * self.period_s
            self.command[0] = start + amplitude * (1.0 - np.cos(rate * time_s))
            self.command[1] = amplitude * rate * np.sin(rate * time_s)
            self.cycle()
        self.command[1] = 0.0

    @property
    def answers(self) -> list[ET.Element]:
        """What was sent, as the standard library reads it."""
        return [ET.fromstring(packet) for packet in self.channel.answers]

    def corrections(self) -> list[list[Decimal]]:
        """Of each answer, A1 to A6 and then E1, degrees."""
        found = []
        for answer in self.answers:
            robot, external = answer.find("AK"), answer.find("EK")
            assert robot is not None
            values = [Decimal(robot.attrib[f"A{number}"]) for number in range(1, 7)]
            found.append(values + ([Decimal(external.attrib["E1"])] if external is not None else []))
        return found
