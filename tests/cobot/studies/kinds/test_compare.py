"""Comparisons. Oracle: the studies of the variants, computed each by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folders import ROOT
from study_functions import reach_study

from cobot.errors import CobotError, ConfigError
from cobot.studies import Study, run_study, study_of

TOOL = {"robot": {"tool": {"mass": 1.0, "tcp": [0, 0, 0.2, 1, 0, 0, 0]}}}
FR3 = {"robot": {"settings": str(ROOT / "config" / "fr3.yaml")}}


def comparison(**more: Any) -> Study:
    common = {key: value for key, value in reach_study().document.items() if key != "question"}
    document = {
        "question": "Which is better?",
        "kind": "compare",
        "study": common,
        "variants": {"bare": {}, "tool": TOOL, "fr3": FR3},
    }
    return study_of(document | more)


def test_each_variant_is_what_it_is_alone(tmp_path: Path) -> None:
    study = comparison()
    result = run_study(study, tmp_path / "out", workers=1)
    for name, changes in (("bare", {}), ("tool", TOOL), ("fr3", FR3)):
        alone = reach_study(**changes)
        columns = {"task": np.arange(alone.tasks), **alone.kernel()(0, alone.tasks)}
        for fact, value in alone.answer(columns).items():
            assert result.answer[fact][name] == value


def test_a_chunk_may_have_tasks_of_several_variants() -> None:
    study = comparison()
    whole = study.kernel()(0, study.tasks)
    part = study.kernel()(study.tasks // 3 - 2, study.tasks // 3 + 2)
    assert set(part["variant"].tolist()) == {"bare", "tool"}
    for name in part:
        expected = whole[name][study.tasks // 3 - 2 : study.tasks // 3 + 2]
        np.testing.assert_array_equal(part[name], expected)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"variants": {"a": {}}}, "variants: must have at least 2 items"),
        ({"study": {"kind": "placement", "search": {"trials": 3}}}, "search: a comparison computes the same"),
        ({"study": {"kind": "compare"}}, "study.kind: a comparison cannot compare comparisons"),
        (
            {"study": {"kind": "reach", "seed": 1}},
            "study.seed: belongs to the comparison itself",
        ),
        (
            {"variants": {"a": {}, "b": {"metod": "ik"}}},
            r"variants.b: unknown key 'metod' \(did you mean",
        ),
        (
            {"variants": {"a": {}, "b": {"kind": "rech"}}},
            r"variants.b: kind: unknown kind 'rech' \(did",
        ),
    ],
)
def test_a_bad_variant_is_named(more: dict[str, Any], message: str) -> None:
    with pytest.raises((ConfigError, CobotError), match=message):
        comparison(**more).kernel()
