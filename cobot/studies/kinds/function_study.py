"""A study that calls any pure Python function."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from cobot.errors import ConfigError, InputError
from cobot.foreign import plain_error
from cobot.strict import unknown_key
from cobot.studies.chunks import FAILURE, Column, Columns
from cobot.studies.parameters.sampled import SampledStudy
from cobot.studies.parameters.spaces import seed_of
from cobot.studies.robot_choice import hash_of_file
from cobot.studies.study import Kernel

SEED = "seed"
MAX_REASON = 300


class FunctionStudy(SampledStudy):
    """Calls a function once for each point. The point's parameters are passed to the function by name.

    Attributes:
        function: FILE.py:NAME, relative to the study, or MODULE:NAME. It returns a number, true or false, or
            a mapping from names to numbers, booleans or strings. If the function has a parameter `seed` that
            is not in the space, it gets a different integer for each task.
        metric: name of a result. If the function returns a single value, its name is `value`.
    """

    kind: Literal["python"]
    function: Annotated[str, Field(pattern=r"^[^:]+:[A-Za-z_]\w*$")]
    metric: str = "value"

    @property
    def measure(self) -> str:
        return self.metric

    @property
    def _parts(self) -> tuple[str, str]:
        module, _, name = self.function.rpartition(":")
        return module, name

    @property
    def _path(self) -> Path | None:
        """The file with the function; None if the function is in an importable module."""
        module, _ = self._parts
        return self.folder / module if module.endswith(".py") else None

    def contents(self) -> dict[str, str]:
        path = self._path
        if path is None:
            spec = self._spec()
            path = None if spec is None or spec.origin is None else Path(spec.origin)
        if path is None or not path.is_file():
            raise ConfigError(f"function: {self._parts[0]}: no such {'file' if self._path else 'module'}")
        return {"function": hash_of_file(path)}

    def _spec(self) -> Any:
        try:
            return importlib.util.find_spec(self._parts[0])
        except (ImportError, ValueError):
            return None

    @cached_property
    def _function(self) -> Callable[..., Any]:
        module, name = self._parts
        try:
            loaded = importlib.import_module(module) if self._path is None else _load(self._path)
        except Exception as exc:
            raise ConfigError(f"function: {module} cannot be imported: {plain_error(exc)}") from exc
        found = getattr(loaded, name, None)
        if not callable(found):
            names = [each for each, value in vars(loaded).items() if inspect.isfunction(value)]
            raise ConfigError(f"function: {module}: {unknown_key(name, names, 'function')}")
        return found  # type: ignore[no-any-return]

    def kernel(self) -> Kernel:
        self.contents()
        function, seeded = self._function, self._takes_seed()

        def compute(first: int, last: int) -> Columns:
            rows = [self._row(function, task, seeded) for task in range(first, last)]
            return {**self.parameters(first, last), **_columns(rows)}

        return compute

    def _takes_seed(self) -> bool:
        """Whether the function has a parameter for a seed.

        Raises:
            InputError: the parameters of the function do not match the space.
        """
        try:
            signature = inspect.signature(self._function)
        except (TypeError, ValueError):  # the function is compiled
            return False
        names = set(signature.parameters)
        seeded = SEED in names and SEED not in self.space
        try:
            signature.bind(**dict.fromkeys([*self.space, *([SEED] if seeded else [])], 0))
        except TypeError as exc:
            raise InputError(
                f"function: {self.function}{signature} cannot be called with the parameters of the space "
                f"({', '.join(self.space)}): {exc}"
            ) from exc
        return seeded

    def _row(self, function: Callable[..., Any], task: int, seeded: bool) -> dict[str, Any]:
        parameters: dict[str, Any] = dict(self.at(task))
        if seeded:
            parameters[SEED] = seed_of(self.seed, task)
        try:
            found = function(**parameters)
        except BaseException as exc:  # noqa: BLE001 - a foreign function may raise anything; the others go on
            return {FAILURE: plain_error(exc, MAX_REASON)}
        return self._checked(found)

    def _checked(self, found: Any) -> dict[str, Any]:
        results = dict(found) if isinstance(found, Mapping) else {"value": found}
        for name, value in results.items():
            if reason := self._objection(name, value):
                return {FAILURE: f"result {name!r}: {reason}"}
        return results

    def _objection(self, name: Any, value: Any) -> str:
        """The reason why a result cannot be stored; "" if it can be stored."""
        if not isinstance(name, str) or not name or name in {*self.space, "task", FAILURE}:
            return "is the name of a parameter or not a valid name; return another one"
        if not isinstance(value, bool | np.bool_ | str | Real):
            return f"is a {type(value).__name__}; it must be a number, bool or text"
        if isinstance(value, int) and abs(value) > sys.float_info.max:
            return f"is an integer with {value.bit_length()} bits, which is too large for a float"
        return ""


def _columns(rows: list[dict[str, Any]]) -> dict[str, Column]:
    """The results of the calls as columns. A value that a call did not return is NaN, false or ""."""
    names = sorted({name for row in rows for name in row})
    return {name: _column(name, [row.get(name) for row in rows]) for name in names}


def _column(name: str, values: list[Any]) -> Column:
    given = [value for value in values if value is not None]
    if all(isinstance(value, str) for value in given):
        return np.array(["" if value is None else value for value in values])
    if all(isinstance(value, bool | np.bool_) for value in given):
        return np.array([bool(value) for value in values])
    if any(isinstance(value, str) for value in given):
        raise InputError(f"result {name!r}: is a string in some calls and a number in others")
    return np.array([np.nan if value is None else float(value) for value in values])


def _load(path: Path) -> Any:
    """Load a file as a module, although it belongs to no package. The file may import other files in its
    folder.
    """
    spec = importlib.util.spec_from_file_location(f"study_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    spec.loader.exec_module(module)
    return module
