"""Where the files are that settings name; what is refused is in test_reading.py."""

from __future__ import annotations

from pathlib import Path

from cobot.config import resolve


def test_a_path_is_relative_to_the_file_that_names_it(tmp_path: Path) -> None:
    assert resolve("a/b.yaml", tmp_path) == tmp_path / "a" / "b.yaml"
    assert resolve("~/x", tmp_path) == Path.home() / "x"
