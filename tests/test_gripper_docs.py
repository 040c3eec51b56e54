"""What docs/grippers.md and docs/cell.md say of options. Oracle: the options themselves."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from cobot.cell import Cell, Hand
from cobot.grippers import GripperOptions
from cobot.grippers.digital import DigitalOptions
from cobot.grippers.registry import gripper_names
from cobot.grippers.robotiq.driver import RobotiqOptions
from cobot.grippers.ros import RosOptions
from cobot.grippers.vacuum import VacuumOptions

DOCS = Path(__file__).parents[1] / "docs"
GRIPPERS = (DOCS / "grippers.md").read_text(encoding="utf-8")
OPTIONS = {"robotiq": RobotiqOptions, "digital": DigitalOptions, "vacuum": VacuumOptions, "ros": RosOptions}
COMMON = GripperOptions.model_fields


def rows(text: str) -> dict[str, str]:
    """The options of the tables in a text, each with its default."""
    found: dict[str, str] = {}
    for names, default in re.findall(r"^\| ((?:`\w+`(?:, )?)+) \| *([^|]*?) *\|", text, re.M):
        several = re.findall(r"`(\w+)`", names)
        defaults = default.replace("`", "").split(", ") if len(several) > 1 else [default.strip(" `")]
        found |= dict(zip(several, defaults * (len(several) if len(defaults) == 1 else 1), strict=True))
    return found


def shown(value: Any) -> str:
    return {None: "none", False: "false"}.get(value, f"{value:g}" if isinstance(value, float) else str(value))


def section(title: str) -> str:
    return GRIPPERS.split(f"\n## {title}\n")[1].split("\n## ")[0]


@pytest.mark.parametrize(("title", "options"), OPTIONS.items())
def test_the_options_of_a_driver_are_those_of_its_section(title: str, options: type[GripperOptions]) -> None:
    told = rows(section(title))
    assert set(told) == set(options.model_fields) - set(COMMON)
    for name, field in options.model_fields.items():
        if name in told and not re.search(r"needed|depends on|^$", told[name]):
            assert (
                float(told[name]) == field.default
                if re.fullmatch(r"[\d.]+", told[name])
                else (told[name] == shown(field.default))
            ), name


def test_the_options_of_all_drivers_are_told_once() -> None:
    told = rows(section("What is held"))
    assert told == {name: shown(field.default) for name, field in COMMON.items()}


def test_each_type_has_a_section() -> None:
    types = re.findall(r"^\| `(\w+)` \| [^|]*\|$", GRIPPERS.split("\n> ")[0], re.M)
    assert set(types) == set(gripper_names())
    assert [title for title in types if f"\n## {title}\n" not in GRIPPERS] == []


def test_the_cell_file_of_the_page_is_valid_and_its_hand_is_the_default() -> None:
    text = (DOCS / "cell.md").read_text(encoding="utf-8")
    (block,) = (each for each in re.findall(r"```yaml\n(.*?)```", text, re.S) if "floor_m" in each)
    cell = Cell.model_validate(yaml.safe_load(block))
    assert set(yaml.safe_load(block)) == set(Cell.model_fields)
    assert cell.hand == Hand()
    assert set(yaml.safe_load(block)["hand"]) == set(Hand.model_fields)
