"""The tree of errors. Oracle: the drawing on top of the file."""

from __future__ import annotations

import re

from cobot import errors
from cobot.errors import CobotError


def drawn() -> dict[str, str]:
    """Each class with its base, as the drawing has them."""
    found: dict[str, str] = {}
    above: list[str] = ["CobotError"]
    for line in (errors.__doc__ or "").splitlines():
        match = re.match(r"([│ ]*)[├└]── (\w+)", line)
        if match:
            depth = len(match[1]) // 4 + 1
            found[match[2]] = above[depth - 1]
            above[depth:] = [match[2]]
    return found


def family() -> list[type[CobotError]]:
    known, found = [CobotError], []
    while known:
        kind = known.pop()
        found.append(kind)
        known += [each for each in kind.__subclasses__() if each.__module__ == errors.__name__]
    return found


def test_the_tree_is_as_it_is_drawn() -> None:
    bases = {kind.__name__: kind.__bases__[0].__name__ for kind in family() if kind is not CobotError}
    assert bases == drawn()


def test_each_error_has_a_code_of_its_own() -> None:
    codes = [kind.code for kind in family()]
    assert len(set(codes)) == len(codes) > 20
    assert all(re.fullmatch("[a-z_]+", code) for code in codes)
