"""The backend against a simulated controller, a period at a time.

Oracles: the answers as the standard library reads them, and sums of their decimal numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from lockstep_rsi import MICRO, Driven, rsi_settings

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.description import RobotDescription
from rtloop.backends import BackendError, Paced, Reporting, Stepwise
from rtloop.backends.registry import make_backend
from rtloop.backends.rsi.simulator.options import ControllerOptions
from rtloop.backends.rsi.telegrams import RobState, decode_rob, encode_rob

DEGREES = 180.0 / np.pi
RELATIVE = ControllerOptions(relative=True, hold_on=False, in_a_row=True)
Make = Callable[..., Driven]


@pytest.fixture
def make(settings: Settings, robot: RobotDescription) -> Make:
    def made(*options: Any, **ours: Any) -> Driven:
        return Driven(settings, robot, *options, **ours)

    return made


@pytest.mark.parametrize("period_ms", [4, 12])
@pytest.mark.parametrize("relative", [False, True])
def test_the_arm_follows(make: Make, period_ms: int, relative: bool) -> None:
    cell = ControllerOptions(period_ms=period_ms, relative=relative, hold_on=not relative)
    driven = make(cell, correction="relative" if relative else "absolute").enabled()
    assert isinstance(driven.backend, Paced)
    assert isinstance(driven.backend, Reporting)
    assert isinstance(driven.backend, Stepwise)
    start = driven.measured.position.copy()
    driven.swing(1600 // period_ms)
    assert not driven.problems
    assert np.abs(driven.measured.position - start).min() > 0.3
    np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-3)
    assert driven.backend.status().packets_lost == 0
    assert driven.controller.counters.late == 0


def test_the_first_correction_is_zero_and_each_answer_repeats_its_time_stamp(make: Make) -> None:
    driven = make().enabled()
    assert all(not any(values) for values in driven.corrections())
    first = driven.controller.ipoc
    driven.run(50)
    stamps = [int(answer.findtext("IPOC", "")) for answer in driven.answers[-50:]]
    assert stamps == list(range(first + 4, first + 204, 4))
    assert {answer.attrib["Type"] for answer in driven.answers} == {"cobot"}


@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_the_sum_of_relative_corrections_is_the_command(make: Make, loss: float) -> None:
    """Without loss the sums of what was sent agree to the last decimal, with loss the controller's own."""
    driven = make(RELATIVE, correction="relative").enabled()
    reference = driven.controller.arm.setpoint.copy()
    driven.run(300)  # the transition from the measured position to the commanded one
    driven.network.loss = loss
    amplitude = np.array([0.31, -0.17, 0.23, 0.11, -0.29, -0.13, 0.19])
    for rate in (1.3, 2.1, 1.7):
        driven.swing(round(np.pi / rate / driven.period_s), amplitude, rate)
    driven.network.loss = 0.0
    driven.run(400)
    assert not driven.problems
    wanted = (driven.command[0] - reference) * DEGREES
    if not loss:
        sums = [sum(column, Decimal(0)) for column in zip(*driven.corrections(), strict=True)]
        assert sums == [Decimal(value).quantize(MICRO) for value in wanted]
    np.testing.assert_allclose(driven.controller.correction * DEGREES, wanted, atol=2e-6)
    assert (driven.controller.counters.late > 50) == (loss > 0.0)


def test_absolute_corrections_are_the_command(make: Make) -> None:
    driven = make().enabled()
    reference = driven.controller.arm.setpoint.copy()
    driven.run(300)
    driven.swing(333)
    last = driven.corrections()[-1]
    assert last == [Decimal(value).quantize(MICRO) for value in (driven.command[0] - reference) * DEGREES]


def test_the_largest_correction_is_named_and_never_exceeded(make: Make) -> None:
    driven = make(max_correction=5.0).enabled()
    driven.swing(400, np.array([0.2, 0, 0, 0, 0, 0, 0]), 1.0)
    (problem,) = driven.problems
    assert "A1 is " in problem
    assert "allowed: 5 degrees (robot.backend.max_correction" in problem
    largest = max(abs(values[0]) for values in driven.corrections())
    assert Decimal("4.9") < largest <= Decimal(5)
    assert driven.controller.is_on, list(driven.controller.events)


