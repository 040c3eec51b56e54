"""Converts values between Lua and Python: single values, strings as UTF-8, and tables as lists and
dictionaries.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import islice
from typing import Any

from lupa.lua53 import lua_type

from cobot.errors import InputError

DEEPEST = 16
MAX_ITEMS = 1_000_000


def text(value: object, name: str) -> str:
    """Convert a Lua string to text.

    Raises:
        InputError: the value is not a string, or not UTF-8.
    """
    if not isinstance(value, bytes):
        raise InputError(f"{name} must be a string, got {kind(value)}")
    try:
        return value.decode("utf-8")
    except UnicodeDecodeError as exc:
        raise InputError(f"{name} is not UTF-8 text: {exc.reason} at byte {exc.start + 1}") from exc


def number(value: object, name: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Check that a value is a finite Lua number within [low, high].

    Raises:
        InputError: the value is not such a number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} must be a number, got {kind(value)}")
    if not math.isfinite(value) or not low <= value <= high:
        raise InputError(f"{name} is {value:g}, allowed: finite numbers from {low:g} to {high:g}")
    return float(value)


def numbers(value: object, name: str, count: int | None = None) -> list[float]:
    """Convert a Lua table to a list of finite numbers.

    Raises:
        InputError: the value is not a table of numbers, or has the wrong number of items.
    """
    items = plain(value, name)
    if not isinstance(items, list) or (count is not None and len(items) != count):
        much = "numbers" if count is None else f"{count} numbers"
        raise InputError(f"{name} must be a table of {much}, got {kind(value)}")
    return [number(item, f"{name}[{index}]") for index, item in enumerate(items, start=1)]


def plain(value: Any, name: str) -> Any:
    """Convert a Lua value to JSON. A table with the keys 1 to n becomes a list, and a table with strings as
    keys becomes a dictionary.

    Raises:
        InputError: the value is a function, a table with other keys, or a table that contains itself.
    """
    return _plain(value, name, DEEPEST, [MAX_ITEMS])


def _plain(value: Any, name: str, depth: int, room: list[int]) -> Any:
    if value is None or isinstance(value, bool | int | float):
        return value
    if isinstance(value, bytes):
        return text(value, name)
    if lua_type(value) != "table":
        raise InputError(f"{name} must be data, got {kind(value)}")
    if depth == 0:
        raise InputError(f"{name} is nested more than {DEEPEST} levels deep")
    items = dict(islice(value.items(), room[0] + 1))
    room[0] -= len(items)
    if room[0] < 0:
        raise InputError(f"{name} has more than {MAX_ITEMS} items")
    if all(isinstance(key, bytes) for key in items) and items:
        return {text(key, name): _plain(item, name, depth - 1, room) for key, item in items.items()}
    if not all(type(key) is int for key in items) or set(items) != set(range(1, len(items) + 1)):
        raise InputError(f"{name} must have either the keys 1, 2, 3 ... or strings as keys")
    return [_plain(items[index], name, depth - 1, room) for index in range(1, len(items) + 1)]


def lua(value: Any, table: Callable[[Any], Any]) -> Any:
    """Convert JSON to a Lua value. `table` converts a list or a dictionary to a table."""
    if isinstance(value, str):
        return value.encode("utf-8", "surrogatepass")
    if isinstance(value, dict):
        return table({key.encode("utf-8", "surrogatepass"): lua(item, table) for key, item in value.items()})
    if isinstance(value, list):
        return table([lua(item, table) for item in value])
    return value


def kind(value: object) -> str:
    """Lua's name for the type of a value."""
    if value is None:
        return "nil"
    if isinstance(value, bytes | str):
        return "a string"
    if isinstance(value, list | dict):
        return "a table"
    if isinstance(value, bool):
        return "a boolean"
    return "a number" if isinstance(value, int | float) else f"a {lua_type(value) or type(value).__name__}"
