"""Results of consecutive tasks as columns, and their conversion to bytes.

The same results always give the same bytes, so a hash of the bytes is part of the file's name.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cobot.errors import InputError

Column = npt.NDArray[np.generic]
Columns = Mapping[str, Column]
"""One array per result. Each array has one element per task, of type bool, int64, float64 or text."""

FAILURE = "failure"
"""Name of the column that gives the reason why a task has no results. The reason is empty if the task has
results.
"""
KINDS = {"b": np.dtype(bool), "i": np.dtype(np.int64), "u": np.dtype(np.int64), "f": np.dtype(np.float64)}
"""Types of columns, by the codes that NumPy uses for kinds. Texts have a separate type for each length."""


def as_columns(columns: Mapping[str, npt.ArrayLike], tasks: int) -> dict[str, Column]:
    """Convert columns to the few types that a chunk may have.

    Raises:
        InputError: the type of a column is not one of these, or its number of elements is wrong.
    """
    found = {name: _typed(name, np.asarray(values), tasks) for name, values in columns.items()}
    return {name: found[name] for name in sorted(found)}


def _typed(name: str, values: Column, tasks: int) -> Column:
    if values.shape != (tasks,):
        raise InputError(f"result {name!r}: has shape {values.shape}; it must have {tasks} elements")
    if values.dtype.kind == "U":
        return values
    if values.dtype.kind not in KINDS:
        raise InputError(
            f"result {name!r}: is {values.dtype}; it must be a number, true or false, or a string"
        )
    return values.astype(KINDS[values.dtype.kind])


def to_bytes(columns: Columns) -> bytes:
    """The columns as an NPZ file. NumPy writes fixed time stamps into it."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **{name: columns[name] for name in sorted(columns)})
    return file.getvalue()


def from_bytes(content: bytes) -> dict[str, Column]:
    """Read the columns of a chunk.

    Raises:
        ValueError, OSError, KeyError: the bytes are not a chunk.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        return {name: file[name] for name in sorted(file.files)}


def digest(content: bytes) -> str:
    """SHA-256, as hexadecimal text."""
    return hashlib.sha256(content).hexdigest()


def joined(parts: Sequence[Columns]) -> dict[str, Column]:
    """The columns of all parts, concatenated. Values that are missing in a part become NaN, 0, false or
    "".
    """
    names = sorted({name for part in parts for name in part})
    for name in names:
        texts = {part[name].dtype.kind == "U" for part in parts if name in part}
        if len(texts) > 1:
            raise InputError(f"result {name!r}: is a string in some tasks and a number in others")
    return {name: np.concatenate([_column(part, name, parts) for part in parts]) for name in names}


def _column(part: Columns, name: str, parts: Sequence[Columns]) -> Column:
    if name in part:
        return part[name]
    tasks = len(next(iter(part.values())))
    kind = next(each[name].dtype for each in parts if name in each)
    return np.full(tasks, np.nan) if kind.kind == "f" else np.zeros(tasks, kind)


def failures(count: int, reason: str) -> dict[str, Column]:
    """The columns of tasks that have no results."""
    return {FAILURE: np.full(count, reason)}


def has_result(columns: Columns) -> npt.NDArray[np.bool_]:
    """Whether each task has results."""
    reasons = columns.get(FAILURE)
    tasks = len(next(iter(columns.values()))) if columns else 0
    return np.ones(tasks, bool) if reasons is None else reasons == ""
