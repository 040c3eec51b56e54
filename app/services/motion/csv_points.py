"""Timed joint waypoints from a CSV file, as spreadsheets and scripts write it."""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import math
import re
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from cobot.errors import InputError
from cobot.strict import unknown_key
from cobot.types import Waypoint

MAX_ROWS = 100_000
MAX_LINES = 200_000
"""Blank ones too, and those of quoted cells."""
CHUNK_BYTES = 1 << 20
SHOWN_CHARACTERS = 40
SEPARATORS = (";", "\t", ",")
WHITESPACE = " "
HEADER_BYTES = LINE_CHARACTERS = 65536
DECIMAL_COMMAS = 1.5
"""A row with so many times more cells than the header had its numbers cut at decimal commas."""
NO_DECIMAL_COMMA = "a decimal comma is understood only where semicolons separate the columns: write 0.5"
TIME_NAMES = ("t", "time", "time_from_start")
_DIGIT = re.compile(rb"[0-9]")
_JOINT_NAME = re.compile(r"(joint|velocity|acceleration)_?([0-9]{1,3})")


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where the numbers stand: indices into a row."""

    names: list[str]
    time: int
    positions: list[int]
    velocities: list[int] | None
    accelerations: list[int] | None


def read_points(
    file: BinaryIO, separator: str | None, dof: int, check: Callable[[Waypoint], None] | None = None
) -> list[Waypoint]:
    """The waypoints of a CSV file, each labelled with its row; the header is row 1.

    Columns, in any order and any case: joint1 or joint_1 and so on (rad), one of t, time,
    time_from_start (s), and optionally velocity1 ... (rad/s) and acceleration1 ... (rad/s²).
    With ";" as separator numbers may have a decimal comma.

    Args:
        separator: None for what the header has: semicolons, tabs, commas, or else white space.
        check: called with the first point, before the others are read; what it raises is raised.

    Raises:
        InputError: naming row, column and what stands there.
    """
    _require_few(file)
    if separator is None:
        separator = _found(file)
        if separator == WHITESPACE:
            rows = _spaced_rows(file)
            return _read(rows, separator, dof, check)
    printable = separator.isprintable() or separator == "\t"
    if len(separator) != 1 or not printable or separator.isalnum() or separator in "\"'.+-":
        raise InputError(
            f"separator: {separator!r} cannot separate numbers; use one character such as , ; | space or tab"
        )
    return _read(_rows(file, separator), separator, dof, check)


def _require_few(file: BinaryIO) -> None:
    """Refuse a file with too many rows before a single one is taken apart, which takes a second for the most.

    Rows are lines here, so a file with a quoted cell, which may hold a line's end, is left to `_points`.

    Raises:
        InputError: there is something behind the last row that there may be.
    """
    ends = 0
    while (chunk := file.read(CHUNK_BYTES)) and b'"' not in chunk:
        here = chunk.count(b"\n")
        if ends + here > MAX_ROWS:  # the header is a line, too
            behind = chunk.split(b"\n", max(MAX_ROWS + 1 - ends, 0))[-1]
            start = len(chunk) - len(behind)
            if digit := _DIGIT.search(chunk, start):
                raise _too_many(ends + chunk.count(b"\n", 0, digit.start()) + 1)
        ends += here
    file.seek(0)


def _too_many(number: int) -> InputError:
    return InputError(f"row {number}: there are more than {MAX_ROWS} rows")


def _found(file: BinaryIO) -> str:
    """What separates the columns' names, in which none of these can stand."""
    header = re.split(rb"[\r\n]", file.read(HEADER_BYTES), maxsplit=1)[0]
    file.seek(0)
    return next((each for each in SEPARATORS if each.encode() in header), WHITESPACE)


def _read(
    rows: Generator[tuple[int, list[str]]],
    separator: str,
    dof: int,
    check: Callable[[Waypoint], None] | None,
) -> list[Waypoint]:
    with contextlib.closing(rows):
        _, header = next(rows, (1, []))
        if not header:
            raise InputError("row 1 is empty; it must name the columns")
        return _points(rows, _columns(header, dof), check, decimal_comma=separator == ";")


def _points(
    rows: Iterator[tuple[int, list[str]]],
    columns: _Columns,
    check: Callable[[Waypoint], None] | None,
    *,
    decimal_comma: bool,
) -> list[Waypoint]:
    points: list[Waypoint] = []
    blank = 0
    for number, row in rows:
        if not any(cell.strip() for cell in row):
            blank = blank or number
            continue
        if blank:
            raise InputError(f"row {blank} is blank, but row {number} is not")
        if len(points) == MAX_ROWS:
            raise _too_many(number)
        points.append(_waypoint(row, number, columns, decimal_comma))
        if check is not None and len(points) == 1:
            check(points[0])
    if not points:
        raise InputError("the file has a header, but no rows")
    return points


