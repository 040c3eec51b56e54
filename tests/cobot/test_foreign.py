"""Foreign text, iterators and numbers. Oracles: `str.isprintable`, and the lengths that are asked for."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot.errors import InputError
from cobot.foreign import (
    MAX_LINE,
    MAX_LINES,
    bounded,
    cut,
    fixed,
    joined_text,
    listed,
    plain_error,
    plain_lines,
    plain_text,
)


class Sly(str):
    """A text that answers no question about itself."""

    def __getitem__(self, index: object) -> str:
        raise SystemExit

    def isprintable(self) -> bool:
        return True


class Meta(type):
    @property
    def __name__(cls) -> str:  # type: ignore[override]
        raise SystemExit


class Nameless(Exception, metaclass=Meta):
    pass


@given(st.text(st.characters(exclude_categories=[])), st.integers(1, 50))
def test_any_text_is_printable_and_bounded(text: str, most: int) -> None:
    for each in (text, Sly(text), OSError(text)):
        found = plain_text(each, most)
        assert found.isprintable()
        found.encode()
        assert len(found) <= most + len(f"... ({10 * len(text)} characters)")


def test_a_class_without_a_name_and_a_text_that_answers_nothing() -> None:
    assert plain_error(Nameless("gone")) == "Nameless: gone"
    assert plain_text(Sly("a\x07b")) == r"a\x07b"
    assert plain_error(ValueError()) == "ValueError"


def test_lines_are_kept_printed_and_bounded() -> None:
    assert plain_lines("one\n\x1b[31mtwo", "> ") == "one\n> \\x1b[31mtwo"
    assert plain_lines(Nameless("gone\ud800")) == r"gone\ud800"
    many = plain_lines("x\n" * 1_000_000).split("\n")
    assert (len(many), many[-1]) == (MAX_LINES + 1, "... (1000001 lines)")
    (wide,) = plain_lines("x" * 10_000_000).split("\n")
    assert len(wide) < MAX_LINE + 100


def test_lines_that_are_to_be_one_are_joined_by_spaces() -> None:
    assert joined_text(" a\n\tb \x00\n") == r"a b \x00"
    assert len(joined_text("a\n" * 5_000_000, 100)) < 150


def test_a_json_value_is_cut_at_any_depth() -> None:
    value = {"a": ["xyz", ["x", 1, None]], "b": ("yz", 2.0, True)}
    assert cut(value, 2, 2) == {"a": ["xy", ["x", 1]], "b": ["yz", 2.0]}


def test_a_list_of_names_is_bounded() -> None:
    assert listed(["a", "b\n", "c"], 3) == "a, b\\n, c"
    assert listed(["a", "b", "c", "d"], 2) == "a, b and more"
    assert len(listed(["x" * 1000] * 1000)) < 2000


def test_an_endless_iterator_is_an_error_with_the_limit() -> None:
    assert bounded(iter("ab"), 2, "letters") == ("a", "b")
    with pytest.raises(InputError, match="there are more than 2 letters, which is the maximum"):
        bounded(itertools.repeat("a"), 2, "letters")


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (3.14159, "3.14"),
        (-1e300, "-1e+300"),
        (1e7, "1e+07"),
        (9999999.0, "9999999.00"),
        (float("nan"), "nan"),
    ],
)
def test_no_number_is_wide(value: float, said: str) -> None:
    assert fixed(value, 2) == said
