"""Somebody else's backend may raise anything and give anything: a fault in words, and rtloop goes on."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from paced_arm import PacedArm
from rig import CAPACITY, Rig
from running import unique_name

from cobot.config import Settings
from cobot.ipc.layout import Command
from cobot.ipc.shm import RobotMemory
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.robot.device import DeviceStatus
from cobot.robot.io_points import IoPoint
from cobot.types import Array, JointLimits, LoopMode, PlannerName, Scaling
from rtloop.backends import BackendError, Measured

UNPLUGGED = OSError(19, "no such device")


class ForeignArm(PacedArm):
    """Raises, in a method, what its SDK does; or gives from it what it should not.

    Attributes:
        raised, given: for each method by its name.
    """

    capabilities = replace(PacedArm.capabilities, io=True)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self.raised: dict[str, BaseException] = {}
        self.given: dict[str, object] = {}

    def _come(self, method: str) -> None:
        if method in self.raised:
            raise self.raised[method]

    def open(self, initial_position: Array) -> None:
        self._come("open")
        super().open(initial_position)

    def enable(self) -> None:
        self._come("enable")

    def wait(self, timeout_s: float) -> bool:
        self._come("wait")
        return super().wait(timeout_s)

    def read(self, measured: Measured) -> None:
        self._come("read")
        super().read(measured)
        if "read" in self.given:
            measured.position = self.given["read"]

    def write(self, command: Array) -> None:
        self._come("write")
        super().write(command)

    def status(self) -> DeviceStatus:
        self._come("status")
        return self.given.get("status", super().status())  # type: ignore[return-value]

    def io(self) -> list[IoPoint]:
        self._come("io")
        return self.given.get("io", [])  # type: ignore[return-value]

    def set_output(self, name: str, value: float) -> None:
        """There is none."""


class ForeignRig(Rig):
    """Its arm moves, cycle by cycle with the arm's beats."""

    def __init__(self, settings: Settings, robot: RobotDescription, arm: ForeignArm) -> None:
        self.arm = arm
        super().__init__(settings, robot, backend=arm)
        goal = self.home + 0.3
        request = MotionRequest(self.home, goal, PlannerName.PTP, Scaling(1.0))
        assert self.start(plan_ptp(robot, request, goal)) == ""
        self.step(300)
        assert self.loop.controller.moving

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            self.loop.beat()
            super().step()

    def recovers(self) -> bool:
        self.run()
        self.step(300)
        return self.answer(self.send(Command.RESET)) == "" and self.mode is LoopMode.HOLD


@pytest.mark.parametrize(
    ("method", "prefix"),
    [
        ("read", "reading from the robot failed: "),
        ("write", "writing to the robot failed: "),
        ("wait", "the robot gives no beat: "),
        ("status", ""),
        ("io", ""),
    ],
)
def test_what_an_sdk_raises_is_a_fault_in_words(
    settings: Settings, robot: RobotDescription, caplog: pytest.LogCaptureFixture, method: str, prefix: str
) -> None:
    rig = ForeignRig(settings, robot, ForeignArm(settings, robot.limits))
    try:
        rig.arm.raised[method] = UNPLUGGED
        with caplog.at_level(logging.ERROR, "cobot.rtloop"):
            rig.step(500)
        assert rig.mode is LoopMode.FAULT
        assert rig.reason == (
            f"{prefix}the backend's {method}() raised OSError: {UNPLUGGED}; "
            "a backend reports with BackendError"
        )
        assert [each.exc_info is not None for each in caplog.records] == [True], "the traceback, once"
        rig.arm.raised.clear()
        assert rig.recovers()
    finally:
        rig.close()


@pytest.mark.parametrize(
    ("method", "given", "said"),
    [
        (
            "read",
            np.zeros(9),
            r"the backend's read\(\) raised ValueError: measured.position is given the shape \(9,\), it has",
        ),
        (
            "read",
            [0.3],
            r"the backend's read\(\) raised ValueError: measured.position is given the shape \(1,\)",
        ),
        ("status", None, r"the backend's status\(\) gives what cannot be told: AttributeError: "),
        ("status", DeviceStatus(packets_lost=-1), r"the backend's status\(\) gives .*: OverflowError: "),
        ("io", "abc", r"the backend's io\(\) gives what cannot be told: AttributeError: 'str' object"),
    ],
)
def test_what_nobody_can_take_is_one_too(
    settings: Settings, robot: RobotDescription, method: str, given: object, said: str
) -> None:
    rig = ForeignRig(settings, robot, ForeignArm(settings, robot.limits))
    try:
        rig.arm.given[method] = given
        rig.step(500)
        assert rig.mode is LoopMode.FAULT
        with pytest.raises(BackendError, match=said):
            raise BackendError(rig.reason)
        rig.arm.given.clear()
        assert rig.recovers()
    finally:
        rig.close()


@pytest.mark.parametrize("method", ["open", "enable", "read", "status", "io"])
def test_at_the_start_it_is_a_sentence(settings: Settings, robot: RobotDescription, method: str) -> None:
    arm = ForeignArm(settings, robot.limits)
    arm.raised[method] = KeyError("joint8")
    memory = RobotMemory.create(unique_name(), robot.limits.dof, settings.rt.period_s, CAPACITY)
    try:
        with pytest.raises(BackendError, match=rf"the backend's {method}\(\) raised KeyError: 'joint8'; a "):
            Rig(settings, robot, backend=arm, memory=memory)
    finally:
        memory.unlink()
        memory.close()


def test_who_ends_the_process_does(settings: Settings, robot: RobotDescription) -> None:
    rig = ForeignRig(settings, robot, ForeignArm(settings, robot.limits))
    try:
        rig.arm.raised["read"] = KeyboardInterrupt()
        with pytest.raises(KeyboardInterrupt):
            rig.step()
    finally:
        rig.close()
