"""Names of classes. Oracle: the sources."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("cobot", "rtloop", "app")
PROGRAMS = ("dds", "learning", "recorder", "runner")
"""Parts of `cobot` with names of their own: no other part of the library imports them."""
TWICE = """
Action ActionResult Answer Arm Assembly Caller Cell Channel Channels Client Clock Command Condition
Connection Contact Control Course Device Endpoint Entry Event Feed Field Fragment Function Gateway
Goal Graph Header Heard Hold Holder Inbox Joint JointStates JointTarget Kind Limits Losses Node Observer
Offset Origin Pace Path PayloadError Plan PoseTarget Progress Publisher Rejected Run Sample
Service Session Shape Signals SimulatedArm Statistics Status Steps Stop Subscribe Subscription
Target Times Timing ToyArm ToyDevice ToyOptions ToyRig Wanted Watch
"""
"""Names that several packages had when this list was made. It only gets shorter."""
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


def test_no_two_classes_of_the_library_have_one_name() -> None:
    places = places_of_names()
    assert len(places) > 500  # the walk has seen the packages
    library = {
        name: [each for each in found if each.startswith("cobot/") and each.split("/")[1] not in PROGRAMS]
        for name, found in places.items()
    }
    assert {name: found for name, found in library.items() if len(found) > 1} == {}


def test_no_other_name_is_given_twice() -> None:
    twice = {name: found for name, found in places_of_names().items() if len(found) > 1}
    assert {name: found for name, found in twice.items() if name not in TWICE.split()} == {}
    assert [name for name in TWICE.split() if name not in twice] == [], (
        "these are unique now: take them off the list"
    )
