"""Makes strings, iterators and numbers from devices, files and programs safe to store, print and send.

An object's `str()` may raise an error or return an object of a different type. A string may be a megabyte of
escape sequences, an iterator may never end, and a number may have 300 digits.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

from cobot.errors import InputError
from cobot.logs.lines import MAX_MESSAGE, printable

MAX_NAME = 80
WIDE = 1e7
"""Numbers of this size and above are written with an exponent, because their digits would be hard to count.
"""


MAX_LINE = 10_000
MAX_LINES = 200


def plain_text(value: object, max_characters: int = MAX_MESSAGE) -> str:
    """The text of any object in one printable line. A longer text is cut off, with a note about its
    length.
    """
    return printable(_text(value), max_characters)


def joined_text(value: object, max_characters: int = MAX_MESSAGE) -> str:
    """The text of any object in one printable line, in which spaces and line breaks are replaced by single
    spaces.
    """
    text, head = _text(value), 2 * max_characters
    return plain_text(" ".join(text[:head].split()) + text[head:], max_characters)


def plain_lines(value: object, indent: str = "") -> str:
    """The text of any object, in at most `MAX_LINES` printable lines.

    Args:
        indent: prefix of each line except the first.
    """
    text = _text(value)
    lines = text[: MAX_LINE * MAX_LINES].split("\n", MAX_LINES)
    if len(lines) > MAX_LINES:
        lines[-1] = f"... ({text.count(chr(10)) + 1} lines)"
    return f"\n{indent}".join(printable(line, MAX_LINE) for line in lines)


def plain_error(exc: BaseException, max_characters: int = MAX_MESSAGE) -> str:
    """Type and text of an exception, as one line."""
    return f"{_type_name(exc)}: {plain_text(exc, max_characters)}".removesuffix(": ")


def bounded(items: Iterable[Any], most: int, what: str) -> tuple[Any, ...]:
    """The items as a tuple.

    Raises:
        InputError: there are more than `most` items. Further items are not read.
    """
    found = tuple(itertools.islice(items, most + 1))
    if len(found) > most:
        raise InputError(f"there are more than {most} {what}, which is the maximum")
    return found


def cut(value: Any, max_characters: int, max_items: int) -> Any:
    """A copy of a JSON value in which long strings and lists are truncated at every depth."""
    if isinstance(value, str):
        return value[:max_characters]
    if isinstance(value, list | tuple):
        return [cut(each, max_characters, max_items) for each in value[:max_items]]
    if isinstance(value, dict):
        return {name: cut(each, max_characters, max_items) for name, each in value.items()}
    return value


def listed(names: Sequence[str], most: int = 10) -> str:
    """The first names in one printable line, which ends with "and more" if there are others."""
    more = " and more" if len(names) > most else ""
    return ", ".join(printable(name, MAX_NAME) for name in names[:most]) + more


def fixed(value: float, decimals: int) -> str:
    """Format a number with the given number of decimals, or with an exponent if the number is large."""
    return f"{value:z.{decimals}f}" if abs(value) < WIDE else f"{value:.6g}"


def _text(value: object) -> str:
    """The result of `str()`, or a note that it failed."""
    try:
        text = value if isinstance(value, str) else str(value)
        # A subclass of str may override methods.
        return str.__getitem__(text, slice(None))
    except BaseException as exc:  # noqa: BLE001 - whatever a foreign __str__ raises
        return f"(a {_type_name(value)} without a text, because its str() raises {_type_name(exc)})"


def _type_name(value: object) -> str:
    """The name of a value's class, even if the metaclass of the class reports a different name."""
    return printable(type.__dict__["__name__"].__get__(type(value)), MAX_NAME)
