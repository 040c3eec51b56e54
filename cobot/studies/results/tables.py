"""All results of a study in one file: Parquet through duckdb if it is installed, otherwise SQLite."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cobot.errors import UnavailableError, exhausted
from cobot.studies.chunks import Column

SQLITE, PARQUET = "results.sqlite", "results.parquet"
_TYPES = {"b": "BOOLEAN", "i": "INTEGER", "f": "REAL", "U": "TEXT"}
_PARQUET_TYPES = {"b": "BOOLEAN", "i": "BIGINT", "f": "DOUBLE", "U": "VARCHAR"}


def write_table(folder: Path, columns: Mapping[str, Column]) -> Path:
    """Write the table `results` with one row per task, and return its path.

    Raises:
        UnavailableError: the folder cannot be written; an older table is not changed.
    """
    with_duckdb = find_spec("duckdb") is not None
    path = folder / (PARQUET if with_duckdb else SQLITE)
    new = path.with_name(f"{path.name}.new")
    try:
        new.unlink(missing_ok=True)
        (_write_parquet if with_duckdb else _write_sqlite)(new, columns)
        os.replace(new, path)
        (folder / (SQLITE if with_duckdb else PARQUET)).unlink(
            missing_ok=True
        )  # written by a run with other packages
    except (OSError, sqlite3.Error) as exc:
        raise exhausted(exc) or UnavailableError(f"{path}: cannot be written: {exc}") from exc
    finally:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
    return path


def _write_sqlite(path: Path, columns: Mapping[str, Column]) -> None:
    names = ", ".join(f"{_quoted(name)} {_TYPES[values.dtype.kind]}" for name, values in columns.items())
    marks = ", ".join("?" for _ in columns)
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(f"CREATE TABLE results ({names})")
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        connection.executemany(f"INSERT INTO results VALUES ({marks})", rows)


def _write_parquet(path: Path, columns: Mapping[str, Column]) -> None:
    import duckdb

    database: Any
    with contextlib.closing(duckdb.connect()) as database:
        database.execute("SET threads = 1")  # so that the rows keep their order
        try:
            table = {name: _plain(values) for name, values in columns.items()}
            chosen = ", ".join(
                f"CAST({_quoted(name)} AS {_PARQUET_TYPES[values.dtype.kind]}) AS {_quoted(name)}"
                for name, values in columns.items()
            )
            database.register("columns_of_study", table)
            target = str(path).replace("'", "''")
            database.execute(f"COPY (SELECT {chosen} FROM columns_of_study) TO '{target}' (FORMAT parquet)")
        except duckdb.Error as exc:
            raise OSError(str(exc)) from exc


def _plain(values: Column) -> Column:
    """Convert strings to Python objects, which duckdb can read."""
    return values.astype(object) if values.dtype.kind == "U" else values


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
