"""The table of transitions; what the modes do is in test_controller.py.

Oracle: docs/state-and-stop.md, which people read.
"""

from __future__ import annotations

import re
from pathlib import Path

from cobot.types import LoopMode
from rtloop.modes import TRANSITIONS

DOCUMENT = Path(__file__).parents[2] / "docs" / "state-and-stop.md"


def test_the_documented_table_is_the_one_that_runs() -> None:
    names = "|".join(mode.name for mode in LoopMode)
    section = DOCUMENT.read_text(encoding="utf-8").split("\n## Modes\n\n")[1].split("\n\n")[0]
    rows = [row.split("|") for row in section.splitlines()[2:]]
    documented = {
        LoopMode[name]: {LoopMode[word] for word in re.findall(names, row[3])}
        for row in rows
        for name in re.findall(names, row[1])
    }
    assert documented == TRANSITIONS


def test_every_mode_can_be_left_and_an_estop_is_always_possible() -> None:
    assert set(TRANSITIONS) == set(LoopMode)
    assert all(
        LoopMode.ESTOP in following for mode, following in TRANSITIONS.items() if mode is not LoopMode.ESTOP
    )
    assert TRANSITIONS[LoopMode.ESTOP] == {LoopMode.HOLD}
