"""Somebody else's backend may raise anything and give anything: a fault in words, and rtloop goes on."""

from __future__ import annotations

import itertools
import logging
from dataclasses import replace

import numpy as np
import pytest
from cobot_run import unique_name
from paced_arm import PacedArm
from rig import CAPACITY, Rig

from cobot.config import Settings
from cobot.ipc.device_record import device_of
from cobot.ipc.layout import Command
from cobot.ipc.shm import RobotMemory
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.robot.device import DeviceStatus
from cobot.robot.io_points import IoKind, IoPoint
from cobot.types import Array, JointLimits, LoopMode, PlannerName, Scaling
from rtloop import device
from rtloop.backends import BackendError, Measured, guarded

UNPLUGGED = OSError(19, "no such device")
POINT = IoPoint("Tool.Open", IoKind.BOOLEAN, True, 1.0)


class Mute(Exception):
    """Its text is an exception that nothing should survive."""

    def __str__(self) -> str:
        raise SystemExit(3)


class MuteReason(BackendError):
    def __str__(self) -> str:
        raise KeyboardInterrupt


class Numeric(Exception):
    def __str__(self) -> str:
        return 5  # type: ignore[return-value]


HOSTILE = {
    "its text raises": (Mute(), "Mute: (a Mute without a text, because its str() raises SystemExit)"),
    "its text is a number": (
        Numeric(),
        "Numeric: (a Numeric without a text, because its str() raises TypeError)",
    ),
    "it ends the process": (SystemExit(1), "SystemExit: 1"),
    "it is not an Exception": (GeneratorExit("closed"), "GeneratorExit: closed"),
    "it clears the screen": (OSError("\x1b[2J\r\nok"), r"OSError: \x1b[2J\r\nok"),
    "it has half a character": (OSError("\ud800"), r"OSError: \ud800"),
    "it is long": (OSError("x" * 10**7), "OSError: " + "x" * 2000 + "... (10000000 characters)"),
}


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
        ("wait", "no packets from the robot, which clocks the cycle: "),
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
            f"{prefix}the backend's {method}() raised OSError: {UNPLUGGED}; a backend must raise BackendError"
        )
        assert [each.exc_info is not None for each in caplog.records] == [True], "the traceback, once"
        rig.arm.raised.clear()
        assert rig.recovers()
    finally:
        rig.close()


@pytest.fixture
def own_log(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keeps hostile texts out of the reports of pytest, which cannot pass on half a character."""
    log = logging.Logger("apart")
    log.addHandler(logging.NullHandler())
    monkeypatch.setattr(guarded, "log", log)
    monkeypatch.setattr(device, "log", log)


@pytest.mark.usefixtures("own_log")
@pytest.mark.parametrize("what", HOSTILE)
@pytest.mark.parametrize("method", ["read", "write", "wait", "status", "io"])
def test_any_exception_whatever_its_text_does_is_a_fault_in_printable_words(
    settings: Settings, robot: RobotDescription, method: str, what: str
) -> None:
    raised, said = HOSTILE[what]
    rig = ForeignRig(settings, robot, ForeignArm(settings, robot.limits))
    try:
        rig.arm.raised[method] = raised
        rig.step(500)
        assert rig.mode is LoopMode.FAULT
        assert rig.reason.endswith(f"{method}() raised {said}; a backend must raise BackendError")
        assert rig.reason.isprintable()
        rig.arm.raised.clear()
        assert rig.recovers()
    finally:
        rig.close()


def test_the_own_words_of_a_backend_are_made_printable_too(
    settings: Settings, robot: RobotDescription
) -> None:
    rig = ForeignRig(settings, robot, ForeignArm(settings, robot.limits))
    try:
        mute = "(a MuteReason without a text, because its str() raises KeyboardInterrupt)"
        for raised, said in (
            (BackendError("no\x1b[31m cable"), r"no\x1b[31m cable"),
            (MuteReason(), mute),
        ):
            rig.arm.raised["read"] = raised
            rig.step(500)
            assert (rig.mode, rig.reason) == (LoopMode.FAULT, f"reading from the robot failed: {said}")
            rig.arm.raised.clear()
            assert rig.recovers()
    finally:
        rig.close()


def test_words_of_the_device_are_made_printable(settings: Settings, robot: RobotDescription) -> None:
    rig = ForeignRig(settings, robot, ForeignArm(settings, robot.limits))
    try:
        rig.arm.given["status"] = DeviceStatus(text="\x1b[2J\ud800" + "y" * 10**6, quality="a\nb")
        rig.step(500)
        status = device_of(rig.memory.device.data).status
        assert status is not None
        assert status.text.startswith(r"\x1b[2J\ud800yyy")
        assert (status.text.isprintable(), status.quality) == (True, r"a\nb")
        assert rig.mode is not LoopMode.FAULT
    finally:
        rig.close()


@pytest.mark.parametrize(
    ("method", "given", "said"),
    [
        (
            "read",
            np.zeros(9),
            r"the backend's read\(\) raised ValueError: measured.position is given the shape \(9,\), ",
        ),
        (
            "read",
            [0.3],
            r"the backend's read\(\) raised ValueError: measured.position is given the shape \(1,\)",
        ),
        ("status", None, r"the backend's status\(\) returns an unusable value: AttributeError: "),
        ("status", DeviceStatus(packets_lost=-1), r"the backend's status\(\) returns .*: OverflowError: "),
        ("status", DeviceStatus(packets_lost=10**300), r"status\(\) returns .*: OverflowError: "),
        ("status", DeviceStatus(speed_scaling=10**400), r"status\(\) returns .*: OverflowError: "),
        ("io", "abc", r"io\(\) returns .*: InputError: the inputs and outputs contain a <class .str.>"),
        ("io", itertools.repeat(POINT), r"io\(\) returns .*: there are more than 1000 inputs and outputs"),
        ("io", [replace(POINT, name="a\x1b[2J")], r"an input or output is 'a\\x1b\[2J'; it must be a string"),
        (
            "io",
            [replace(POINT, name="\ud800")],
            r"an input or output is '\\ud800'; it must be a string of 1 to",
        ),
        ("io", [replace(POINT, name="n" * 10**6)], r"output is 'n+\.\.\. \(1000000 characters\)'; it must"),
        ("io", [replace(POINT, value=10**400)], r"io\(\) returns .*: OverflowError: "),
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
