"""The thread of a gripper's driver. Oracle: a driver that reads an input of a robot that reports it late."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

from app.services.devices.gripper_worker import GripperWorker, Reading, RobotPort
from cobot.clock import SYSTEM
from cobot.grippers import GripperState
from cobot.robot.io_points import IoKind, IoPoint

SILENT = 5
"""So many times the robot has not reported yet."""


class Link:
    """A robot that reports its input late."""

    clock, label = SYSTEM, ""

    def __init__(self) -> None:
        self.asked = 0

    def io(self) -> Any:
        self.asked += 1
        points = [IoPoint("jaw", IoKind.ANALOG, False, 0.03)]
        return None if self.asked <= SILENT else SimpleNamespace(points=points)


class Driver:
    """Its width is an input of the robot."""

    def __init__(self, port: RobotPort) -> None:
        self.port = port
        self.commands = 0

    def connect(self) -> None:
        self.port.read("jaw")

    def disconnect(self) -> None: ...

    def open(self) -> None:
        self.commands += 1

    def state(self) -> GripperState:
        return GripperState(self.port.read("jaw"), None, moving=False)


def test_a_driver_waits_for_the_first_report_of_the_robot_instead_of_failing() -> None:
    readings: list[Reading] = []

    async def work() -> Driver:
        port = RobotPort()
        driver = Driver(port)
        worker = GripperWorker(driver, port, Link(), readings.append)  # type: ignore[arg-type]
        try:
            await worker.command(lambda gripper: gripper.open())
            while not readings:
                await asyncio.sleep(0.0)
        finally:
            worker.close()
        return driver

    driver = asyncio.run(asyncio.wait_for(work(), 60.0))
    assert driver.commands == 1
    assert (readings[0].problem, readings[0].state) == ("", GripperState(0.03, None, moving=False))
