"""Parametrized tests of which `make test` runs a few cases, and `make test-thorough` the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], count: int = 1) -> list[Any]:
    """The values as cases, those after the first `count` with the marker `thorough`.

    A tuple is a case with a value for each name.
    """
    cases = [case(each) for each in values]
    rest = [each._replace(marks=(*each.marks, pytest.mark.thorough)) for each in cases[count:]]
    return [*cases[:count], *rest]


def case(value: Any) -> Any:
    if hasattr(value, "marks"):
        return value
    return pytest.param(*value) if isinstance(value, tuple) else pytest.param(value)