def test_each_axis_has_its_own_largest_correction(make: Make) -> None:
    driven = make(max_correction=[5.0, 90.0, 90.0, 90.0, 90.0, 90.0, 90.0]).enabled()
    driven.swing(200, np.array([0.0, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2]))
    assert not driven.problems


def test_a_controller_that_adds_up_absolute_corrections_is_stopped_at_once(make: Make) -> None:
    """Its context reports no mode, so only the motion shows it."""
    cell = ControllerOptions(relative=True, reports=False, in_a_row=True)
    driven = make(cell).enabled()
    start = driven.controller.arm.setpoint.copy()
    driven.swing(150, 0.01, 1.0)
    assert "has RSI_ON(#RELATIVE), and robot.backend.correction is absolute" in driven.problems[0]
    stopped = driven.controller.arm.setpoint.copy()
    assert np.abs(stopped - start).max() < 0.1
    driven.run(50)
    np.testing.assert_array_equal(driven.controller.arm.setpoint, stopped)
    assert not any(driven.corrections()[-1])
    driven.backend.recover_step()
    with pytest.raises(BackendError, match="start its program again"):
        driven.until(driven.backend.enable_step)


def test_a_controller_that_takes_relative_corrections_as_absolute_does_not_move(make: Make) -> None:
    driven = make(ControllerOptions(reports=False), correction="relative").enabled()
    start = driven.controller.arm.setpoint.copy()
    driven.swing(200)
    assert "off the path of its corrections" in driven.problems[0]
    assert np.abs(driven.controller.arm.setpoint - start).max() < 0.01


@pytest.mark.parametrize(
    ("cell", "ours", "theirs", "reason"),
    [
        (
            RELATIVE,
            {},
            None,
            ("says that its corrections are relative, but robot.backend.correction is absolute"),
        ),
        (ControllerOptions(), {"sen_type": "ImFree"}, {}, "RSI has ended"),
        (ControllerOptions(), {"axis_tag": "AKorr"}, {}, "RSI has ended"),
    ],
)
def test_settings_that_differ_from_the_controllers_are_named(
    make: Make, cell: ControllerOptions, ours: dict[str, Any], theirs: dict[str, Any] | None, reason: str
) -> None:
    driven = make(cell, theirs, **ours)
    if theirs is None:
        with pytest.raises(BackendError, match=reason):
            driven.opened()
        return
    driven.opened()
    driven.run(100)
    assert driven.controller.counters.malformed > 50
    assert driven.controller.counters.answered == 0
    assert "an answer is rejected: " in driven.controller.events[-1]


def test_another_period_is_named_with_both_values(settings: Settings, robot: RobotDescription) -> None:
    driven = Driven(settings, robot, ControllerOptions(period_ms=12))
    other = Driven(settings, robot)
    other.channel.controller = driven.controller
    with pytest.raises(
        BackendError,
        match=r"grows by 12 ms \(#IPO\), but rt\.period_s "
        r"is 0.004 s \(#IPO_FAST\)",
    ):
        other.opened()


def spoiled(driven: Driven, monkeypatch: pytest.MonkeyPatch, change: Callable[[RobState], RobState]) -> None:
    """Have the controller report something else."""
    layout, packet = driven.controller.layout, driven.controller.packet

    def changed() -> bytes:
        state = decode_rob(packet(), layout)
        return encode_rob(layout, change(state)) if isinstance(state, RobState) else b""

    monkeypatch.setattr(driven.controller, "packet", changed)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda s: replace(s, delay=None, correction=()), "neither AxisCorrMon nor Delay"),
        (
            lambda s: replace(s, position=tuple(DEGREES * np.array(s.position))),
            (
                "the model's limits are .* another robot, robot.backend.axes has another order, or the "
                "units differ"
            ),
        ),
        (
            lambda s: replace(s, position=tuple(np.array(s.position) / DEGREES)),
            "the device reports its flange at",
        ),
        (lambda s: replace(s, position=s.position[::-1]), "the device reports its flange at|limits"),
    ],
)
def test_a_telegram_of_another_arm_is_rejected_at_the_start(
    make: Make,
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[RobState], RobState],
    reason: str,
) -> None:
    driven = make()
    spoiled(driven, monkeypatch, change)
    with pytest.raises(BackendError, match=reason):
        driven.opened()
    assert not any(map(any, driven.corrections()))


