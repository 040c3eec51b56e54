"""Tables of results. Oracles: SQLite and duckdb themselves, which read the files."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from learning_peers import need

import cobot.studies.results.tables
from cobot.errors import UnavailableError
from cobot.studies.chunks import Column
from cobot.studies.results.tables import PARQUET, SQLITE, write_table

COLUMNS: dict[str, Column] = {
    "task": np.arange(4),
    "value": np.array([1.5, -0.0, np.inf, 1e-300]),
    "good": np.array([True, False, True, False]),
    "a \"quoted\" name, and 'more'": np.array(["", "ä", "it's", 'x"y']),
}
ROWS = list(zip(*(values.tolist() for values in COLUMNS.values()), strict=True))


def test_sqlite_has_a_row_for_each_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cobot.studies.results.tables, "find_spec", lambda name: None)
    path = write_table(tmp_path, COLUMNS)
    assert path.name == SQLITE
    with closing(sqlite3.connect(path)) as table:
        found = table.execute("SELECT * FROM results ORDER BY task")
        assert [column[0] for column in found.description] == list(COLUMNS)
        assert found.fetchall() == ROWS
    before = path.read_bytes()
    assert write_table(tmp_path, COLUMNS).read_bytes() == before


def test_parquet_has_a_row_for_each_task_and_always_the_same_bytes(tmp_path: Path) -> None:
    duckdb = need("duckdb", "study")
    path = write_table(tmp_path, COLUMNS)
    assert path.name == PARQUET
    with closing(duckdb.connect()) as database:
        found = database.execute(f"SELECT * FROM '{path}'")
        assert [column[0] for column in found.description] == list(COLUMNS)
        assert found.fetchall() == ROWS
        kinds = {
            name: kind for name, kind, *_ in database.execute(f"DESCRIBE SELECT * FROM '{path}'").fetchall()
        }
    assert list(kinds.values()) == ["BIGINT", "DOUBLE", "BOOLEAN", "VARCHAR"]
    before = path.read_bytes()
    assert write_table(tmp_path, COLUMNS).read_bytes() == before


@pytest.mark.parametrize("package", ["duckdb", None])
def test_a_folder_that_cannot_be_written_is_an_error(
    package: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if package is None:
        monkeypatch.setattr(cobot.studies.results.tables, "find_spec", lambda name: None)
    else:
        need(package, "study")
    with pytest.raises(UnavailableError, match=r"results\.\w+: cannot be written: "):
        write_table(tmp_path / "missing", COLUMNS)


def test_a_table_of_an_earlier_run_with_other_packages_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / PARQUET).write_bytes(b"old results")
    monkeypatch.setattr(cobot.studies.results.tables, "find_spec", lambda name: None)
    write_table(tmp_path, COLUMNS)
    assert [path.name for path in tmp_path.iterdir()] == [SQLITE]
