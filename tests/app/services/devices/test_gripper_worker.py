"""The thread of a gripper's driver. Oracle: a driver that reads an input of a robot that reports it late."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

from app.services.devices.gripper_worker import GripperWorker, Reading, RobotPort
from cobot.clock import SYSTEM
from cobot.grippers import GripperError, GripperState
from cobot.grippers.protocol import Now
from cobot.robot.io_points import IoKind, IoPoint

SILENT = 5
"""So many times the robot has not reported yet."""


class Link:
    """A robot that reports its input late."""

    label = ""

    def __init__(self) -> None:
        self.clock: Now = SYSTEM
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
            await worker.ask(lambda gripper: gripper.open())
            while not readings:
                await asyncio.sleep(0.0)
        finally:
            worker.close()
        return driver

    driver = asyncio.run(asyncio.wait_for(work(), 60.0))
    assert driver.commands == 1
    assert (readings[0].problem, readings[0].state) == ("", GripperState(0.03, None, moving=False))


class Clock:
    """Its time is set by hand."""

    time_s = 0.0

    def now_s(self) -> float:
        return self.time_s


class Hung(Driver):
    """Its device is unplugged, and its disconnect does not return."""

    def __init__(self, port: RobotPort) -> None:
        super().__init__(port)
        self.disconnecting, self.plugged = threading.Event(), threading.Event()

    def connect(self) -> None: ...

    def disconnect(self) -> None:
        self.disconnecting.set()
        assert self.plugged.wait(60.0)

    def state(self) -> GripperState:
        raise GripperError("no answer")


def test_a_disconnect_that_does_not_return_is_reported() -> None:
    async def work() -> str:
        port, link = RobotPort(), Link()
        link.clock = clock = Clock()
        driver = Hung(port)
        worker = GripperWorker(driver, port, link, lambda _: None)  # type: ignore[arg-type]
        try:
            while not driver.disconnecting.is_set():
                await asyncio.sleep(0.0)
            clock.time_s = 20.0
            return worker.problem
        finally:
            driver.plugged.set()
            worker.close()

    problem = asyncio.run(asyncio.wait_for(work(), 60.0))
    assert problem == "the driver of the gripper has not returned for 20 s"
