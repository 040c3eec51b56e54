"""Spaces of parameters: axes of a grid, and random parameters that are drawn for each point of the grid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from statistics import NormalDist
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from cobot.errors import InputError
from cobot.strict import StrictModel
from cobot.studies.study import MAX_TASKS
from cobot.types import Array

Value = float | str | bool
Real = Annotated[float, Field(allow_inf_nan=False)]
Design = Literal["random", "sobol", "halton", "latin"]
QMC = {"sobol": "Sobol", "halton": "Halton", "latin": "LatinHypercube"}
"""Classes of `scipy.stats.qmc`, by the name of the design."""
INSIDE = 2.0**-53
"""Minimum distance of a share from 0 and 1, because at these values the inverse of a normal distribution is
infinite.
"""


class Axis(StrictModel):
    """One parameter: an axis of the grid (`values`, or `low`, `high` and `count`), or a random parameter
    (`uniform`: low and high, or `normal`: mean and standard deviation).
    """

    values: Annotated[list[Real] | list[str] | list[bool], Field(min_length=1, max_length=100_000)] | None = (
        None
    )
    low: Real | None = None
    high: Real | None = None
    count: Annotated[int, Field(ge=1, le=100_000)] | None = None
    uniform: Annotated[list[Real], Field(min_length=2, max_length=2)] | None = None
    normal: Annotated[list[Real], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _require_one(self) -> Self:
        given = [name for name in ("values", "uniform", "normal") if getattr(self, name) is not None]
        steps = [name for name in ("low", "high", "count") if getattr(self, name) is not None]
        if len(given) + bool(steps) != 1 or len(steps) not in (0, 3):
            raise ValueError(
                "must have one of: values; low, high and count; uniform [low, high]; "
                f"normal [mean, deviation]; got {', '.join(given + steps) or 'nothing'}"
            )
        if self.uniform is not None and self.uniform[0] > self.uniform[1]:
            raise ValueError(
                f"uniform: low is {self.uniform[0]:g}; it must be at most high, {self.uniform[1]:g}"
            )
        if self.normal is not None and self.normal[1] < 0.0:
            raise ValueError(f"normal: the standard deviation is {self.normal[1]:g}; it must not be negative")
        return self

    @property
    def is_random(self) -> bool:
        return self.uniform is not None or self.normal is not None

    def grid(self) -> list[Value]:
        """The values of an axis of the grid."""
        if self.values is not None:
            return [float(value) if type(value) is int else value for value in self.values]
        assert self.low is not None
        assert self.high is not None
        assert self.count is not None
        return [float(value) for value in np.linspace(self.low, self.high, self.count)]

    def at(self, shares: Array) -> Array:
        """The values of a random parameter, calculated with the inverse of its distribution function. Shape:
        (n,).
        """
        if self.uniform is not None:
            low, high = self.uniform
            return low + (high - low) * shares
        assert self.normal is not None
        mean, deviation = self.normal
        inverse = NormalDist().inv_cdf
        return np.array([mean + deviation * inverse(float(share)) for share in shares])


@dataclass(frozen=True, slots=True)
class ParameterSpace:
    """All points of a space: each point of the grid, combined with each sample of the random parameters.

    The same samples are used at each point of the grid, so that the points can be compared.
    """

    grid: dict[str, list[Value]]
    samples: dict[str, Array]
    count: int

    @classmethod
    def of(cls, axes: Mapping[str, Axis], samples: int | None, design: Design, seed: int) -> Self:
        """Create the space that the given axes span.

        Raises:
            InputError: `samples` is missing or has no effect, or there are too many points.
        """
        random = {name: axis for name, axis in axes.items() if axis.is_random}
        if random and samples is None:
            raise InputError(
                f"samples: is missing, but {next(iter(random))} is random; give the number of samples"
            )
        count = samples or 1
        if design == "sobol" and count & (count - 1):
            near = 2 ** (count.bit_length() - 1)
            raise InputError(f"samples: is {count}; sobol needs a power of two, such as {near} or {2 * near}")
        grid = {name: axis.grid() for name, axis in axes.items() if not axis.is_random}
        points = count * math.prod(len(values) for values in grid.values())
        if points > MAX_TASKS:
            raise InputError(f"space: has {points} points, allowed: {MAX_TASKS}")
        shares = np.clip(_shares(design, len(random), count, seed), INSIDE, 1.0 - INSIDE)
        drawn = {name: axis.at(shares[:, index]) for index, (name, axis) in enumerate(random.items())}
        return cls(grid, drawn, count)

    @property
    def points_of_grid(self) -> int:
        return math.prod(len(values) for values in self.grid.values())

    @property
    def tasks(self) -> int:
        return self.count * self.points_of_grid

    def at_grid(self, number: int) -> dict[str, Value]:
        """The values at a point of the grid. The last axis changes fastest."""
        found = {}
        for name in reversed(self.grid):
            number, index = divmod(number, len(self.grid[name]))
            found[name] = self.grid[name][index]
        return {name: found[name] for name in self.grid}

    def at(self, task: int) -> dict[str, Value]:
        """All parameters of a task."""
        number, sample = divmod(task, self.count)
        return self.at_grid(number) | {name: float(values[sample]) for name, values in self.samples.items()}


def _shares(design: Design, axes: int, count: int, seed: int) -> Array:
    """Points of the unit cube, shape (count, axes)."""
    if not axes:
        return np.zeros((count, 0))
    generator = np.random.default_rng(seed)
    if design == "random":
        return generator.random((count, axes))
    sampler: Any = getattr(import_module("scipy.stats.qmc"), QMC[design])(axes, rng=generator)
    return np.asarray(sampler.random(count))


def seed_of(seed: int, task: int) -> int:
    """A seed for the random numbers of one task. It depends only on `seed` and the number of the task."""
    return int(np.random.SeedSequence([seed, task]).generate_state(1, np.uint64)[0] >> 1)
