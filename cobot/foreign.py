"""Text, iterators and numbers of devices, files and programs, made safe to keep, to print and to send.

Their `str()` may raise or return something else, their text may be a megabyte of escape sequences, an
iterator may never end, and a number may have 300 digits.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

from cobot.errors import InputError
from cobot.logs.lines import MAX_MESSAGE, printable

MAX_NAME = 80
WIDE = 1e7
"""A number from here on is written with an exponent: nobody counts its digits."""


def plain_text(value: object, max_characters: int = MAX_MESSAGE) -> str:
    """The text of any object in one printable line; a longer text is cut, with a note of its length."""
    try:
        text = value if isinstance(value, str) else str(value)
        # A subclass of str may have methods of its own.
        return printable(str.__getitem__(text, slice(None)), max_characters)
    except BaseException as exc:  # noqa: BLE001 - whatever a foreign __str__ raises
        return f"(a {_type_name(value)} without text: its str() raises {_type_name(exc)})"


def plain_error(exc: BaseException, max_characters: int = MAX_MESSAGE) -> str:
    """Type and text of an exception."""
    return f"{_type_name(exc)}: {plain_text(exc, max_characters)}".removesuffix(": ")


def bounded(items: Iterable[Any], most: int, what: str) -> tuple[Any, ...]:
    """All of them.

    Raises:
        InputError: there are more than this; no more are taken.
    """
    found = tuple(itertools.islice(items, most + 1))
    if len(found) > most:
        raise InputError(f"more than {most} {what}, at most {most} are allowed")
    return found


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, or with an exponent where that would be wide."""
    return f"{value:z.{decimals}f}" if abs(value) < WIDE else f"{value:.6g}"


def _type_name(value: object) -> str:
    """The name of its class, which a metaclass cannot make up."""
    return printable(type.__dict__["__name__"].__get__(type(value)), MAX_NAME)
