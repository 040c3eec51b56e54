"""Inputs and outputs by name, a period at a time. Oracle: the values of the simulated cabinet."""

from __future__ import annotations

import numpy as np
import pytest
from lockstep_fri import LockStep, joined

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.robot.io_points import IoKind, IoPoint
from rtloop.backends import BackendError, HasIo, Measured
from rtloop.backends.fri import FriBackend
from rtloop.backends.fri.codec import decode_command
from rtloop.backends.fri.messages import CommandMessage, IoDirection, IoType, IoValue, SessionState
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.fri.simulator.options import CabinetOptions

OPEN, FORCE, BELT, SENSOR = "Tool.Open", "Tool.Force", "Belt.Speed", "Tool.Sensor"


class Cell:
    """A backend that echoes the interpolator, and its cabinet."""

    def __init__(
        self, settings: Settings, robot: RobotDescription, network: FriNetwork | None = None
    ) -> None:
        io = (
            IoValue(OPEN, IoType.BOOLEAN, IoDirection.OUTPUT),
            IoValue(FORCE, IoType.ANALOG, IoDirection.OUTPUT, 2.5),
            IoValue(BELT, IoType.DIGITAL, IoDirection.OUTPUT, 3),
            IoValue(SENSOR, IoType.DIGITAL, IoDirection.INPUT, 5),
        )
        self.backend: FriBackend
        self.channel: LockStep
        self.backend, self.channel = joined(settings, robot, CabinetOptions(io=io), network)
        self.backend.open(np.zeros(7))

    def run(self, periods: int) -> None:
        for _ in range(periods):
            if self.backend.wait(0.25):
                self.backend.read(Measured(7))
                self.backend.write(np.zeros((3, 7)))

    def values(self) -> dict[str, float]:
        """As the backend reports them."""
        return {each.name: each.value for each in self.backend.io()}

    def said(self) -> list[str]:
        """The outputs of all answers since the last call."""
        commands = [decode_command(each) for each in self.channel.answers]
        self.channel.answers.clear()
        return [io.name for each in commands if isinstance(each, CommandMessage) for io in each.io]


@pytest.fixture
def cell(settings: Settings, robot: RobotDescription) -> Cell:
    return Cell(settings, robot)


def test_they_have_the_names_kinds_and_directions_of_the_cabinets_program(cell: Cell) -> None:
    assert isinstance(cell.backend, HasIo)
    assert cell.backend.capabilities.io
    assert cell.backend.io() == [
        IoPoint(OPEN, IoKind.BOOLEAN, True, 0.0),
        IoPoint(FORCE, IoKind.ANALOG, True, 2.5),
        IoPoint(BELT, IoKind.DIGITAL, True, 3.0),
        IoPoint(SENSOR, IoKind.DIGITAL, False, 5.0),
    ]


def test_an_output_of_each_kind_is_set_and_reported_and_then_left_alone(cell: Cell) -> None:
    wanted = {OPEN: 1.0, FORCE: -0.75, BELT: 2.0**53 - 1}
    for name, value in wanted.items():
        cell.backend.set_output(name, value)
    cell.run(5)
    assert cell.values() == wanted | {SENSOR: 5.0}
    assert {name: each.value for name, each in cell.channel.controller.io.items()} == cell.values()
    cell.said()
    cell.channel.controller.io[OPEN].value = 0.0  # its own program does so
    cell.run(20)
    assert cell.said() == []
    assert cell.values()[OPEN] == 0.0


def test_an_output_is_said_until_the_controller_reports_it_whatever_is_lost(
    settings: Settings, robot: RobotDescription
) -> None:
    cell = Cell(settings, robot, FriNetwork(seed=5, loss=0.4))
    for value in (1.0, 0.0) * 4:
        cell.backend.set_output(OPEN, value)
        cell.run(60)
        assert cell.values()[OPEN] == value
    assert cell.channel.network.lost > 50


def test_the_last_word_counts_though_the_first_is_under_way(cell: Cell) -> None:
    cell.channel.network.delay = 3
    for value in (1.0, 0.0):
        cell.backend.set_output(OPEN, value)
        cell.run(1)
    cell.run(20)
    assert cell.values()[OPEN] == 0.0


def test_one_that_is_never_reported_is_given_up(cell: Cell) -> None:
    cell.run(1)
    cell.backend.set_output(OPEN, 1.0)
    del cell.channel.controller.io[OPEN]
    cell.run(250)
    assert cell.said().count(OPEN) == 200
    assert "not an output of this type" in " ".join(cell.channel.controller.events)


def test_names_that_act_on_a_terminal_or_an_address_are_made_plain(
    settings: Settings, robot: RobotDescription
) -> None:
    """And the cabinet is told its own name."""
    raw = ("a\n\x1b[31m/", "a__[31m/", "x" * 62 + "/", "x" * 62 + "\t", "größe", "")
    io = tuple(IoValue(name, IoType.ANALOG, IoDirection.OUTPUT) for name in raw)
    backend, channel = joined(settings, robot, CabinetOptions(io=io))
    backend.open(np.zeros(7))
    plain = ["a__[31m_", "a__[31m__2", "x" * 62 + "_", "x" * 61 + "_2", "größe", "_"]
    assert [each.name for each in backend.io()] == plain
    for value, name in enumerate(plain):
        backend.set_output(name, float(value))
    for _ in range(5):
        backend.wait(0.25)
        backend.write(np.zeros((3, 7)))
    assert [each.value for each in channel.controller.io.values()] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    with pytest.raises(BackendError, match="is not an output"):
        backend.set_output(raw[0], 1.0)


def test_what_cannot_be_set_is_refused_in_words(cell: Cell) -> None:
    for name in ("Tool.Shut", SENSOR):
        with pytest.raises(BackendError, match=f"{name} is not an output that the controller's program"):
            cell.backend.set_output(name, 1.0)
    cell.channel.off = True
    cell.run(30)
    with pytest.raises(BackendError, match=f"{OPEN} cannot be set: "):
        cell.backend.set_output(OPEN, 1.0)
    cell.channel.off = False
    cell.channel.controller.close_session("its program has ended")
    while cell.backend._newest.state != SessionState.IDLE:
        cell.backend.wait(0.25)
    with pytest.raises(BackendError, match=f"{OPEN} cannot be set: the controller has no FRI session"):
        cell.backend.set_output(OPEN, 1.0)
