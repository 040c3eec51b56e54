"""Functions as studies. Oracle: the function, called directly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study_functions import function_study

from cobot.errors import CobotError
from cobot.studies import study_of


def test_functions_of_installed_modules_can_be_asked() -> None:
    space = {"x": {"low": 0, "high": 2, "count": 5}, "y": {"values": [2]}}
    document = {"question": "?", "kind": "python", "function": "math:dist", "space": space}
    with pytest.raises(CobotError, match=r"function: math: no such module|cannot be called"):
        study_of(document).kernel()
    study = study_of(document | {"function": "statistics:NormalDist", "space": {"mu": {"values": [1]}}})
    assert study.kernel()(0, 1)["failure"][0].startswith("result 'value': is a NormalDist; it must be")


def test_a_seed_belongs_to_a_task_and_not_to_a_chunk(tmp_path: Path) -> None:
    study = function_study(tmp_path, "draws", space={"a": {"values": [0, 1, 2]}})
    whole = study.kernel()(0, 3)["value"]
    np.testing.assert_array_equal(whole[1:2], study.kernel()(1, 2)["value"])
    assert len(set(np.asarray(whole) % 1.0)) == 3


def test_whatever_a_function_does_is_a_reason_and_no_end(tmp_path: Path) -> None:
    columns = function_study(tmp_path, "strange").kernel()(0, 20)
    reasons = columns["failure"].reshape(5, 4)
    assert set(reasons[:, 1]) == {"SystemExit: 3"}
    assert set(reasons[:, 2]) == {"KeyboardInterrupt"}
    assert reasons[0, 0] == ""
    assert reasons[1, 0] == "result '': is the name of a parameter or not a valid name; return another one"
    assert reasons[2, 0].startswith("result 'a': is the name of a parameter")
    assert reasons[3, 0] == "result 'value': is an integer with 1329 bits, which is too large for a float"
    assert reasons[4, 0] == "result 'value': is a NoneType; it must be a number, bool or text"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"function": "functions.py:produkt"}, r"unknown function 'produkt' \(did you mean 'product'\?\)"),
        ({"function": "none.py:product"}, "function: none.py: no such file"),
        ({"function": "no_such_module:f"}, "function: no_such_module: no such module"),
        (
            {"space": {"a": {"values": [1]}}},
            r"product\(a, b\) cannot be called with the parameters of the space \(a\)",
        ),
        ({"function": "broken.py:f"}, r"function: broken.py cannot be imported: SyntaxError"),
    ],
)
def test_a_function_that_cannot_be_called_is_found_before_it_begins(
    more: dict[str, Any], message: str, tmp_path: Path
) -> None:
    (tmp_path / "broken.py").write_text("def f(:\n", encoding="utf-8")
    study = function_study(tmp_path)
    study = study_of(study.document | more, tmp_path)
    with pytest.raises(CobotError, match=message):
        study.kernel()
