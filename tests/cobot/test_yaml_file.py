"""YAML files. Oracle: PyYAML's own reading of the same text where nothing is wrong with it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from cobot.errors import ConfigError
from cobot.yaml_file import read_mapping, read_yaml

TEXT = "a: 1\nb: {c: [1.5, true, null], d: é}\n"


def test_a_file_is_read_as_yaml_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(TEXT, encoding="utf-8")
    assert read_yaml(path) == read_mapping(path) == yaml.safe_load(TEXT)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"a: 1\nb: 2\na: 3\n", "'a' occurs twice"),
        (b"a: {b: 1, b: 2}\n", "'b' occurs twice"),
        (b"a: [1\n", "not valid YAML"),
        (b"a: 2026-13-45\n", "not valid YAML"),
        (b"{[1]: 2}\n", "not valid YAML"),
        (b"a: \xff\n", "cannot be read"),
        (b"a: !!python/object:os.system {}\n", "not valid YAML"),
    ],
)
def test_what_is_wrong_is_one_sentence_with_the_path(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=sentence) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("each", ["[", "{a: ", "- ", "? "])
@pytest.mark.parametrize("depth", [1_000, 200_000])
def test_no_depth_ends_the_process(tmp_path: Path, each: str, depth: int) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(each * depth)
    with pytest.raises(ConfigError, match="not valid YAML: maximum recursion depth exceeded"):
        read_yaml(path)


def test_a_missing_file_and_one_that_holds_no_mapping_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"missing\.yaml: no such file"):
        read_yaml(tmp_path / "missing.yaml")
    (tmp_path / "list.yaml").write_text("[1, 2]", encoding="utf-8")
    with pytest.raises(ConfigError, match="must contain a mapping, got list"):
        read_mapping(tmp_path / "list.yaml")
    (tmp_path / "empty.yaml").write_text("# nothing yet", encoding="utf-8")
    with pytest.raises(ConfigError, match="must contain a mapping, got nothing"):
        read_mapping(tmp_path / "empty.yaml")
