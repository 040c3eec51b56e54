"""Placements. Oracles: reach studies whose space is moved instead of the base; the planners themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_peers import need
from study_functions import reach_study

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.robot.description import load_robot
from cobot.studies import Study, run_study, study_of
from cobot.studies.programs.program_moves import StudyMove, plan_program

LOW, HIGH = np.array([0.4, -0.3, 0.2]), np.array([0.9, 0.3, 0.6])
POST = {"shape": "box", "size": [0.2, 0.2, 0.9], "pose": [0.5, 0.3, 0.45, 1, 0, 0, 0]}


def placement(space: dict[str, Any], **more: Any) -> Study:
    targets = {"box": {"low": LOW.tolist(), "high": HIGH.tolist()}, "spacing_m": 0.1}
    document = {"question": "Where?", "kind": "placement", "targets": targets, "space": space}
    return study_of(document | more)


def moved(shift: list[float], **more: Any) -> float:
    """The mean share of a reach study in a box that is moved against the base."""
    box = {"low": (LOW - shift).tolist(), "high": (HIGH - shift).tolist()}
    study = reach_study(space={"box": box, "spacing_m": 0.1}, **more)
    return float(np.mean(np.asarray(study.kernel()(0, study.tasks)["share"], float)))


def test_a_moved_base_reaches_what_a_moved_box_is_reached() -> None:
    study = placement(
        {"base_x_m": {"values": [-0.2, 0.0, 0.3]}, "base_y_m": {"values": [0.0, 0.25]}}, method="ik"
    )
    columns = study.kernel()(0, study.tasks)
    expected = [moved([x, y, 0.0], method="ik") for x in (-0.2, 0.0, 0.3) for y in (0.0, 0.25)]
    np.testing.assert_allclose(columns["share"], expected, atol=1e-12)
    assert len(set(expected)) > 3


def test_obstacles_stay_where_they_are() -> None:
    study = placement({"base_x_m": {"values": [-0.1, 0.1]}}, robot={"objects": {"post": POST}})
    ours = study.kernel()(0, 2)["share"]
    for share, x in zip(ours, (-0.1, 0.1), strict=True):
        post = POST | {"pose": [0.5 - x, *POST["pose"][1:]]}  # type: ignore[misc]
        assert share == pytest.approx(moved([x, 0.0, 0.0], robot={"objects": {"post": post}}))


def test_a_turned_base_reaches_as_much_of_what_is_round() -> None:
    study = placement({"base_yaw_rad": {"values": [0.0, 0.4, 1.5]}}, method="ik")
    share = study.kernel()(0, 3)["share"]
    assert share[0] == share[1]  # the first joint makes up for it
    ring = moved([0.0, 0.0, 0.0], method="ik")
    assert share[0] == pytest.approx(ring)


def test_the_floor_of_the_model_stays_below_a_raised_base() -> None:
    """A target below the base is reached above a floor that is further below."""
    box = {"low": [0.5, 0, 0.2], "high": [0.5, 0, 0.2]}
    study = placement({"base_z_m": {"values": [0.0, 0.35]}}, targets={"box": box, "spacing_m": 0.1})
    columns = study.kernel()(0, 2)
    assert columns["share"].tolist() == [1.0, 1.0]
    again = study.kernel()(0, 1)
    assert again["share"].tolist() == [1.0]
    sunk = placement({"base_z_m": {"values": [-0.3]}}, targets={"box": box, "spacing_m": 0.1})
    assert sunk.kernel()(0, 1)["share"].tolist() == [0.0]  # the floor is at 0.3 m of the new base


def test_a_longer_tool_is_a_lower_tcp() -> None:
    study = placement({"tcp_z_m": {"values": [0.0, 0.15]}}, method="ik")
    shares = study.kernel()(0, 2)["share"]
    assert shares[1] == pytest.approx(moved([0.0, 0.0, -0.15], method="ik"))
    assert shares[0] == pytest.approx(moved([0.0, 0.0, 0.0], method="ik"))


def test_the_duration_is_that_of_the_planned_program() -> None:
    program = [{"to": "home"}, {"pose": [0.5, 0, 0.3, 0, 1, 0, 0]}, {"to": "home"}]
    space = {"base_x_m": {"values": [-0.1, 0.0, 5.0]}}
    study = placement(space, metric="duration_s", goal="min", program=program, targets=None)
    found = study.kernel()(0, 3)["duration_s"]
    robot = load_robot(load_settings())
    for value, x in zip(found[:2], (-0.1, 0.0), strict=True):
        shifted = [program[0], {"pose": [0.5 - x, 0, 0.3, 0, 1, 0, 0]}, program[2]]
        planned = plan_program(robot, [StudyMove.model_validate(move) for move in shifted], 1.0, 0)
        expected = sum(move.trajectory.duration_s for move in planned if move.trajectory is not None)
        assert value == pytest.approx(expected, abs=1e-6)
    assert np.isnan(found[2])  # out of reach


def test_a_space_without_a_feasible_placement_says_what_is_nearest_or_why() -> None:
    """Oracle: the distances between the bases; each metre further is a metre more beyond the reach."""
    far = placement({"base_x_m": {"values": [-6.0, -5.0, -7.0]}}, method="ik")
    columns = far.kernel()(0, 3)
    gaps = np.asarray(columns["gap_m"], float)
    assert gaps[[0, 2]] - gaps[1] == pytest.approx([1.0, 2.0], abs=0.05)
    answer = far.answer({"task": np.arange(3), **columns})
    assert answer["no target is reached"].startswith("the nearest placement is base_x_m -5: its targets are ")
    assert not answer.keys() & {"at", "best share"}
    assert far.best_placement(columns) is None  # nothing to take over
    assert far.best_placement(columns | {"share": np.array([0.0, 0.5, 0.0])}) is not None
    # Of the two poses, the base at -0.5 m reaches the first only; at 6 m it reaches none.
    program = [{"to": "home"}, *({"pose": [x, 0, 0.3, 0, 1, 0, 0]} for x in (0.0, 9.0))]
    space = {"base_x_m": {"values": [6.0, -0.5]}}
    study = placement(space, metric="duration_s", goal="min", program=program, targets=None)
    columns = study.kernel()(0, 2)
    assert columns["planned"].tolist() == [0, 1]
    said = study.answer({"task": np.arange(2), **columns})["no placement can execute the program"]
    assert said.startswith("the nearest has base_x_m -0.5: motions planned: 1; then program[2]: ")
    earlier = {name: values for name, values in columns.items() if name != "planned"}
    assert study.answer({"task": np.arange(2), **earlier})["duration_s"] == "no task has a finite value"


@pytest.mark.thorough
def test_a_search_finds_a_placement_as_good_as_a_grid(tmp_path: Path) -> None:
    need("cmaes", "study")
    need("optuna", "study")
    space = {"base_x_m": {"uniform": [-0.3, 0.5]}, "base_y_m": {"uniform": [-0.4, 0.4]}}
    study = placement(space, method="ik", search={"trials": 40})
    best = run_study(study, tmp_path / "out", workers=1).answer["best share"]
    axes = {
        name: {"low": axis["uniform"][0], "high": axis["uniform"][1], "count": 7}
        for name, axis in space.items()
    }
    grid = placement(axes, method="ik")
    assert best >= float(np.max(np.asarray(grid.kernel()(0, grid.tasks)["share"], float))) - 0.03


@pytest.mark.parametrize(
    ("space", "more", "message"),
    [
        ({"base_x": {"values": [0]}}, {}, r"space: unknown parameter 'base_x' \(did you mean 'base_x_m'\?\)"),
        ({}, {"metric": "duration_s"}, "program: is missing; the metric duration_s needs it"),
        ({}, {"targets": None}, "targets: is missing; the metric share needs it"),
        ({}, {"metric": "duration_s", "program": [{"to": "home"}] * 2}, "goal: is missing; give min"),
    ],
)
def test_a_bad_study_names_the_key(space: dict[str, Any], more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        placement(space, **more)
