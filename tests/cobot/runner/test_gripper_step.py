"""A sequence with a gripper, at the whole service on virtual time. Oracle: the toy gripper's own fingers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from virtual_service import URL, VirtualService

from cobot.grippers.contract.toy import DEVICES, STROKE_M, ToyDevice
from cobot.runner.interpreter import Interpreter
from cobot.runner.library import Library
from cobot.runner.progress import Progress
from cobot.runner.schema import sequence_of

PART_M = 0.04
TOY = "gripper: {type: 'cobot.grippers.contract.toy:ToyGripper'}"
PICK = {
    "steps": [
        {"gripper": {"command": "release"}},
        {
            "on_error": {"retry": 2, "run": [{"gripper": {"command": "move", "width": 0.08}}]},
            "do": [{"gripper": {"command": "grasp", "width": PART_M, "force": 20}}],
        },
        {"named": "home", "speed": 1.0},
    ]
}


def test_a_part_that_is_missed_at_first_is_grasped_at_the_second_attempt(tmp_path: Path) -> None:
    service = VirtualService(tmp_path, of_robot=TOY)
    toy = DEVICES["toy"] = ToyDevice(service.clock.now_s)
    lines: list[str] = []

    def see(event: dict[str, Any]) -> None:
        if event["event"] == "failed":
            toy.object_m = PART_M  # somebody puts the part there

    with service.serving():
        client = service.client(URL)
        interpreter = Interpreter(
            client, Library(tmp_path), Progress(None, None), lines.append, see, service.clock
        )
        interpreter.run(sequence_of(PICK))
        assert toy.touches
        assert toy.force_n == 20.0
        assert client.gripper.state()["state"]["object"] == "held_inside"
        client.gripper.release()
        assert toy.width_m() == STROKE_M
    assert any(
        "attempt 1 of 3 failed: iteration 1/1, step 2.1 of 3: the gripper has closed on nothing" in each
        for each in lines
    )
    assert not any("attempt 2" in line for line in lines)
