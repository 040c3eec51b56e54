"""Names of classes. Oracle: the sources."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("cobot", "rtloop", "app")
SHARED = ("ToyArm", "ToyDevice", "ToyOptions", "ToyRig")
"""Names in the templates of `cobot backend new` and `cobot gripper new`. Each template becomes a package of
its own."""
_COMPILED = re.compile(r"^(?:cdef class|class|cpdef enum) (\w+)", re.MULTILINE)


def classes_of(path: Path) -> set[str]:
    """The public classes of a module; what only compiled code sees is not public."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        names = {node.name for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)}
    else:
        names = set(_COMPILED.findall(source))
    return {name for name in names if not name.startswith("_")}


def places_of_names() -> dict[str, list[str]]:
    """The modules that have a class of each name. A `.pyx` and its `.pxd` are one module."""
    places: defaultdict[str, set[str]] = defaultdict(set)
    for package in PACKAGES:
        for kind in ("py", "pyx", "pxd"):
            for path in (ROOT / package).rglob(f"*.{kind}"):
                for name in classes_of(path):
                    places[name].add(str(path.relative_to(ROOT).with_suffix("")))
    return {name: sorted(found) for name, found in places.items()}


def test_no_two_public_classes_have_one_name() -> None:
    places = places_of_names()
    assert len(places) > 500  # the walk has seen the packages
    twice = {name: found for name, found in places.items() if len(found) > 1}
    assert {name: found for name, found in twice.items() if name not in SHARED} == {}
    assert [name for name in SHARED if name not in twice] == [], (
        "these are unique now: take them off the list"
    )
