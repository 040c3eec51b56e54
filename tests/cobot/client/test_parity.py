"""The tables of tests in tests/parity.

Oracle: the names of the test functions in this folder's neighbours.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[2]
DOCUMENTS = TESTS / "parity"


@pytest.mark.parametrize("document", ["flexiv.md", "aubo.md"])
def test_every_test_that_the_table_names_exists(document: str) -> None:
    named = set(re.findall(r"`(test_\w+)`", (DOCUMENTS / document).read_text(encoding="utf-8")))
    defined = {
        name
        for file in TESTS.rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert len(named) > 60
    assert named <= defined, f"no such tests: {sorted(named - defined)}"
