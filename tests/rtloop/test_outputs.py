"""Outputs in the cycle: whoever writes to shared memory may write anything. Oracle: what the arm was told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from faults import spoil
from panel_arm import PanelArm
from rig import Rig

from cobot.config import Settings
from cobot.ipc.io_record import report_of
from cobot.ipc.layout import IO, IO_NAME_BYTES, IO_POINTS, Command
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.robot.description import RobotDescription
from rtloop.backends import BackendError


@pytest.fixture
def arm(settings: Settings, robot: RobotDescription) -> PanelArm:
    return PanelArm(settings, robot.limits)


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription, arm: PanelArm) -> Iterator[Rig]:
    made = Rig(settings, robot, backend=arm)
    yield made
    made.close()


def set_output(rig: Rig, name: bytes, value: float) -> str:
    record = rig.memory.output.data
    record["name"], record["value"] = name, value
    rig.memory.output.publish()
    return rig.answer(rig.send(Command.OUTPUT))


@pytest.mark.parametrize(
    ("name", "value", "refusal"),
    [
        (b"Gripper.Close", 1.0, ""),
        (b"Gripper.Close", 0.5, "is boolean: the value must be 0 or 1, got 0.5"),
        (b"Belt.Speed", 2.5, "is digital: the value must be a whole number"),
        (b"Belt.Speed", np.inf, "is digital: the value must be a whole number"),
        (b"Belt.Speed", np.nan, "is digital: the value must be a whole number"),
        (b"Gripper.Force", np.nan, "Gripper.Force: the value is not finite"),
        (b"Part.There", 1.0, "Part.There is an input"),
        (b"\xff\xfe", 1.0, "there is no output"),
        (b"", 1.0, "there is no output"),
    ],
)
def test_only_what_an_output_can_have_reaches_the_device(
    rig: Rig, arm: PanelArm, name: bytes, value: float, refusal: str
) -> None:
    before = {each.name: each.value for each in arm.io()}
    said = set_output(rig, name, value)
    assert refusal in said
    assert bool(said) == bool(refusal)
    after = {each.name: each.value for each in arm.io()}
    assert after == (before if refusal else before | {name.decode(): value})
    assert rig.loop.controller.mode.name == "HOLD"


def test_what_is_reported_is_there_from_the_first_cycle_and_mended_when_it_is_spoilt(
    rig: Rig, arm: PanelArm
) -> None:
    reader = RobotMemory.attach(rig.memory.robot, MemoryRole.READER)
    for _ in range(2):
        assert reader.io.try_read()
        assert report_of(reader.io.data).points == tuple(arm.io())
        spoil(reader, "io", np.random.default_rng(15))
        assert not reader.io.try_read()
        rig.step(250)
    reader.close()


def test_what_no_device_can_have_is_not_read() -> None:
    record = np.zeros((), IO)
    for fields in ({"count": 2**40}, {"count": 1, "kinds": 255}):
        for name, value in fields.items():
            record[name] = value
        with pytest.raises(ValueError, match="inputs and outputs with the kinds"):
            report_of(record)


def test_a_backend_without_outputs_refuses_them(settings: Settings, robot: RobotDescription) -> None:
    rig = Rig(settings, robot)
    assert set_output(rig, b"Gripper.Close", 1.0) == "the device has no outputs"
    rig.close()


def test_what_there_is_no_room_for_is_named_once_in_the_log(
    rig: Rig, arm: PanelArm, caplog: pytest.LogCaptureFixture
) -> None:
    long = "Gripper." + IO_NAME_BYTES * "x"
    arm._io[long] = replace(arm._io["Gripper.Close"], name=long)
    rig.step(1000)
    assert rig.memory.io.try_read()
    shown = [each.name for each in report_of(rig.memory.io.data).points]
    assert shown == [name for name in arm._io if name != long]
    (line,) = [each.getMessage() for each in caplog.records if long in each.getMessage()]
    assert line.endswith(f"not shown: {long}; cobot shows up to {IO_POINTS}, with names of up to 64 bytes")


class PromptArm(PanelArm):
    """Reports its inputs every 10 ms."""

    report_period_s: object = 0.01


@pytest.mark.parametrize(("kind", "reports"), [(PanelArm, 5), (PromptArm, 100)])
def test_a_backend_is_polled_at_the_interval_of_its_report_period(
    settings: Settings, robot: RobotDescription, kind: type[PanelArm], reports: int
) -> None:
    """Oracle: the number of the report in shared memory, after one second of robot time."""
    rig = Rig(settings, robot, backend=kind(settings, robot.limits))
    rig.memory.io.try_read()
    before = report_of(rig.memory.io.data).number
    rig.step(1000)
    rig.memory.io.try_read()
    assert report_of(rig.memory.io.data).number - before == reports
    rig.close()


@pytest.mark.parametrize("period_s", [0.0, 0.3, -1.0, np.nan, np.inf, "fast", None, True])
def test_a_report_period_out_of_range_is_rejected(
    settings: Settings, robot: RobotDescription, period_s: object
) -> None:
    arm = PromptArm(settings, robot.limits)
    arm.report_period_s = period_s
    with pytest.raises(BackendError, match=r"report_period_s is .*; it must be from 0.001 to 0.2 s"):
        Rig(settings, robot, backend=arm)
