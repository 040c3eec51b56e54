"""The functions of a module and whether they act, for Python and Cython sources."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

Definition = ast.FunctionDef | ast.AsyncFunctionDef

_CYTHON_FUNCTION = re.compile(
    r"^(?P<indent> *)(?:cp?def (?!class )(?P<type>(?:inline )?[\w\s*]*?)|def )[ *]*(?P<name>\w+)\("
)
_SETS = re.compile(r"^\s*(self\.[\w.\[\], ]+|\w+\[0\])( [-+*/]?= |, )")


class Function(NamedTuple):
    """A function of a module.

    Attributes:
        acts: it returns nothing, is a context manager, waits, or sets an attribute.
    """

    name: str
    acts: bool


def functions_of(path: Path) -> Iterator[Function]:
    """All functions and methods of a `.py` or `.pyx` file."""
    source = path.read_text(encoding="utf-8")
    return _python_functions(source) if path.suffix == ".py" else _cython_functions(source)


def _python_functions(source: str) -> Iterator[Function]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, Definition):
            yield Function(node.name, _acts(node))


def _acts(function: Definition) -> bool:
    if isinstance(function, ast.AsyncFunctionDef) or ast.unparse(function.returns or ast.Name("?")) == "None":
        return True
    if any("contextmanager" in ast.unparse(each) for each in function.decorator_list):
        return True
    return any(_is_effect(each) for each in ast.walk(function))


def _is_effect(node: ast.AST) -> bool:
    """An attribute is set, or a method of `self` is called for its effect."""
    if isinstance(node, ast.Assign | ast.AugAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return any(isinstance(each, ast.Attribute) for target in targets for each in ast.walk(target))
    called = node.value if isinstance(node, ast.Expr) else None
    return isinstance(called, ast.Call) and ast.unparse(called.func).startswith(("self.", "os.", "print"))


def _cython_functions(source: str) -> Iterator[Function]:
    lines = source.splitlines()
    for index, line in enumerate(lines):
        found = _CYTHON_FUNCTION.match(line)
        if found is None:
            continue
        body = []
        for each in lines[index + 1 :]:
            if each.strip() and not each.startswith((found["indent"] + " ", found["indent"] + ")")):
                break
            body.append(each)
        returns = any(re.match(r"\s*return \S", each) for each in body)
        is_declared = "void" in (found["type"] or "")
        yield Function(found["name"], is_declared or not returns or any(map(_SETS.match, body)))
