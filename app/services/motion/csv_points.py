"""Reads timed joint waypoints from CSV files as spreadsheets and scripts write them."""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import math
import re
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import BinaryIO

from app.services.motion.csv_columns import Columns, brief, columns_of
from cobot.errors import InputError
from cobot.types import Waypoint

MAX_ROWS = 100_000
MAX_LINES = 200_000
"""Maximum number of lines, including blank lines and lines inside quoted cells."""
CHUNK_BYTES = 1 << 20
SEPARATORS = (";", "\t", ",")
WHITESPACE = " "
HEADER_BYTES = LINE_CHARACTERS = 65536
DECIMAL_COMMAS = 1.5
"""Maximum ratio of the number of cells in a row to that in the header. If a row has more, decimal commas have
probably split numbers.
"""
NO_DECIMAL_COMMA = "decimal commas are allowed only if semicolons separate the columns: write 0.5"
ONE_POINT = "write numbers without thousands separators, and all with the same decimal sign"
_DIGIT = re.compile(rb"[0-9]")


class _Numbers:
    """Reads the cells of a file.

    Args:
        decimal_comma: whether numbers may have a decimal comma. A file may not mix decimal commas and points,
            because `2.000` is 2 in English and 2000 in German.
    """

    def __init__(self, names: list[str], *, decimal_comma: bool) -> None:
        self._names = names
        self._decimal_comma = decimal_comma
        self._first: dict[str, str] = {}

    def read(self, cell: str, row: int, index: int) -> float:
        """Convert a cell to a number. Raises InputError if it is not a number; the error names the cell, its
        content and the valid form.
        """
        place = f"row {row}, column {self._names[index]}"
        if self._decimal_comma and ("," in cell or "." in cell):
            self._require_one_sign(cell, place)
        text = cell.replace(",", ".") if self._decimal_comma else cell
        try:
            # Python would also accept 1_0 and the digits of other scripts.
            value = float(text) if "_" not in text and text.strip().isascii() else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            comma = not self._decimal_comma and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell)
            raise InputError(
                f"{place}: must be a finite number, got {brief(cell)!r}"
                + (f"; {NO_DECIMAL_COMMA}" if comma else "")
            )
        return value

    def _require_one_sign(self, cell: str, place: str) -> None:
        """Check that all cells use the same decimal sign. A cell is rejected if it contains both signs, such
        as `1.234,5`, or if its sign differs from that of earlier cells.
        """
        for sign in ",.":
            if sign in cell:
                self._first.setdefault(sign, f"{brief(cell)!r} in {place}")
        if len(self._first) == 2:
            comma, point = self._first[","], self._first["."]
            raise InputError(f"{point} has a point, but {comma} has a decimal comma; {ONE_POINT}")


def read_points(
    file: BinaryIO,
    separator: str | None,
    joints: Sequence[str],
    check: Callable[[Waypoint], None] | None = None,
) -> list[Waypoint]:
    """Read the waypoints of a CSV file. Each is labelled with its row; the header is row 1.

    Columns may be in any order and in upper or lower case. Required columns are the positions (rad), with the
    robot's own joint names, joint1 ... or joint_1 ..., and one of t, time, time_from_start (s). Optional
    columns are velocity_NAME or velocity1 ... (rad/s), and acceleration_NAME or acceleration1 ... (rad/s²).
    If the separator is ";", numbers may use a decimal comma.

    Args:
        joints: the robot's joint names, from the base to the flange.
        separator: separator of the cells. None: find it in the header (semicolon, tab, comma, otherwise white
            space).
        check: function that is called with the first point before the others are read, and may raise an
            error.

    Raises:
        InputError: the file is invalid. The error gives the row, the column and the content.
    """
    _require_few(file)
    if separator is None:
        separator = _find_separator(file)
        if separator == WHITESPACE:
            rows = _spaced_rows(file)
            return _read(rows, separator, joints, check)
    printable = separator.isprintable() or separator == "\t"
    if len(separator) != 1 or not printable or separator.isalnum() or separator in "\"'.+-":
        raise InputError(
            f"separator: {separator!r} cannot separate numbers; use one character such as , ; | space or tab"
        )
    return _read(_rows(file, separator), separator, joints, check)


def _require_few(file: BinaryIO) -> None:
    """Reject a file with too many rows before parsing it, because even the maximum number takes a second to
    parse.

    The check counts lines. It skips files with quoted cells, which may contain line breaks; `_points` checks
    those.

    Raises:
        InputError: the file has more rows than permitted.
    """
    ends = 0
    while (chunk := file.read(CHUNK_BYTES)) and b'"' not in chunk:
        here = chunk.count(b"\n")
        if ends + here > MAX_ROWS:  # `ends` includes the header
            behind = chunk.split(b"\n", max(MAX_ROWS + 1 - ends, 0))[-1]
            start = len(chunk) - len(behind)
            if digit := _DIGIT.search(chunk, start):
                raise _too_many(ends + chunk.count(b"\n", 0, digit.start()) + 1)
        ends += here
    file.seek(0)


def _too_many(number: int) -> InputError:
    return InputError(f"row {number}: there are more than {MAX_ROWS} rows")


def _find_separator(file: BinaryIO) -> str:
    """Find the separator of the column names. No column name can contain it."""
    header = re.split(rb"[\r\n]", file.read(HEADER_BYTES), maxsplit=1)[0]
    file.seek(0)
    return next((each for each in SEPARATORS if each.encode() in header), WHITESPACE)


def _read(
    rows: Generator[tuple[int, list[str]]],
    separator: str,
    joints: Sequence[str],
    check: Callable[[Waypoint], None] | None,
) -> list[Waypoint]:
    with contextlib.closing(rows):
        _, header = next(rows, (1, []))
        if not header:
            raise InputError("row 1 is empty; it must name the columns")
        columns = columns_of(header, joints)
        numbers = _Numbers(columns.names, decimal_comma=separator == ";")
        return _points(rows, columns, check, numbers)


def _points(
    rows: Iterator[tuple[int, list[str]]],
    columns: Columns,
    check: Callable[[Waypoint], None] | None,
    numbers: _Numbers,
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
        points.append(_waypoint(row, number, columns, numbers))
        if check is not None and len(points) == 1:
            check(points[0])
    if not points:
        raise InputError("the file has a header, but no rows")
    return points


def _spaced_rows(file: BinaryIO) -> Generator[tuple[int, list[str]]]:
    """Yield the line number and the cells of each row, for a file with white space as separator."""
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
    """Yield the line number and the cells of each row. The file is read as a stream."""
    text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
    # Spaces before a quote are not part of the value, unless a space is the separator.
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
        text.detach()  # the caller closes the file


def _lines(text: io.TextIOWrapper) -> Iterator[str]:
    """Yield the lines of a file. A line that would take too long to split is rejected."""
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


def _waypoint(row: list[str], number: int, columns: Columns, numbers: _Numbers) -> Waypoint:
    if len(row) != len(columns.names):
        cut = len(row) >= DECIMAL_COMMAS * len(columns.names)
        raise InputError(
            f"row {number}: has {len(row)} columns, but the header has {len(columns.names)}"
            + (f"; {NO_DECIMAL_COMMA}" if cut else "")
        )
    values = [numbers.read(cell, number, index) for index, cell in enumerate(row)]

    def pick(indices: list[int] | None) -> list[float] | None:
        return None if indices is None else [values[index] for index in indices]

    return Waypoint(
        [values[index] for index in columns.positions],
        values[columns.time],
        pick(columns.velocities),
        pick(columns.accelerations),
        f"row {number}",
    )
