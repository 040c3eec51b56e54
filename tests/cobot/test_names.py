"""Names in the library. Oracle: its own syntax trees."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import cobot

FOLDER = Path(cobot.__file__).parent
PROGRAMS = ("dds", "learning", "recorder", "runner")
"""Their names are their own: no other part of the library imports them."""


def test_no_two_classes_of_the_library_have_one_name() -> None:
    places: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted(FOLDER.rglob("*.py")):
        if path.relative_to(FOLDER).parts[0] in PROGRAMS:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.relative_to(FOLDER)}:{node.lineno}")
    assert len(places) > 100  # the walk has seen the library
    assert {name: found for name, found in places.items() if len(found) > 1} == {}
