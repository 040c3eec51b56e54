"""The contract of backends: those of cobot keep it, and each way of breaking it is found by its check.

Oracle: `broken_backends`, which are the toy with one thing changed.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from franka_settings import franka_settings
from thorough import few
from ur_arm import ur_settings

from cobot.config import Settings
from cobot.contract_checks import CheckVerdict
from cobot.errors import ConfigError
from rtloop.backends.rsi.simulator.lockstep import with_options
from rtloop.contract.__main__ import main
from rtloop.contract.cell import CheckedBackend
from rtloop.contract.suite import CHECKS, cell_for, examine

TOY = "rtloop.contract.toy:ToyArm"
HURRIES = "paced_arm:PacedArm"
ON_REQUEST = {"punctuality", "beat"}
UNASKED = {*ON_REQUEST, "guiding"}
"""Nor has most devices' own hand guiding."""
TRAJECTORY_TOY = "rtloop.contract.toy_trajectory:ToyArm"
UNTOLD = {
    "guiding",
    "status",
    "io",
    "punctuality",
    "beat",
    "staleness",
    "loss",
    "reorder",
    "pile_up",
    "operation_mode",
} | {check for check in CHECKS if "_stop" in check}
"""What a simulation without packets, emergency stop and key cannot be tested for."""


@pytest.fixture(scope="module")
def mujoco(settings: Settings) -> CheckedBackend:
    return cell_for(settings, "mujoco")


@pytest.fixture(scope="module")
def fri(settings: Settings) -> CheckedBackend:
    """Every 5 ms: a fifth of the cycles."""
    rt = settings.rt.model_copy(update={"period_s": 0.005})
    return cell_for(settings.model_copy(update={"rt": rt}), "fri")


@pytest.fixture(scope="module", params=[(0.004, "absolute"), (0.012, "relative")])
def rsi(settings: Settings, request: pytest.FixtureRequest) -> CheckedBackend:
    period_s, correction = request.param
    own = with_options(settings, correction=correction)
    rt = own.rt.model_copy(update={"period_s": period_s})
    return cell_for(own.model_copy(update={"rt": rt}), "rsi")


@pytest.fixture(scope="module")
def fanuc(settings: Settings) -> CheckedBackend:
    rt = settings.rt.model_copy(update={"period_s": 0.008})
    return cell_for(settings.model_copy(update={"rt": rt}), "fanuc")


