"""A study that is computed for several arms, tools or settings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from cobot.studies.chunks import Columns, joined
from cobot.studies.study import Kernel, Study
from cobot.studies.study_file import study_of

VARIANT = "variant"


class CompareStudy(Study):
    """One study with variants, whose answers are shown side by side.

    Attributes:
        study: the part common to all variants: a study without a question and a seed.
        variants: the keys in which a variant differs, by the name of the variant. Mappings are merged.
    """

    kind: Literal["compare"]
    study: dict[str, Any]
    variants: Annotated[dict[str, dict[str, Any]], Field(min_length=2, max_length=1000)]

    @model_validator(mode="after")
    def _require_simple_study(self) -> Self:
        if self.study.get("kind") == "compare":
            raise ValueError("study.kind: a comparison cannot compare comparisons")
        if "search" in self.study or any("search" in changes for changes in self.variants.values()):
            raise ValueError(
                "search: a comparison computes the same tasks for all variants; run a search for each "
                "separately"
            )
        for key in ("question", "seed"):
            if key in self.study:
                raise ValueError(f"study.{key}: belongs to the comparison itself; move it there")
        return self

    @cached_property
    def each(self) -> dict[str, Study]:
        """The study of each variant.

        Raises:
            ConfigError: one of the studies is invalid; the message names it.
        """
        common = {"question": self.question, "seed": self.seed}
        return {
            name: study_of(_merged(self.study, changes) | common, self.folder, f"variants.{name}")
            for name, changes in self.variants.items()
        }

    @cached_property
    def _ends(self) -> dict[str, int]:
        """For each variant, the number that follows the number of its last task."""
        ends = np.cumsum([study.tasks for study in self.each.values()])
        return dict(zip(self.each, ends.tolist(), strict=True))

    @property
    def tasks(self) -> int:
        return max(self._ends.values())

    def contents(self) -> dict[str, str]:
        return {
            f"{name} of {variant}": value
            for variant, study in self.each.items()
            for name, value in study.contents().items()
        }

    def kernel(self) -> Kernel:
        kernels = {name: study.kernel() for name, study in self.each.items()}

        def compute(first: int, last: int) -> Columns:
            parts = []
            for name, begin, end in self._ranges(first, last):
                parts.append({VARIANT: np.full(end - begin, name), **kernels[name](begin, end)})
            return joined(parts)

        return compute

    def _ranges(self, first: int, last: int) -> list[tuple[str, int, int]]:
        """The tasks of each variant that are in a range of all tasks. Each variant numbers its tasks
        separately.
        """
        found, begin = [], 0
        for name, end in self._ends.items():
            low, high = max(first, begin), min(last, end)
            if low < high:
                found.append((name, low - begin, high - begin))
            begin = end
        return found

    def answer(self, columns: Columns) -> dict[str, Any]:
        """Each fact with its value for each variant."""
        facts: dict[str, dict[str, Any]] = {}
        begin = 0
        for name, end in self._ends.items():
            mine = columns[VARIANT] == name
            if mine.any():
                part = {key: values[mine] for key, values in columns.items()}
                part["task"] = np.asarray(part["task"], dtype=np.int64) - begin
                for fact, value in self.each[name].answer(part).items():
                    facts.setdefault(fact, {})[name] = value
            begin = end
        return facts


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merged(base[key], value) if both else value
    return merged
