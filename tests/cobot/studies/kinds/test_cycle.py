"""Cycles. Oracles: the planners and their blending, called directly for each order; an exhaustive grid."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_peers import need

from cobot.errors import ConfigError
from cobot.motions.planners import PlannerName
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.blending.joined import joined, leg_of
from cobot.robot.description import RobotDescription
from cobot.studies import Study, run_study, study_of
from cobot.types import Pose, Scaling

LEFT, MIDDLE, RIGHT = ([0.5, y, 0.3, 0, 1, 0, 0] for y in (-0.3, 0.0, 0.3))


def cycle(program: list[dict[str, Any]], **more: Any) -> Study:
    return study_of({"question": "How short?", "kind": "cycle", "program": program, "space": {}} | more)


def planned(robot: RobotDescription, poses: list[list[float]], radius_m: float = 0.0) -> float:
    """The duration of motions from home through poses, s."""
    joints, legs = np.array(robot.positions["home"].joints), []
    for pose in poses:
        request = MotionRequest(joints, Pose.from_numbers(pose), PlannerName.PTP, Scaling(1.0))
        motion = plan(robot, request)
        assert motion is not None
        legs.append(leg_of(robot, request, motion))
        joints = np.array(motion.end)
    if not radius_m:
        return float(sum(leg.motion.duration_s for leg in legs))
    return float(joined(robot, legs, [radius_m] * (len(legs) - 1)).trajectory.duration_s)


def moves(*poses: list[float], **more: Any) -> list[dict[str, Any]]:
    return [{"to": "home"}, *({"pose": pose, "speed": 1.0} | more for pose in poses)]


def test_each_order_takes_as_long_as_the_planner_says(robot: RobotDescription) -> None:
    study = cycle(moves(LEFT, RIGHT, MIDDLE), orders=[[1, 2, 3]])
    assert study.tasks == 6
    columns = study.kernel()(0, 6)
    expected = [planned(robot, list(order)) for order in itertools.permutations([LEFT, RIGHT, MIDDLE])]
    np.testing.assert_allclose(columns["duration_s"], expected, atol=1e-6)
    np.testing.assert_allclose(columns["saved_s"], expected[0] - np.array(expected), atol=1e-6)
    answer = study.answer({"task": np.arange(6), **columns})
    assert answer["best duration_s"] == pytest.approx(min(expected))
    assert answer["at"] == f"order1 {int(np.argmin(expected))}"
    assert answer["duration_s as written"] == pytest.approx(expected[0])


def test_blends_are_those_of_the_planner_and_none_where_the_arm_stops(robot: RobotDescription) -> None:
    space = {"blend_radius_m": {"values": [0.0, 0.05]}}
    free = cycle(moves(LEFT, MIDDLE, RIGHT), space=space).kernel()(0, 2)["duration_s"]
    poses = [LEFT, MIDDLE, RIGHT]
    np.testing.assert_allclose(free, [planned(robot, poses), planned(robot, poses, 0.05)], atol=1e-6)
    assert free[1] < free[0]
    stopped = cycle(moves(LEFT, MIDDLE, RIGHT, stop=True), space=space).kernel()(0, 2)["duration_s"]
    assert stopped[1] == pytest.approx(stopped[0], abs=1e-6)


def test_a_waypoint_moves_within_its_tolerance(robot: RobotDescription) -> None:
    program = moves(LEFT, MIDDLE, RIGHT)
    program[2]["within_m"] = 0.04
    study = cycle(program, samples=6)
    columns = study.kernel()(0, 6)
    shifts = np.column_stack([np.asarray(columns[f"move2_{axis}_m"], float) for axis in "xyz"])
    assert (np.abs(shifts) <= 0.04).all()
    assert np.abs(shifts).max() > 0.02
    for shift, duration_s in zip(shifts, columns["duration_s"], strict=True):
        waypoint = [*(np.array(MIDDLE[:3]) + shift), *MIDDLE[3:]]
        assert duration_s == pytest.approx(planned(robot, [LEFT, waypoint, RIGHT]), abs=1e-6)


def test_a_slower_program_is_slower_and_one_that_cannot_be_planned_has_a_reason() -> None:
    slow = cycle(moves(LEFT), space={"speed": {"values": [0.25, 0.5, 1.0]}}).kernel()(0, 3)["duration_s"]
    assert (np.diff(np.asarray(slow, float)) < 0).all()
    far = [{"to": "home"}, {"pose": [0.7, 0, 0.5, 0, 1, 0, 0], "within_m": 0.3}]
    study = cycle(far, samples=12)
    columns = study.kernel()(0, 12)
    bad = ~np.isfinite(np.asarray(columns["duration_s"], float))
    assert bad.any()
    assert all(str(cause).startswith("program[1]: ") for cause in columns["cause"][bad])
    assert study.answer({"task": np.arange(12), **columns})["cannot be planned"] == bad.sum()


def test_a_study_without_a_possible_program_names_the_one_that_gets_furthest() -> None:
    """Oracle: the reach of the arm. Some shifts of the second pose are beyond it, none of the first."""
    program = [{"to": "home"}, {"pose": LEFT}, {"pose": [0.7, 0, 0.5, 0, 1, 0, 0], "within_m": 0.3}]
    study = cycle(program, samples=12)
    columns = study.kernel()(0, 12)
    bad = ~np.isfinite(np.asarray(columns["duration_s"], float))
    assert np.asarray(columns["planned"])[bad].tolist() == [1] * bad.sum()
    assert set(np.asarray(columns["planned"])[~bad].tolist()) <= {2}
    worst = {name: np.asarray(values)[bad] for name, values in columns.items()}
    first = float(worst["move2_x_m"][0])
    said = study.answer({"task": np.arange(12)[bad], **worst})["no program can be planned"]
    assert said.startswith(f"the nearest has move2_x_m {first:.6g}, ")
    assert "motions planned: 1; then program[2]: " in said
    worst.pop("planned")  # results of an earlier cobot have no such column
    assert study.answer({"task": np.arange(12)[bad], **worst})["cannot be planned"] == bad.sum()


@pytest.mark.thorough
def test_a_search_is_as_good_as_a_grid(tmp_path: Path) -> None:
    need("cmaes", "study")
    need("optuna", "study")
    program = moves(LEFT, MIDDLE, RIGHT)
    axes = {"low": 0.0, "high": 0.1, "count": 6}
    grid = cycle(program, orders=[[1, 2, 3]], space={"blend_radius_m": axes})
    best = np.nanmin(np.asarray(grid.kernel()(0, grid.tasks)["duration_s"], float))
    space = {"blend_radius_m": {"uniform": [0.0, 0.1]}}
    study = cycle(program, orders=[[1, 2, 3]], space=space, search={"trials": 24})
    found = run_study(study, tmp_path / "out", workers=1).answer["best duration_s"]
    assert found <= 1.03 * best


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"space": {"sped": {"values": [1]}}}, r"space: unknown parameter 'sped' \(did you mean 'speed'\?\)"),
        ({"orders": [[0, 1]]}, "orders: 0 occurs twice or is not a move of the program; valid: 1 to 2"),
        ({"orders": [[1, 2], [2, 1]]}, "orders: . occurs twice or is not a move"),
        ({"orders": [[1]]}, r"orders\[0\]: must have at least 2 items"),
        (
            {"program": [{"to": "home"}, {"to": "work", "within_m": 0.1}]},
            r"program\[1\].within_m: needs a pose",
        ),
    ],
)
def test_a_bad_study_names_the_key(more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        cycle(more.pop("program", None) or moves(LEFT, RIGHT), **more)
