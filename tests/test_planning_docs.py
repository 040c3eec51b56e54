"""The table of complaints about planners names tests: each of them exists, in the file that it names."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "tests" / "cobot" / "planners" / "complaints.md"


def test_each_test_that_the_table_of_complaints_names_exists() -> None:
    text = TABLE.read_text(encoding="utf-8")
    named = set(re.findall(r"(?:`|::)(test_\w+)`", text))
    source = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "tests").rglob("test_*.py"))
    assert len(named) > 15
    assert [name for name in sorted(named) if f"def {name}(" not in source] == []


def test_each_file_that_the_table_of_complaints_names_has_the_test() -> None:
    text = TABLE.read_text(encoding="utf-8")
    named = re.findall(r"`([\w/]+\.py)::(test_\w+)`", text)
    assert len(named) > 15
    for path, name in named:
        file = ROOT / (path if path.startswith("tests/") else f"tests/cobot/planners/{path}")
        assert file.is_file(), path
        assert f"def {name}(" in file.read_text(encoding="utf-8"), f"{path}::{name}"