def _spaced_rows(file: BinaryIO) -> Generator[tuple[int, list[str]]]:
    """(line number, cells) of each row of words between any white space."""
    text = io.TextIOWrapper(file, encoding="utf-8-sig")
    number = 0
    try:
        for number, line in enumerate(_lines(text), start=1):
            yield number, line.split()
    except UnicodeDecodeError as exc:
        raise _no_text(number + 1, exc) from exc
    finally:
        text.detach()  # the file is the caller's to close


def _rows(file: BinaryIO, separator: str) -> Generator[tuple[int, list[str]]]:
    """(line number, cells) of each row; the file is read as a stream."""
    text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
    # Spaces before a quote belong to nobody, unless they are the separator.
    reader = csv.reader(_lines(text), delimiter=separator, skipinitialspace=separator != " ", strict=True)
    try:
        while True:
            number = reader.line_num + 1
            try:
                row = next(reader)
            except StopIteration:
                return
            except UnicodeDecodeError as exc:
                raise _no_text(number, exc) from exc
            except csv.Error as exc:
                raise InputError(f"row {number}: not CSV: {exc}") from exc
            yield number, row
    finally:
        text.detach()  # the file is the caller's to close


def _lines(text: io.TextIOWrapper) -> Iterator[str]:
    """None so long that to take it apart would keep the interpreter from all others."""
    for number in itertools.count(1):
        line = text.readline(LINE_CHARACTERS + 1)
        if len(line) > LINE_CHARACTERS:
            raise InputError(f"row {number}: not CSV: more than {LINE_CHARACTERS} characters in a line")
        if not line:
            return
        if number > MAX_LINES:
            raise InputError(f"row {number}: there are more than {MAX_LINES} lines")
        yield line


def _no_text(number: int, exc: UnicodeDecodeError) -> InputError:
    return InputError(f"row {number} or soon after: not UTF-8 text (byte 0x{exc.object[exc.start]:02x})")


def _columns(header: list[str], dof: int) -> _Columns:
    names = [cell.strip() for cell in header]
    places: dict[str, int] = {}
    valid = [*(f"joint{n}" for n in range(1, dof + 1)), TIME_NAMES[0]]
    optional = [f"{kind}{n}" for kind in ("velocity", "acceleration") for n in range(1, dof + 1)]
    for index, name in enumerate(names):
        plain = name.lower()
        match = _JOINT_NAME.fullmatch(plain)
        key = f"{match[1]}{int(match[2])}" if match else TIME_NAMES[0] if plain in TIME_NAMES else plain
        if key not in valid and key not in optional:
            raise InputError(f"row 1, column {index + 1}: {unknown_key(name, [*valid, *optional])}")
        if key in places:
            raise InputError(
                f"row 1, column {index + 1}: {name!r} names the same as {names[places[key]]!r} in column "
                f"{places[key] + 1}"
            )
        places[key] = index
    missing = [key for key in valid if key not in places]
    for kind in ("velocity", "acceleration"):
        family = [key for key in optional if key.startswith(kind)]
        if any(key in places for key in family):
            missing += [key for key in family if key not in places]
    if missing:
        raise InputError(
            f"row 1: missing column {', '.join(missing)}; the row has {_shown(', '.join(names))}"
        )

    def group(kind: str) -> list[int] | None:
        return [places[f"{kind}{n}"] for n in range(1, dof + 1)] if f"{kind}1" in places else None

    positions = [places[f"joint{n}"] for n in range(1, dof + 1)]
    return _Columns(names, places[TIME_NAMES[0]], positions, group("velocity"), group("acceleration"))


def _waypoint(row: list[str], number: int, columns: _Columns, decimal_comma: bool) -> Waypoint:
    if len(row) != len(columns.names):
        cut = len(row) >= DECIMAL_COMMAS * len(columns.names)
        raise InputError(
            f"row {number}: has {len(row)} columns, the header has {len(columns.names)}"
            + (f"; {NO_DECIMAL_COMMA}" if cut else "")
        )
    values = [_number(cell, number, index, columns, decimal_comma) for index, cell in enumerate(row)]

    def pick(indices: list[int] | None) -> list[float] | None:
        return None if indices is None else [values[index] for index in indices]

    return Waypoint(
        [values[index] for index in columns.positions],
        values[columns.time],
        pick(columns.velocities),
        pick(columns.accelerations),
        f"row {number}",
    )


def _number(cell: str, number: int, index: int, columns: _Columns, decimal_comma: bool) -> float:
    text = cell.replace(",", ".") if decimal_comma else cell
    try:
        # Python would read 1_0 as ten, and the digits of every script.
        value = float(text) if "_" not in text and text.strip().isascii() else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        comma = not decimal_comma and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell)
        raise InputError(
            f"row {number}, column {columns.names[index]}: must be a finite number, got {_shown(cell)!r}"
            + (f"; {NO_DECIMAL_COMMA}" if comma else "")
        )
    return value


def _shown(text: str) -> str:
    return text if len(text) <= SHOWN_CHARACTERS else text[:SHOWN_CHARACTERS] + "..."