@pytest.fixture(scope="module", params=[*few([2, 8]), "torque"])
def ur(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> CheckedBackend:
    """An e-Series and a CB3, and an e-Series with torques."""
    torque = request.param == "torque"
    period_ms = 2 if torque else request.param
    return cell_for(ur_settings(tmp_path_factory.mktemp("ur"), period_ms, torque=torque), "ur")


@pytest.fixture(scope="module")
def franka() -> CheckedBackend:
    return cell_for(franka_settings(address="robot.test"), "franka")


@pytest.mark.parametrize("check", CHECKS)
def test_the_simulation_keeps_it(mujoco: CheckedBackend, check: str) -> None:
    result = examine(mujoco, check)
    assert result.verdict is (CheckVerdict.NOT_TESTED if check in UNTOLD else CheckVerdict.PASSED), (
        result.found
    )
    assert result.found


@pytest.mark.parametrize("check", CHECKS)
def test_fri_keeps_it_beside_a_simulated_cabinet(fri: CheckedBackend, check: str) -> None:
    result = examine(fri, check)
    assert result.verdict is (CheckVerdict.NOT_TESTED if check in UNASKED else CheckVerdict.PASSED), (
        result.found
    )


@pytest.mark.parametrize("check", CHECKS)
def test_rsi_keeps_it_beside_a_simulated_controller(rsi: CheckedBackend, check: str) -> None:
    result = examine(rsi, check)
    assert result.verdict is (CheckVerdict.NOT_TESTED if check in UNASKED else CheckVerdict.PASSED), (
        result.found
    )


@pytest.mark.parametrize("check", CHECKS)
def test_fanuc_keeps_it_beside_a_simulated_controller(fanuc: CheckedBackend, check: str) -> None:
    result = examine(fanuc, check)
    assert result.verdict is (CheckVerdict.NOT_TESTED if check in UNASKED else CheckVerdict.PASSED), (
        result.found
    )


def test_a_first_contact_is_not_announced(fri: CheckedBackend, caplog: pytest.LogCaptureFixture) -> None:
    with fri.drive():
        assert "First contact" not in caplog.text


@pytest.mark.parametrize("check", CHECKS)
def test_ur_keeps_it_beside_a_simulated_controller(ur: CheckedBackend, check: str) -> None:
    result = examine(ur, check)
    untold = check in {*ON_REQUEST, "operation_mode"}
    assert result.verdict is (CheckVerdict.NOT_TESTED if untold else CheckVerdict.PASSED), result.found


def test_settings_without_the_options_of_ur_get_those_of_its_rig(tmp_path: Path) -> None:
    """Such as the address, which the backend requires."""
    own = ur_settings(tmp_path, 2)
    other = own.robot.backend.model_copy(update={"type": "mujoco", "options": {}})
    robot = own.robot.model_copy(update={"backend": other})
    result = examine(cell_for(own.model_copy(update={"robot": robot}), "ur"), "options")
    assert result.verdict is CheckVerdict.PASSED, result.found


@pytest.mark.thorough
@pytest.mark.parametrize("check", CHECKS)
def test_franka_keeps_it_beside_a_stand_in(franka: CheckedBackend, check: str) -> None:
    if check == "options":
        pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: pip install 'cobot[franka]'")
    result = examine(franka, check)
    untold = check in {*UNASKED, "operation_mode", "io"}
    assert result.verdict is (CheckVerdict.NOT_TESTED if untold else CheckVerdict.PASSED), result.found


def test_the_toy_keeps_all_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", TOY, "--json"]) == 0
    results = {each["check"]: each["result"] for each in json.loads(capsys.readouterr().out)}
    assert [results.pop(check) for check in sorted(UNASKED)] == 3 * ["not tested"]
    assert set(results.values()) == {"passed"}
    assert list(results) == [check for check in CHECKS if check not in UNASKED]


def test_the_toy_that_takes_whole_motions_keeps_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", TRAJECTORY_TOY, "--json"]) == 0
    results = {each["check"]: each["result"] for each in json.loads(capsys.readouterr().out)}
    untold = {check for check, result in results.items() if result == "not tested"}
    streams = {"disconnect in a stream", "nan in a stream"}
    of_cycles = {"limits", "staleness", "loss", "reorder", "pile_up", *streams}
    assert untold == {*UNASKED, "io", *of_cycles}
    assert set(results.values()) == {"passed", "not tested"}


def test_ros2_control_keeps_it_beside_a_controller(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", "ros2_control", "--json"]) == 0
    results = {each["check"]: each["result"] for each in json.loads(capsys.readouterr().out)}
    untold = {check for check, result in results.items() if result == "not tested"}
    streams = {"disconnect in a stream", "nan in a stream"}
    of_cycles = {"limits", "staleness", "loss", "reorder", "pile_up", *streams}
    assert untold == {*UNASKED, "io", "operation_mode", *of_cycles}
    assert set(results.values()) == {"passed", "not tested"}


def test_a_stream_to_ros2_control_keeps_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", "ros2_control_stream", "--json"]) == 0
    results = {each["check"]: each["result"] for each in json.loads(capsys.readouterr().out)}
    untold = {check for check, result in results.items() if result == "not tested"}
    assert untold == {*UNASKED, "io", "operation_mode", "reorder", "pile_up"}
    assert set(results.values()) == {"passed", "not tested"}


@pytest.mark.parametrize(
    ("arm", "check", "found"),
    [
        ("InDegrees", "calls", "FAULT"),
        ("ClaimsTorques", "values", r"effort is claimed in capabilities.measured.* it is \[nan nan"),
        ("OneForAll", "calls", r"measured.position is given the shape \(1,\), expected \(7,\)"),
        ("Raises", "calls", "KeyError: 'joint8'"),
        (
            "RaisesTheUnspeakable",
            "calls",
            r"Mute: \(a Mute without a text, because its str\(\) raises SystemExit\)",
        ),
        ("EndsTheProcess", "calls", "SystemExit: 1"),
        ("ReportsForEver", "io", "there are more than 1000 inputs and outputs, which is the maximum"),
        ("NamesAnEscape", "io", r"is '\\x1b\[2J'; it must be a string of 1 to 1000 printable characters"),
        ("ClaimsAForce", "claims", "capabilities.wrench requires a method write_wrench"),
        ("SendsTheLast", "staleness", "reach the device 1 cycles after they were written"),
        (
            "Jumps",
            "disconnect in motion",
            "after a reset, commands sent to the device: the .* times its limit",
        ),
        ("Coarse", "limits", "commands sent to the device: the .* is .* times its limit"),
        ("StrangeMode", "status", "operation_mode is 'MANUAL'"),
        ("SaysAlwaysAuto", "operation_mode", "operation_mode is still 'AUT'"),
        ("HidesStops", "e_stop at rest", "not reached within .* s: e_stop is a fault"),
        ("Impatient", "loss", "a packet was lost"),
        ("NeedsARestart", "protective_stop in motion", "a reset is rejected: .*open it again"),
        (
            "CannotHold",
            "guiding",
            "the mode is FAULT and not HOLD: the robot cannot be held at its position: its brakes are",
        ),
        ("StopsNot", "stop", "a stopped motion ended as ARRIVED"),
        ("SaysItIsThere", "motion", "is .* from its commanded position"),
        ("ForgetsOutputs", "io", "not reached within .* s: gripper closed is reported as 1"),
        ("TakesAnyOutput", "io", "set_output.'no such output'. must raise a BackendError"),
        ("HasASlash", "io", "the name 'gripper/closed' must be"),
        ("ClaimsOutputs", "claims", "capabilities.io requires a method set_output"),
        ("GoesHome", "entry", "the first command for .* from the measured position|FAULT"),
    ],
)
def test_each_way_of_breaking_it_is_found(settings: Settings, arm: str, check: str, found: str) -> None:
    name = f"broken_backends:{arm}"
    result = examine(cell_for(settings, name), check)
    assert result.verdict is CheckVerdict.FAILED
    with pytest.raises(AssertionError, match=found):
        raise AssertionError(result.found)


def test_a_failed_check_is_said_and_is_the_exit_status(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", "broken_backends:StrangeMode", "--only", "motion", "status", "punctuality"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0] for line in lines[:3]] == ["motion", "status", "punctuality"]
    assert "FAILED" in lines[1]
    assert lines[-1] == "broken_backends:StrangeMode, every 1 ms: 1 passed, 1 FAILED, 1 not tested"


def test_durations_count_when_they_are_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    main(["test", TOY, "--only", "punctuality", "--realtime"])
    assert "p99" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "status", "found"), [(TOY, 0, "packets in 0.5 s"), (HURRIES, 1, "packets too fast: ")]
)
def test_beats_are_held_against_the_clock_when_asked_for(
    capsys: pytest.CaptureFixture[str], name: str, status: int, found: str
) -> None:
    assert main(["test", name, "--only", "beat", "--realtime"]) == status
    assert found in capsys.readouterr().out


def test_a_robot_is_not_moved_by_it(settings: Settings) -> None:
    with pytest.raises(ConfigError, match=r"moves a real arm.*the contract does not run on a real robot"):
        cell_for(settings, "broken_backends:Real")


def test_a_rig_may_have_no_faults_that_nobody_knows(settings: Settings) -> None:
    with pytest.raises(ConfigError, match="unknown fault 'lightning'; valid names: disconnect, "):
        cell_for(settings, "broken_backends:StrangeRig")


def test_a_backend_that_is_not_there_is_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test", "nobody"]) == 1
    assert "there is no 'nobody'; valid names: " in capsys.readouterr().err
