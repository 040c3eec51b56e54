"""Studies whose tasks are the points of a space of parameters, and their answers."""

from __future__ import annotations

import math
from collections.abc import Generator
from functools import cached_property
from statistics import NormalDist
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from cobot.errors import InputError
from cobot.strict import unknown_key
from cobot.studies.chunks import FAILURE, Column, Columns, has_result
from cobot.studies.parameters.search import OptunaSearch, SearchChoice
from cobot.studies.parameters.spaces import Axis, Design, ParameterSpace, Value
from cobot.studies.study import Round, Study

SHOWN_POINTS = 20
"""Maximum number of grid points in an answer. The table contains all of them."""


def wilson(successes: int, tries: int, confidence: float) -> tuple[float, float]:
    """Wilson's score interval of a share (Wilson 1927, doi 10.1080/01621459.1927.10502953).

    Args:
        confidence: probability that the interval contains the true share, between 0 and 1.
    """
    z = NormalDist().inv_cdf(0.5 * (1.0 + confidence))
    share, scale = successes / tries, 1.0 + z * z / tries
    middle = (share + z * z / (2.0 * tries)) / scale
    half = z * math.sqrt(share * (1.0 - share) / tries + z * z / (4.0 * tries * tries)) / scale
    low = 0.0 if successes == 0 else max(0.0, middle - half)
    return low, 1.0 if successes == tries else min(1.0, middle + half)