def test_a_session_that_ends_is_named_and_the_next_one_needs_a_reset(make: Make) -> None:
    driven = make().enabled()
    driven.swing(100)
    driven.controller.switch_off("the enabling switch was released")
    driven.until(lambda: driven.problems)
    assert "RSI has ended (enabling switch released, emergency stop" in driven.problems[0]
    driven.until(lambda: driven.controller.is_on)
    driven.command[0] += 0.5  # nothing of it may be sent
    driven.problems.clear()
    driven.channel.answers.clear()
    driven.run(50)
    assert not any(map(any, driven.corrections()))
    assert "has started RSI again" in driven.problems[-1] or "silent" in driven.problems[-1]
    driven.reset().swing(100)
    assert not driven.problems
    assert driven.controller.counters.sessions == 2


def test_each_cycle_after_an_ended_session_reports_that_the_arm_does_not_follow(make: Make) -> None:
    """Also the cycles of lost packets, which have no answer. Otherwise rtloop waits for measured values that
    change, and rejects each reset of an arm that rests.
    """
    driven = make(silence_s=5.0).enabled()
    driven.swing(100)
    driven.controller.switch_off("11 answers were late")
    driven.until(lambda: driven.controller.is_on)
    driven.until(lambda: driven.problems and "RSI again" in driven.problems[-1])
    driven.problems.clear()
    driven.network.drop = 10
    driven.run(12)
    assert driven.backend.status().packets_lost >= 10
    assert len(driven.problems) == 12
    assert all("has started RSI again" in each for each in driven.problems)


