"""Colours, tables and a progress bar for a terminal. A pipe or a file gets plain text."""

from __future__ import annotations

import os
import shutil
import sys
import time
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

STYLES = {"bold": "1", "red": "31", "yellow": "33", "magenta": "35", "bold red": "1;31"}
"""Parameters of the escape sequence that selects a style (ECMA-48, select graphic rendition)."""
ERASE_LINE = "\r\x1b[K"
BAR_CELLS = 40


def show(line: str, style: str = "") -> None:
    """Print a line. The style, one of `STYLES`, is used if stdout is a terminal with colours."""
    plain = not style or not _is_terminal(sys.stdout) or bool(os.environ.get("NO_COLOR"))
    print(line if plain else f"\x1b[{STYLES[style]}m{line}\x1b[0m", flush=True)


def show_columns(headings: Sequence[str], rows: Sequence[Sequence[str]], right: int) -> None:
    """Print a table.

    Args:
        right: index of the first column whose cells are aligned to the right.
    """
    widths = [max(map(_cells, column)) for column in zip(headings, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        padded = []
        for column, (cell, width) in enumerate(zip(cells, widths, strict=True)):
            blanks = " " * (width - _cells(cell))
            padded.append(blanks + cell if column >= right else cell + blanks)
        return "  ".join(padded).rstrip()

    show(line(headings), "bold")
    for row in rows:
        show(line(row))


class Bar:
    """A progress bar on stderr. Prints nothing if stderr is not a terminal."""

    def __init__(self, shown: bool) -> None:
        self._shown = shown and _is_terminal(sys.stderr)
        self._what = ""
        self._start_s = time.monotonic()

    @contextmanager
    def showing(self, what: str) -> Iterator[Bar]:
        """Context manager that shows the bar, and removes it at the end."""
        self._start_s = time.monotonic()
        self.update(0.0, 0.0, what)
        try:
            yield self
        finally:
            self.erase()

    def update(self, done: float, total: float, what: str | None = None) -> None:
        """Draw the bar. If the total is 0, the finished part is unknown, and only the text is drawn."""
        self._what = what or self._what
        line = self._what
        if total > 0.0:
            part = min(max(done / total, 0.0), 1.0)
            full = round(part * BAR_CELLS)
            line += f" {'█' * full}{'░' * (BAR_CELLS - full)} {part:4.0%} {self._remaining(part)}"
        self._write(ERASE_LINE + line[: shutil.get_terminal_size().columns - 1])

    def erase(self) -> None:
        """Remove the bar until the next update, so that other output can be printed."""
        self._write(ERASE_LINE)

    def _remaining(self, part: float) -> str:
        if part == 0.0:
            return "-:--"
        minutes, seconds = divmod(round((time.monotonic() - self._start_s) * (1.0 / part - 1.0)), 60)
        return f"{minutes}:{seconds:02}"

    def _write(self, text: str) -> None:
        if self._shown:
            sys.stderr.write(text)
            sys.stderr.flush()


def _is_terminal(stream: TextIO) -> bool:
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def _cells(text: str) -> int:
    """Width of a text in terminal cells. Chinese characters take two cells (Unicode annex 11)."""
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in text)
