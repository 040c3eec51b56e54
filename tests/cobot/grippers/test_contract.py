"""The contract of grippers. Oracle: the shipped drivers keep it, and a broken one fails its checks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cobot.config import load_settings
from cobot.contract_checks import CheckVerdict
from cobot.errors import ConfigError
from cobot.grippers import GripperState, HeldObject
from cobot.grippers.contract.__main__ import main
from cobot.grippers.contract.suite import CHECKS, examine, subject_for
from cobot.grippers.contract.toy import ToyGripper, ToyOptions, ToyRig

NOT_TESTED = {
    "franka": ["fault"],
    "simulated": ["fault"],
    "digital": ["stop", "fault"],
    "ros": ["fault"],
    "vacuum": ["move", "preempt", "stop", "fault"],
}
"""What the devices of these drivers do not have: faults of their own, fingers that stop on their way, or any
fingers."""
TOY = "cobot.grippers.contract.toy:ToyGripper"


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize(
    ("name", "options"),
    [
        (TOY, {}),
        ("robotiq", {"device": "/dev/ttyUSB0"}),
        ("robotiq", {"device": "10.0.0.2:54321", "model": "hande"}),
        ("robotiq", {"device": "10.0.0.2", "protocol": "urcap"}),
        ("franka", {"address": "127.0.0.1"}),
        ("simulated", {}),
        ("digital", {"close_output": "shut", "closed_input": "closed"}),
        ("digital", {"open_output": "open", "closed_input": "closed", "opened_input": "opened"}),
        (
            "digital",
            {"close_output": "shut", "open_output": "open", "closed_input": "c", "inverted_inputs": True},
        ),
        ("ros", {"action": "/hand/cmd", "joint": "jaw", "open_position": 0.04, "open_width": 0.08}),
        (
            "ros",
            {
                "action": "/hand/cmd",
                "action_type": "ParallelGripperCommand",
                "joint": "knuckle",
                "open_position": 0.0,
                "closed_position": 0.8,
                "open_width": 0.085,
            },
        ),
        ("vacuum", {"output": "ejector", "sensor": "vacuum"}),
        (
            "vacuum",
            {
                "output": "pump",
                "on_value": 8.0,
                "off_value": 0.5,
                "blow_output": "blow",
                "sensor": "kPa",
                "threshold": 40.0,
                "hysteresis": 10.0,
                "inverted_sensor": True,
            },
        ),
    ],
)
def test_the_shipped_drivers_keep_the_contract(name: str, options: dict[str, object], check: str) -> None:
    result = examine(subject_for(load_settings(), name, options), check)
    untested = check in NOT_TESTED.get(name, [])
    assert result.verdict is (CheckVerdict.NOT_TESTED if untested else CheckVerdict.PASSED), result


class Broken(ToyGripper):
    """Says that it rests and holds an object, whatever it does; a stop does nothing."""

    def stop(self) -> None: ...

    def state(self) -> GripperState:
        super().state()
        return GripperState(0.05, 0.05, moving=False, object=HeldObject.HELD_INSIDE)

    @staticmethod
    def contract_rig(options: ToyOptions) -> ToyRig:
        class Rig(ToyRig):
            def gripper(self, port: object) -> Broken:
                return Broken(options, port)  # type: ignore[arg-type]

        return Rig(options)


@pytest.mark.parametrize("check", ["move", "preempt", "grasp", "missed", "lost", "fault"])
def test_a_driver_that_says_what_is_not_true_fails(check: str) -> None:
    result = examine(subject_for(load_settings(), f"{__name__}:Broken", {}), check)
    assert result.verdict is CheckVerdict.FAILED, result


def test_a_new_package_keeps_the_contract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["new", "claw", "--dir", str(tmp_path)]) == 0
    folder = tmp_path / "cobot-gripper-claw"
    monkeypatch.setenv("PYTHONPATH", str(folder))
    command = [sys.executable, "-m", "cobot.grippers.contract", "test", "cobot_gripper_claw:ClawGripper"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "FAILED" not in done.stdout


@pytest.mark.parametrize(
    ("name", "words"),
    [("Claw", "lowercase letters"), ("robotiq", "is taken"), ("class", "reserved by Python")],
)
def test_a_name_that_cannot_be_used_is_an_error(
    name: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", name, "--dir", str(tmp_path)]) == 1
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_list_has_the_shipped_types_with_their_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    shown = capsys.readouterr().out
    assert "robotiq  (cobot, cobot.grippers.robotiq:RobotiqGripper)" in shown
    assert "device (required)" in shown


def test_a_test_without_a_needed_option_names_it() -> None:
    with pytest.raises(ConfigError, match="device"):
        subject_for(load_settings(), "robotiq", {})