def test_a_session_that_was_started_again_unseen_is_noticed(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A context that reports Delay alone: its count begins again."""
    driven = make(ControllerOptions(reports=False, in_a_row=True), silence_s=5.0).enabled()
    driven.swing(100)
    driven.channel.off = True
    driven.until(lambda: driven.controller.counters.sessions == 2)
    driven.channel.off = False
    driven.channel.answers.clear()
    driven.run(50)
    assert "has started RSI again" in driven.problems[-1]
    assert not any(map(any, driven.corrections()))


def test_a_backend_that_takes_over_a_running_session_keeps_its_correction(
    make: Make, settings: Settings, robot: RobotDescription
) -> None:
    driven = make().enabled()
    driven.swing(393)  # to the other end of the swing
    last, there = driven.corrections()[-1], driven.controller.arm.setpoint.copy()
    again = make()
    again.channel, again.controller = driven.channel, driven.controller
    again.backend._channel, again.backend._clock = driven.channel, driven.channel.clock
    driven.channel.answers.clear()
    again.enabled().run(100)
    assert again.corrections()[0] == last
    np.testing.assert_allclose(driven.controller.arm.setpoint, there, atol=0.02)
    assert driven.controller.counters.sessions == 1


def test_a_session_whose_correction_is_not_reported_is_not_taken_over(make: Make) -> None:
    """Its first answer would be zero, and the arm would jump back."""
    driven = make(ControllerOptions(reports=False, in_a_row=True, timeout=1000)).enabled()
    driven.swing(393)
    for _ in range(5):
        driven.controller.packet()  # nobody answers while rtloop is started again
    again = make()
    again.backend._channel, again.backend._clock = driven.channel, driven.channel.clock
    driven.channel.answers.clear()
    with pytest.raises(BackendError, match="the current correction is not known: start the program again"):
        again.backend.open(np.zeros(7))


def test_packets_that_come_twice_or_too_late_are_not_answered(make: Make) -> None:
    driven = make().enabled()
    layout = driven.controller.layout
    old = encode_rob(layout, RobState(driven.controller.ipoc - 8, (0.0,) * 7, delay=0))
    sent = len(driven.channel.answers)
    driven.channel.injected.append(old)
    driven.run(10)
    assert len(driven.channel.answers) == sent + 10
    assert driven.controller.counters.wrong_ipoc == 0
    assert not driven.problems


def test_a_rejected_packet_moves_nothing_and_is_reported(make: Make) -> None:
    driven = make().enabled()
    driven.channel.injected += [b"<Rob", b"<Rob Type='KUKA'><AIPos A1='nan'/><IPOC>1</IPOC></Rob>"]
    there = driven.controller.arm.setpoint.copy()
    driven.run(20)
    assert not driven.problems
    np.testing.assert_allclose(driven.controller.arm.setpoint, there, atol=1e-3)
    assert (
        "2 packets were rejected, the last one for this reason: AIPos.A1 is 'nan'"
        in driven.backend.status().text
    )


def test_the_status_says_how_the_controller_is(make: Make) -> None:
    driven = make(ControllerOptions(operation_mode="T1", override=40)).enabled()
    status = driven.backend.status()
    assert (status.connection, status.operation_mode, status.drives) == ("RSI is on", "T1", "on")
    assert status.speed_scaling == pytest.approx(0.4 * driven.backend._reduced.share)
    assert driven.backend._reduced.share < 0.2
    assert "program override 40 %" in status.text
    driven.controller.starts_again = False
    driven.controller.switch_off("x")
    driven.run(30)
    assert driven.backend.status().connection == "SILENT"


def test_automatic_external_is_an_automatic_mode(make: Make) -> None:
    status = make(ControllerOptions(operation_mode="EXT")).enabled().backend.status()
    assert (status.operation_mode, status.speed_scaling) == ("AUT", 1.0)
    assert "the operation mode is EXT" in status.text


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"is_stopped": True}, r"\$ALARM_STOP"),
        (
            {"is_ready": False},
            r"the drives are off \(\$PERI_RDY\); the operation mode is T1: press the enabling",
        ),
    ],
)
def test_a_controller_that_goes_on_sending_while_it_is_stopped_is_not_commanded(
    make: Make, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], reason: str
) -> None:
    driven = make(ControllerOptions(operation_mode="T1"), enable_s=0.2).enabled()
    driven.swing(50)
    spoiled(driven, monkeypatch, lambda state: replace(state, **change))
    driven.cycle()
    held = driven.corrections()[-1]
    driven.command[0] += 0.1
    driven.run(20)
    assert driven.corrections()[-1] == held
    driven.backend.recover_step()
    with pytest.raises(BackendError, match=reason):
        driven.until(driven.backend.enable_step)


def test_inputs_and_outputs(make: Make) -> None:
    driven = make(inputs={"part": 1}, outputs={"open": 7, "close": 8}).enabled()
    driven.controller.outputs[1] = True  # by the controller's own program, before the first answer was sent
    driven.run(3)
    driven.backend.set_output("open", 1.0)
    driven.controller.inputs[0] = True
    driven.run(3)
    assert {point.name: (point.value, point.is_output) for point in driven.backend.io()} == {
        "part": (1.0, False),
        "open": (1.0, True),
        "close": (1.0, True),
    }
    with pytest.raises(BackendError, match=r"lamp is not one of the outputs in robot.backend.outputs"):
        driven.backend.set_output("lamp", 1.0)
    driven.controller.switch_off("x")
    driven.until(lambda: driven.problems)
    with pytest.raises(BackendError, match="close cannot be set: no packet from the robot controller"):
        driven.backend.set_output("close", 0.0)


def test_external_axes_may_be_any_joints(make: Make) -> None:
    driven = make(axes=["E1", "A1", "A2", "A3", "A4", "A5", "A6"], check_pose=False).enabled()
    driven.run(300)
    amplitude = np.array([0.2, 0, 0, 0, 0, 0, 0])
    driven.swing(100, amplitude)
    *robot, external = driven.corrections()[-1]
    assert abs(external) > 1
    assert max(map(abs, robot)) < Decimal("0.1")


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"axes": ["A1", "A2"]}, "robot.backend.axes has 2 axes, but the model has 7 joints"),
        ({"axes": ["A1", "A1", "A2", "A3", "A4", "A5", "A6"]}, "A1 is listed twice"),
        ({"max_correction": [5.0]}, "robot.backend.max_correction has 1 values, but the model has 7 joints"),
        ({"max_correction": 0.0}, "max_correction"),
        ({"axis_tag": "A K"}, "axis_tag"),
        ({"sen_type": '"><x'}, "sen_type"),
        ({"outputs": {"a/b": 1}}, "outputs"),
        ({"outputs": {"x": 1}, "inputs": {"x": 1}}, "'x' is the name of both an input and an output"),
        ({"axis_tag": "K", "external_tag": "K"}, "axis_tag and external_tag are both 'K'"),
        ({"correction": "both"}, "correction"),
        ({"address": "robot"}, "is not an IPv4 address"),
    ],
)
def test_wrong_options_are_named(
    settings: Settings, robot: RobotDescription, options: dict[str, Any], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        make_backend(rsi_settings(settings, **options), robot.limits)
