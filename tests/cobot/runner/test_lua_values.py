"""What crosses between Lua and Python. Oracle: Lua's own literals, evaluated by lupa, and JSON."""

from __future__ import annotations

import math
from typing import Any

import pytest
from lupa.lua53 import LuaRuntime

from cobot.errors import InputError
from cobot.runner.lua_values import DEEPEST, kind, lua, number, numbers, plain, text

LUA = LuaRuntime(encoding=None)


def value(literal: str) -> Any:
    return LUA.eval(literal.encode())


@pytest.mark.parametrize(
    ("literal", "expected"),
    [
        ("nil", None),
        ("true", True),
        ("2^53", 2.0**53),
        ("3", 3),
        ("'é'", "é"),
        ("{1, {2, 'x'}, {a = {b = false}}}", [1, [2, "x"], {"a": {"b": False}}]),
        ("{}", []),
    ],
)
def test_data_is_as_json_knows_it_both_ways(literal: str, expected: Any) -> None:
    found = plain(value(literal), "it")
    assert found == expected
    assert type(found) is type(expected)
    back = lua(expected, lambda items: LUA.table_from(items, recursive=True))
    assert plain(back, "it") == expected


@pytest.mark.parametrize(
    ("literal", "sentence"),
    [
        ("print", "it must be data, got a function"),
        ("{[1] = 1, [3] = 3}", "it must have either the keys 1, 2, 3 ... or strings as keys"),
        ("{1, a = 2}", "it must have either the keys"),
        ("{[true] = 1}", "it must have either the keys"),
        ("'\\xff'", "it is not UTF-8 text"),
        (
            "(function() local t = {}; t[1] = t; return t end)()",
            f"it is nested more than {DEEPEST} levels deep",
        ),
    ],
)
def test_what_is_no_data_is_refused(literal: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        plain(value(literal), "it")
    assert str(caught.value).startswith(sentence)


def test_lists_of_numbers_have_their_count() -> None:
    assert numbers(value("{1, 2.5}"), "q", 2) == [1.0, 2.5]
    for literal, sentence in (
        ("{1}", r"q must be a table of 2 numbers, got a table"),
        ("7", r"q must be a table of 2 numbers, got a number"),
        ("{1, 'x'}", r"q\[2\] must be a number, got a string"),
        ("{1, 0/0}", r"q\[2\] is -?nan, allowed: finite numbers"),
    ):
        with pytest.raises(InputError, match=sentence):
            numbers(value(literal), "q", 2)


def test_numbers_and_texts_are_what_they_have_to_be() -> None:
    assert number(value("3"), "v", 0.0, 3.0) == 3.0
    assert text(value("'x'"), "name") == "x"
    for wrong in (True, None, b"3"):
        with pytest.raises(InputError, match="v must be a number"):
            number(wrong, "v")
    for wide in (-0.1, 3.1, math.inf):
        with pytest.raises(InputError, match="allowed: finite numbers from 0 to 3"):
            number(wide, "v", 0.0, 3.0)
    with pytest.raises(InputError, match="name must be a string, got a number"):
        text(3, "name")


def test_kinds_have_luas_names() -> None:
    for literal in ("nil", "true", "3", "'x'", "{}", "print"):
        name = LUA.eval(f"type({literal})".encode()).decode()
        assert kind(plain(value(literal), "it") if literal != "print" else value(literal)).endswith(name)
