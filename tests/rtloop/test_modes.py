"""The table of transitions; what the modes do is in test_controller.py.

Oracle: docs/architecture.md, which people read.
"""

from __future__ import annotations

import re
from pathlib import Path

from cobot.types import LoopMode
from rtloop.modes import TRANSITIONS

DOCUMENT = Path(__file__).parents[2] / "docs" / "architecture.md"


def test_the_documented_table_is_the_one_that_runs() -> None:
    names = "|".join(mode.name for mode in LoopMode)
    rows = re.findall(rf"^\| ({names}) \|.*\| (.*) \|$", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)
    documented = {LoopMode[name]: {LoopMode[word] for word in re.findall(names, goes)} for name, goes in rows}
    assert documented == TRANSITIONS


def test_every_mode_can_be_left_and_an_estop_is_always_possible() -> None:
    assert set(TRANSITIONS) == set(LoopMode)
    assert all(
        LoopMode.ESTOP in following for mode, following in TRANSITIONS.items() if mode is not LoopMode.ESTOP
    )
    assert TRANSITIONS[LoopMode.ESTOP] == {LoopMode.HOLD}
