"""Outputs of a controller of Universal Robots.

Oracle: the RTDE guide, by which a variable keeps the value that came last.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rtloop.backends.ur.points import GROUPS, UrOutputs, points


class Controller:
    """It applies the variables once per period, after all packages of the period."""

    def __init__(self) -> None:
        self.data: dict[str, Any] = {
            "actual_digital_input_bits": 0,
            "actual_digital_output_bits": 0,
            "target_speed_fraction": 1.0,
        }
        self.variables: dict[str, Any] = {}

    def take(self, group: str, values: Mapping[str, Any]) -> bool:
        self.variables.update(values)
        return True

    def pass_period(self) -> None:
        mask = self.variables.get("standard_digital_output_mask", 0)
        value = self.variables.get("standard_digital_output", 0)
        bits = self.data["actual_digital_output_bits"]
        self.data["actual_digital_output_bits"] = bits & ~mask | value & mask


def test_outputs_of_one_group_are_all_set() -> None:
    controller = Controller()
    outputs = UrOutputs(controller.take)
    for index in range(8):
        outputs.set(controller.data, f"digital_out_{index}", 1.0, 0.0)
    for cycle in range(20):
        outputs.follow(controller.data, 0.008 * cycle)
        controller.pass_period()
    values = {each.name: each.value for each in points(controller.data)}
    assert [values[f"digital_out_{index}"] for index in range(8)] == [1.0] * 8
    assert controller.variables[GROUPS[1][0]] == 0
