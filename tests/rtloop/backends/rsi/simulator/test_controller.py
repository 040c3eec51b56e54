"""The simulated controller alone, with answers written by hand."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from lockstep_rsi import Driven

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends.rsi.simulator.controller import RsiController
from rtloop.backends.rsi.simulator.options import ControllerOptions

Make = Callable[..., RsiController]
ZEROS = {f"A{number}": 0.0 for number in range(1, 7)}


@pytest.fixture
def make(settings: Settings, robot: RobotDescription) -> Make:
    def made(max_correction: float = 5.0, **options: Any) -> RsiController:
        driven = Driven(settings, robot, ControllerOptions(**options), max_correction=max_correction)
        controller = driven.controller
        for _ in range(200):
            if controller.packet():
                break
        return controller

    return made


def answer(ipoc: int, kind: str = "cobot", e1: float = 0.0, **axes: float) -> bytes:
    """Corrections in degrees."""
    words = " ".join(f'{axis}="{value}"' for axis, value in {**ZEROS, **axes}.items())
    return f'<Sen Type="{kind}"><AK {words}/><EK E1="{e1}"/><IPOC>{ipoc}</IPOC></Sen>'.encode()


def stepped(controller: RsiController, **axes: Any) -> ET.Element:
    """A period with this answer; the telegram of the next one."""
    controller.answer(answer(controller.ipoc, **axes))
    return ET.fromstring(controller.packet())


@pytest.mark.parametrize("period_ms", [4, 12])
def test_it_owns_the_time_stamp(make: Make, period_ms: int) -> None:
    controller = make(period_ms=period_ms)
    stamps = [int(stepped(controller).findtext("IPOC", "")) for _ in range(5)]
    assert list(np.diff(stamps)) == [period_ms] * 4


def test_absolute_corrections_are_from_where_it_was_switched_on(make: Make) -> None:
    controller = make()
    before = ET.fromstring(controller.packet()).find("ASPos")
    assert before is not None
    for _ in range(3):
        after = stepped(controller, A2=0.01, e1=-0.02)
    robot, external = after.find("ASPos"), after.find("ESPos")
    assert robot is not None
    assert external is not None
    assert float(robot.attrib["A2"]) == pytest.approx(float(before.attrib["A2"]) + 0.01, abs=1e-5)
    np.testing.assert_allclose(controller.correction[[1, 6]], np.radians([0.01, -0.02]))


def test_relative_corrections_are_added_up(make: Make) -> None:
    controller = make(relative=True, hold_on=False)
    for _ in range(5):
        stepped(controller, A1=0.01)
    assert np.degrees(controller.correction[0]) == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("relative", "hold_on", "degrees"),
    [(False, True, 0.01), (False, False, 0.0), (True, True, 0.03), (True, False, 0.01)],
)
def test_a_missing_answer_is_what_hold_on_makes_of_it(
    make: Make, relative: bool, hold_on: bool, degrees: float
) -> None:
    controller = make(relative=relative, hold_on=hold_on)
    stepped(controller, A1=0.01)
    for _ in range(2):
        telegram = ET.fromstring(controller.packet())
    assert np.degrees(controller.correction[0]) == pytest.approx(degrees)
    delay = telegram.find("Delay")
    assert delay is not None
    assert delay.attrib == {"D": "2"}


@pytest.mark.parametrize(("in_a_row", "late"), [(False, 11), (True, 21)])
def test_late_answers_end_it_beyond_the_budget(make: Make, in_a_row: bool, late: int) -> None:
    """Every other answer is missing, then all are."""
    controller = make(in_a_row=in_a_row, timeout=10)
    for _ in range(11):
        controller.answer(answer(controller.ipoc))
        controller.packet()
        controller.packet()
    controller.starts_again = False
    for _ in range(20):
        controller.packet()
    assert not controller.is_on
    assert controller.counters.late == late
    assert "answers were late, allowed: 10 (Timeout)" in controller.events[-1]


@pytest.mark.parametrize(
    ("packet", "reason"),
    [
        (lambda ipoc: answer(ipoc, kind="ImFree"), "the Type 'ImFree'; it must be cobot"),
        (lambda ipoc: answer(ipoc).replace(b"A3", b"A9"), "AK has no attribute A3"),
        (lambda ipoc: answer(ipoc).replace(b'A3="0.0"', b'A3="nan"'), "AK.A3 is 'nan'"),
        (lambda ipoc: b"<Sen", "not XML"),
    ],
)
def test_an_answer_that_is_none_is_named(make: Make, packet: Callable[[int], bytes], reason: str) -> None:
    controller = make()
    controller.answer(packet(controller.ipoc))
    assert reason in controller.events[-1]
    assert controller.counters.malformed == 1
    assert controller.waits_for_answer


def test_an_answer_to_another_telegram_does_not_count(make: Make) -> None:
    controller = make()
    controller.answer(answer(controller.ipoc - 4, A1=1.0))
    assert controller.waits_for_answer
    controller.answer(answer(controller.ipoc))
    controller.answer(answer(controller.ipoc, A1=1.0))  # the second one to the same telegram
    assert controller.counters.wrong_ipoc == 2
    assert not controller.correction.any()


@pytest.mark.parametrize(
    ("axes", "reason"),
    [
        ({"A1": 5.1}, "the correction of A1 has reached its limit"),
        ({"A1": 4.0}, "joint1 is commanded to move at"),
        ({"A1": 0.1}, "the command of joint1 jumps"),
    ],
)
def test_it_ends_at_its_limits(make: Make, axes: dict[str, Any], reason: str) -> None:
    controller = make()
    stepped(controller)
    controller.answer(answer(controller.ipoc, **axes))
    assert not controller.is_on
    assert reason in controller.events[-1]


def test_its_operator_starts_the_program_again_when_nothing_prevents_it(make: Make) -> None:
    controller = make()
    controller.stop_safely(active=True)
    assert not any(controller.packet() for _ in range(200))
    controller.stop_safely(active=False)
    assert any(controller.packet() for _ in range(60))
    assert controller.delay == 0


@pytest.mark.parametrize(
    ("options", "reason"), [({"period_ms": 5}, "it must be 4"), ({"override": 101}, "0 to 100")]
)
def test_wrong_options_are_named(options: dict[str, int], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        ControllerOptions(**options)  # type: ignore[arg-type]
