"""A simulated FANUC controller and the backend in one process, as the tests ask for them."""

from __future__ import annotations

import numpy as np

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends import Measured
from rtloop.backends.fanuc import FanucBackend
from rtloop.backends.fanuc.simulator.controller import FanucController
from rtloop.backends.fanuc.simulator.lockstep import FanucLockStep
from rtloop.backends.fanuc.simulator.network import FanucNetwork
from rtloop.backends.fanuc.simulator.options import FanucControllerOptions
from rtloop.backends.simulators.arm import ControllerArm

BENT = np.radians([10.0, 25.0, -30.0, 5.0, -40.0, 15.0])
ENOUGH = 2000
"""Cycles in which everything that a test waits for has happened."""


def made_controller(
    settings: Settings, robot: RobotDescription, options: FanucControllerOptions, position: Array = BENT
) -> FanucController:
    return FanucController(ControllerArm(settings, robot.limits, position), options)


class Driven:
    """A backend and its controller, driven as rtloop does it."""

    def __init__(
        self,
        settings: Settings,
        robot: RobotDescription,
        options: FanucControllerOptions | None = None,
        position: Array = BENT,
    ) -> None:
        period_ms = round(1e3 * settings.rt.period_s)
        self.controller = made_controller(
            settings, robot, options or FanucControllerOptions(period_ms=period_ms), position
        )
        self.channel = FanucLockStep(self.controller, FanucNetwork())
        self.backend = FanucBackend(
            settings,
            robot.limits,
            channel=self.channel,
            rmi=self.channel.client(),
            clock=self.channel.clock,
            sleep=self.channel.sleep,
        )
        self.measured = Measured(robot.limits.dof)
        self.command = np.zeros((3, robot.limits.dof))

    def open(self) -> Driven:
        self.backend.open(np.zeros(len(self.command[0])))
        return self

    def cycle(self) -> None:
        self.backend.wait(0.25)
        self.backend.read(self.measured)
        self.backend.write(self.command)

    def cycles(self, number: int) -> None:
        for _ in range(number):
            self.cycle()

    def listen(self, cycles: int) -> None:
        """Without commands."""
        for _ in range(cycles):
            self.backend.wait(0.05)
            self.backend.read(self.measured)

    def enable(self) -> Driven:
        """As after a reset; the command is then where the arm is measured."""
        while not self.backend.recover_step():
            self.backend.wait(0.05)
        for _ in range(ENOUGH):
            self.backend.wait(0.25)
            if self.backend.enable_step():
                break
        else:
            raise AssertionError(f"is not enabled: {self.backend.status()}")
        self.command[:] = 0.0
        self.backend.read(self.measured)
        self.command[0] = self.measured.position
        return self

    def move(self, joint: int, turn_rad: float, cycles: int = 250) -> None:
        """A joint, smoothly."""
        start = self.command[0].copy()
        for cycle in range(1, cycles + 1):
            share = cycle / cycles
            smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            self.command[0] = start
            self.command[0, joint] += turn_rad * smooth
            self.command[1, joint] = 1e-6
            self.cycle()
        self.command[1] = 0.0
        self.cycle()  # the arm takes the last one
