"""A hook of schemathesis: no stop that takes the drives off, and no input, output or gripper, which this
robot does not have; in its coverage phase, what says something new.

It writes 250 requests for each endpoint, which say the same again and again: five wrong types of each
field, and each field of a motion, a pose or a constraint once more wherever a request has one within. Here
each thing is said once of each field of each request, and once in all of what lies deeper, which the requests
share.
"""

from __future__ import annotations

import re

import schemathesis
from schemathesis.generation.meta import CoveragePhaseData

FIELD = "/properties/"
NESTED = "Object with valid"
said: set[tuple[str | None, ...]] = set()


def saying(label: str, case: CoveragePhaseData) -> tuple[str | None, ...]:
    """What a case says: of an endpoint, or of a field within others, whatever they are."""
    location = case.location or ""
    deep = location.count(FIELD) + case.description.count(NESTED) > 1
    place, what = location.split("/")[-3:], re.split(": | -> ", case.description)[-2:]
    return (None if deep else label, case.scenario, case.parameter, "/".join(place), ": ".join(what))


def names_missing_part(content: object) -> bool:
    """Whether a body names an input, an output or a gripper. The robot has none, so the answer is 501."""
    if isinstance(content, dict):
        return any(content.get(key) for key in ("set", "input", "gripper")) or names_missing_part(
            list(content.values())
        )
    return isinstance(content, list) and any(map(names_missing_part, content))


@schemathesis.hook
def filter_case(context: schemathesis.HookContext, case: schemathesis.Case) -> bool:
    if case.operation.path.endswith("/stop") and "1" in str((case.query or {}).get("category")):
        return False  # the drives go off, and until a reset all that would move or plan is refused
    if names_missing_part(case.body):
        return False
    if case.meta is None or not isinstance(case.meta.phase.data, CoveragePhaseData):
        return True
    new = (case.meta.generation.mode, *saying(case.operation.label, case.meta.phase.data))
    known = new in said
    said.add(new)
    return not known
