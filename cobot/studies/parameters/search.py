"""Search for the best parameters with Optuna, in rounds. Each round asks for trials, and learns from their
values.

The trials of a round depend only on the seed and on earlier rounds, so they are the same for any number of
workers. A run that continues an earlier one gets the same trials again.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Annotated, Any, Literal

from pydantic import Field

from cobot.errors import InputError, NotSupportedError
from cobot.strict import StrictModel
from cobot.studies.parameters.spaces import Axis, Value

MAX_TRIALS = 1_000_000


class SearchChoice(StrictModel):
    """The settings of a search.

    Attributes:
        sampler: tpe: tree-structured Parzen estimators, for all kinds; cmaes: CMA-ES, for numbers; random.
        trials: number of tasks.
        batch: number of trials in a round. If it is at least the number of workers, all of them are busy.
    """

    sampler: Literal["tpe", "cmaes", "random"] = "tpe"
    trials: Annotated[int, Field(ge=1, le=MAX_TRIALS)]
    batch: Annotated[int, Field(ge=1, le=10_000)] = 8


class OptunaSearch:
    """A search that is held in the memory of this process.

    Raises:
        NotSupportedError: Optuna is not installed.
        InputError: an axis is not a range.
    """

    def __init__(
        self, axes: Mapping[str, Axis], choice: SearchChoice, seed: int, goal: Literal["max", "min"]
    ) -> None:
        for package in ("optuna", "cmaes"):
            if find_spec(package) is None:
                raise NotSupportedError(f"search needs {package}; install cobot[study]")
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self._failed: Any = optuna.trial.TrialState.FAIL
        self._axes = {name: _distribution(optuna, name, axis) for name, axis in axes.items()}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about options that Optuna calls experimental
            self._study: Any = optuna.create_study(
                direction="maximize" if goal == "max" else "minimize",
                sampler=_sampler(optuna, choice, seed % 2**32),
            )
        self._asked: list[Any] = []

    def ask(self, count: int) -> list[dict[str, Value]]:
        """The parameters of the next trials."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # CMA-ES reports categorical parameters, which it draws at random
            self._asked = [self._study.ask(self._axes) for _ in range(count)]
        return [dict(trial.params) for trial in self._asked]

    def tell(self, values: Sequence[float]) -> None:
        """Report the values of the trials that the last call of `ask` returned, in the same order. The value
        of a failed trial is NaN.
        """
        for trial, value in zip(self._asked, values, strict=True):
            if math.isfinite(value):
                self._study.tell(trial, value)
            else:
                self._study.tell(trial, state=self._failed)


def _sampler(optuna: Any, choice: SearchChoice, seed: int) -> Any:
    if choice.sampler == "tpe":
        return optuna.samplers.TPESampler(seed=seed, constant_liar=choice.batch > 1)
    if choice.sampler == "cmaes":
        return optuna.samplers.CmaEsSampler(seed=seed)
    return optuna.samplers.RandomSampler(seed=seed)


def _distribution(optuna: Any, name: str, axis: Axis) -> Any:
    if axis.uniform is not None:
        return optuna.distributions.FloatDistribution(*axis.uniform)
    if axis.normal is not None:
        raise InputError(
            f"space.{name}: is of kind normal; a search needs uniform [low, high], values, or low, "
            "high, count"
        )
    if axis.values is None and axis.low is not None and axis.high is not None and (axis.count or 0) > 1:
        step = (axis.high - axis.low) / ((axis.count or 2) - 1)
        return optuna.distributions.FloatDistribution(axis.low, axis.high, step=step)
    return optuna.distributions.CategoricalDistribution(axis.grid())
