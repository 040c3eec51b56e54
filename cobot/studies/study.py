"""The base of all kinds of studies."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import ConfigDict, Field, PrivateAttr

from cobot.strict import StrictModel
from cobot.studies.chunks import Columns

Kernel = Callable[[int, int], Columns]
"""Function that computes the results of the tasks from the first number up to the second (exclusive).

A worker keeps the function, so it may hold models. It must be pure: the same tasks always give the same
results.
"""
MAX_TASKS = 100_000_000


class Round(NamedTuple):
    """Tasks that can be computed in any order: from `first` up to `last` (exclusive).

    Attributes:
        points: parameters of each task, if they depend on the results of earlier rounds.
    """

    first: int
    last: int
    points: list[dict[str, Any]] | None


class Study(StrictModel):
    """A question, a space of parameters, a seed and a metric. It is validated when it is created.

    Attributes:
        first_chunk: number of tasks in the first chunk; later ones follow from the measured rate.
        maps: whether the results are places in space, which `cobot study show` draws.
    """

    model_config = ConfigDict(frozen=True, defer_build=True)
    first_chunk: ClassVar[int] = 1
    maps: ClassVar[bool] = False

    question: Annotated[str, Field(min_length=1, max_length=500)]
    kind: str
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    _document: dict[str, Any] = PrivateAttr(default_factory=dict)
    _folder: Path = PrivateAttr(default_factory=Path)

    @property
    def document(self) -> dict[str, Any]:
        """The study as it is written in its file."""
        return self._document

    @property
    def folder(self) -> Path:
        """The folder for relative paths in the file."""
        return self._folder

    def keep_source(self, document: dict[str, Any], folder: Path) -> None:
        """Store the document and the folder, from which workers recreate the study."""
        self._document, self._folder = document, folder

    @property
    def tasks(self) -> int:
        """Number of tasks."""
        raise NotImplementedError

    def rounds(self) -> Generator[Round, Columns, None]:
        """The rounds in which the tasks are computed. If a round has points, the caller sends the round's
        results back to the generator.
        """
        yield Round(0, self.tasks, None)

    def take_points(self, first: int, points: list[dict[str, Any]]) -> None:
        """Use these parameters for the tasks from `first` on."""
        raise NotImplementedError

    def contents(self) -> dict[str, str]:
        """Hashes of all inputs of the results that are not in the document itself. Each has a readable
        name.
        """
        raise NotImplementedError

    def kernel(self) -> Kernel:
        """Create the function that computes tasks.

        Raises:
            CobotError: the study contradicts the robot or a file.
        """
        raise NotImplementedError

    def answer(self, columns: Columns) -> dict[str, Any]:
        """The answer computed from the available results, by readable names. It may be empty."""
        raise NotImplementedError

    @property
    def metric_of_map(self) -> str:
        """Name of the column that colours a map."""
        raise NotImplementedError
