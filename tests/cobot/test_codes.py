"""The table of codes.

Oracle: the error tree of `cobot.errors` as Python sees it; docs/services.md as text.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cobot import errors
from cobot.codes import ERROR_OF, MEANINGS, OF_ERROR, Code, code_of
from cobot.errors import CobotError

DOCUMENT = Path(__file__).parents[2] / "docs" / "services.md"


def test_every_error_of_the_tree_has_a_code_of_its_own() -> None:
    tree = {each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, CobotError)}
    assert set(OF_ERROR) == tree
    assert len(set(OF_ERROR.values())) == len(tree)
    assert all(ERROR_OF[int(code)] is kind for kind, code in OF_ERROR.items())


def test_the_words_of_the_rest_api_and_of_streams_are_the_names_of_the_codes() -> None:
    for kind, code in OF_ERROR.items():
        assert kind.code == code.name.lower()


def test_every_code_has_a_meaning_and_only_success_is_zero() -> None:
    assert set(MEANINGS) == set(Code)
    assert [code for code in Code if code <= 0] == [Code.OK]


def test_the_table_in_the_documentation_is_this_one() -> None:
    rows = re.findall(r"^\| (\d+) \| (\w+) \| (.+) \|$", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)
    assert rows == [(str(int(code)), code.name, MEANINGS[code]) for code in Code]


@pytest.mark.parametrize("kind", list(OF_ERROR))
def test_an_error_is_answered_with_the_code_of_its_class(kind: type[CobotError]) -> None:
    class Special(kind):  # type: ignore[misc, valid-type]
        pass

    assert code_of(kind("why")) == code_of(Special("why")) == OF_ERROR[kind]