class SampledStudy(Study):
    """A study over a space of parameters.

    Attributes:
        space: parameters by name.
        samples: number of samples of the random parameters at each point of the grid.
        design: design of the samples: independent, or a design of `scipy.stats.qmc`.
        goal: whether the smallest or the largest value of the metric is the best.
        confidence: confidence level of intervals.
        search: how to search for the best parameters; None means that all points are computed.
    """

    space: Annotated[dict[str, Axis], Field(max_length=50)]
    samples: Annotated[int, Field(ge=1, le=10_000_000)] | None = None
    design: Design = "random"
    goal: Literal["max", "min"] = "max"
    confidence: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.95
    search: SearchChoice | None = None

    parameter_names: ClassVar[tuple[str, ...] | None] = None
    """Names that `space` may contain; None means any."""

    _given: dict[int, dict[str, Value]] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _require_known_parameters(self) -> Self:
        valid = self.parameter_names
        for name in self.space:
            if valid is not None and name not in valid:
                raise ValueError(f"space: {unknown_key(name, list(valid), 'parameter')}")
        return self

    @model_validator(mode="after")
    def _require_no_samples(self) -> Self:
        if self.search is not None and self.samples is not None:
            raise ValueError("samples: has no effect in a search; use search.trials")
        return self

    @property
    def measure(self) -> str:
        """Name of the result that the answer evaluates."""
        raise NotImplementedError

    @property
    def axes(self) -> dict[str, Axis]:
        """All parameters: those in `space`, and those that follow from the other keys of the study."""
        return self.space

    @cached_property
    def points(self) -> ParameterSpace:
        return ParameterSpace.of(self.axes, self.samples, self.design, self.seed)

    @property
    def tasks(self) -> int:
        return self.points.tasks if self.search is None else self.search.trials

    def at(self, task: int) -> dict[str, Value]:
        """All parameters of a task."""
        return self.points.at(task) if self.search is None else self._given[task]

    def rounds(self) -> Generator[Round, Columns, None]:
        if self.search is None:
            yield Round(0, self.tasks, None)
            return
        search = OptunaSearch(self.axes, self.search, self.seed, self.goal)
        for first in range(0, self.tasks, self.search.batch):
            last = min(first + self.search.batch, self.tasks)
            columns = yield Round(first, last, search.ask(last - first))
            values = columns.get(self.measure, np.full(last - first, np.nan))
            search.tell(np.where(has_result(columns), np.asarray(values, dtype=float), np.nan).tolist())

    def take_points(self, first: int, points: list[dict[str, Any]]) -> None:
        self._given = dict(enumerate(points, start=first))

    def parameters(self, first: int, last: int) -> dict[str, Column]:
        """The parameters of these tasks, as columns."""
        rows = [self.at(task) for task in range(first, last)]
        return {name: np.array([row[name] for row in rows]) for name in self.axes}

    def answer(self, columns: Columns) -> dict[str, Any]:
        if self.measure not in columns:
            names = [name for name in columns if name not in {"task", FAILURE, *self.axes}]
            raise InputError(f"metric: {unknown_key(self.measure, names, 'result')}")
        values = columns[self.measure]
        if values.dtype.kind == "U":
            raise InputError(f"metric: {self.measure!r} is a string; it must be a number, or true or false")
        if self.search is not None:
            return self._best_trial(columns)
        points = np.asarray(columns["task"], dtype=np.int64) // self.points.count
        order = np.argsort(points, kind="stable")
        known, begins = np.unique(points[order], return_index=True)
        found = list(zip(known.tolist(), np.split(values[order], begins[1:]), strict=True))
        if values.dtype.kind == "b":
            return self._shares(found)
        return self._numbers(columns, found)

    def _best_trial(self, columns: Columns) -> dict[str, Any]:
        values = np.asarray(columns[self.measure], dtype=float)
        if not np.isfinite(values).any():
            return {self.measure: "no task has a finite value"}
        best = self.best_of(values)
        return self._left_out(values) | {
            f"best {self.measure}": float(values[best]),
            "at": {name: columns[name][best].item() for name in self.axes},
            "trial": int(columns["task"][best]),
        }

    def best_of(self, values: Column) -> int:
        """Index of the best finite value. At least one value must be finite."""
        finite = np.where(np.isfinite(values), values, np.nan)
        return int((np.nanargmax if self.goal == "max" else np.nanargmin)(finite))

    def _left_out(self, values: Column) -> dict[str, Any]:
        """The number of tasks that the answer leaves out because their values are NaN or infinite."""
        count = int(np.count_nonzero(~np.isfinite(np.asarray(values, dtype=float))))
        return {f"tasks without a finite {self.measure}": count} if count else {}

    def _shares(self, found: list[tuple[int, Column]]) -> dict[str, Any]:
        """The share of successes with its interval, in total and at each point of the grid."""
        if len(found) == 1:
            return {self.measure: self._share(found[0][1])}
        # The points use the same samples, so there is no interval for all points together.
        answer: dict[str, Any] = {
            f"mean {self.measure}": float(np.mean(np.concatenate([each for _, each in found])))
        }
        if found:
            order = sorted(found, key=lambda item: -item[1].mean() if self.goal == "max" else item[1].mean())
            for point, each in order[:SHOWN_POINTS]:
                answer[f"{self.measure} at {_words(self.points.at_grid(point))}"] = self._share(each)
        return answer

    def _share(self, values: Column) -> str:
        successes, tries = int(np.count_nonzero(values)), len(values)
        low, high = wilson(successes, tries, self.confidence)
        return (
            f"{successes / tries:.4g} ({successes} of {tries}), "
            f"{100.0 * self.confidence:.4g} % interval {low:.4g} to {high:.4g}"
        )

    def _numbers(self, columns: Columns, found: list[tuple[int, Column]]) -> dict[str, Any]:
        """The distribution of the values, and the point of the grid with the best mean."""
        values = np.asarray(columns[self.measure], dtype=float)
        finite = values[np.isfinite(values)]
        if not len(finite):
            return {self.measure: "no task has a finite value"}
        answer = self._left_out(values) | {
            f"mean {self.measure}": float(finite.mean()),
            "standard deviation": float(finite.std(ddof=1)) if len(finite) > 1 else 0.0,
            "least": float(finite.min()),
            "greatest": float(finite.max()),
        }
        means = [(float(np.asarray(each, float).mean()), point) for point, each in found]
        known = [item for item in means if math.isfinite(item[0])]
        if len(known) > 1:
            best, point = min(known, key=lambda item: (-item[0] if self.goal == "max" else item[0], item[1]))
            answer |= {f"best {self.measure}": best, "at": _words(self.points.at_grid(point))}
        return answer


def _words(values: dict[str, Value]) -> str:
    return ", ".join(
        f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in values.items()
    )
