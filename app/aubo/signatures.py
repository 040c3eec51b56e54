"""Derives the fields of a vendor service from the function's signature and docstring.

All functions raise a TypeError with the service's name if the service breaks the rules in
`app.aubo.registry`.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

from app.aubo.fields import ROS_TYPES, ServiceField

Function = Callable[..., Any]


def make_field(
    where: str, parameter: inspect.Parameter, function: Function, documented: dict[str, str]
) -> ServiceField:
    """Return the request field for a parameter of a vendor service."""
    name, default = parameter.name, parameter.default
    if name not in documented:
        raise TypeError(f"{where}: its docstring does not describe {name}")
    kind = find_kind(where, name, parameter.annotation, function)
    if kind == "bool" and default is True:
        raise TypeError(
            f"{where}: {name} cannot be True by default, because ROS sends false for an unset field"
        )
    return ServiceField(
        name, kind, documented[name], list(default) if isinstance(default, tuple) else default
    )


def find_kind(where: str, name: str, annotation: Any, function: Function) -> str:
    """Return the kind that an annotation denotes. Other annotations are not evaluated, so `Services` is not
    imported at run time.
    """
    if isinstance(annotation, str):
        annotation = eval(annotation, function.__globals__)
    try:
        return ROS_TYPES[annotation]
    except (KeyError, TypeError):
        valid = ", ".join(sorted(set(ROS_TYPES.values())))
        raise TypeError(f"{where}: {name} is a {annotation}, allowed: {valid}") from None


def parse_docstring(where: str, function: Function) -> tuple[str, dict[str, str], str]:
    """Split a docstring into its introduction, the descriptions of the arguments, and the description of the
    result.
    """
    text = inspect.getdoc(function)
    if not text:
        raise TypeError(f"{where}: has no docstring")
    parts = re.split(r"^(Args|Returns|Raises):\n", text, flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    entries = re.findall(r"^    (\w+): (.*(?:\n(?:     .*)?)*)", sections.get("Args", ""), re.MULTILINE)
    documented = {name: " ".join(described.split()) for name, described in entries}
    return " ".join(parts[0].split()), documented, " ".join(sections.get("Returns", "").split())
