"""Requests to planners check themselves. Oracle: the table of traits, and what each body of REST can say."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planner_sentences import only

from cobot.errors import InputError
from cobot.motions.bodies import MoveJoints, MovePose
from cobot.motions.constraints import Constraints
from cobot.motions.planners import BODY_FIELDS, PLANNERS, PlannerName, Way
from cobot.motions.requests import NO_START, Arc, MotionRequest, TcpSpeed
from cobot.planners import function_of
from cobot.types import Pose, Scaling, Synchronization

ROOT = Path(__file__).parents[3]
FULL = Scaling(1.0)
GOAL = Pose.from_abc(0.4, 0.1, 0.5, 0.0, 3.14, 0.0)
GIVEN: dict[str, Any] = {
    "via": np.array([0.4, 0.0, 0.5]),
    "arc": Arc(np.array([0.4, 0.0, 0.4])),
    "through": (GOAL,),
    "radius_m": 0.02,
    "tcp_speed": TcpSpeed(0.1),
    "synchronization": Synchronization.PHASE,
    "algorithm": "RRTstar",
    "cyclic": True,
    "end_joints": np.zeros(7),
}
"""A value of each field that not every planner uses."""


def request(planner: PlannerName, **more: Any) -> MotionRequest:
    """With the first of the fields that the planner needs, unless another one is given."""
    needs = PLANNERS[planner].needs
    needed = {} if not needs or any(name in more for name in needs) else {needs[0]: GIVEN[needs[0]]}
    return MotionRequest(NO_START, GOAL, planner, FULL, **needed, **more)


def test_there_is_one_list_of_planners_with_the_traits_of_each() -> None:
    assert list(PLANNERS) == list(PlannerName)
    assert set(GIVEN) == set(BODY_FIELDS)
    names = {each.name for each in fields(MotionRequest)}
    for traits in PLANNERS.values():
        assert set(traits.needs) <= traits.fields <= set(BODY_FIELDS) <= names
        assert bool(traits.needs) == bool(traits.missing)
    assert {name for each in BODY_FIELDS.values() for name in each} <= set(MovePose.model_fields)


@pytest.mark.parametrize("planner", [each for each in PlannerName if each is not PlannerName.AUTO])
def test_the_function_that_the_traits_of_a_planner_name_is_there(planner: PlannerName) -> None:
    assert callable(function_of(planner))


@pytest.mark.parametrize("field", BODY_FIELDS)
@pytest.mark.parametrize("planner", PlannerName)
def test_a_planner_takes_the_fields_that_it_uses_and_rejects_all_others(
    planner: PlannerName, field: str
) -> None:
    if field in PLANNERS[planner].fields:
        assert getattr(request(planner, **{field: GIVEN[field]}), field) is GIVEN[field]
        return
    with pytest.raises(InputError, match=rf"^{BODY_FIELDS[field][0]}: .*only, not for {planner}$"):
        request(planner, **{field: GIVEN[field]})


@pytest.mark.parametrize("planner", [name for name, traits in PLANNERS.items() if traits.needs])
def test_a_planner_without_the_field_that_it_needs_says_what_is_missing(planner: PlannerName) -> None:
    with pytest.raises(InputError, match=f"(is missing|is empty); planner {planner} needs"):
        MotionRequest(NO_START, GOAL, planner, FULL)


def test_fields_that_exclude_each_other_are_rejected_together() -> None:
    for change, message in (
        ({"via": GIVEN["via"], "arc": GIVEN["arc"]}, "^via, centre: give only one of them"),
        ({"cyclic": True, "end_joints": np.zeros(7)}, "^cyclic, end_joints: give one of them"),
    ):
        with pytest.raises(InputError, match=message):
            request(PlannerName.CIRC, **change)
    with pytest.raises(
        InputError, match=r"^constraints: RRTstar does not support them; use algorithm RRTConnect"
    ):
        request(PlannerName.OMPL, algorithm="RRTstar", constraints=Constraints())


@pytest.mark.parametrize("planner", PlannerName)
def test_joint_angles_are_a_goal_for_planners_that_need_no_pose(planner: PlannerName) -> None:
    if PLANNERS[planner].way is Way.PATH:
        with pytest.raises(InputError, match=f"^{planner} needs a pose as its goal, not joint angles$"):
            replace(request(planner), goal=np.zeros(7))
    else:
        assert not isinstance(replace(request(planner), goal=np.zeros(7)).goal, Pose)


def test_a_request_is_checked_whenever_it_is_made_from_another() -> None:
    line = request(PlannerName.LIN, tcp_speed=TcpSpeed(0.1))
    assert pickle.loads(pickle.dumps(line)).tcp_speed == TcpSpeed(0.1)
    with pytest.raises(InputError, match=f"speed_m_s: {only('tcp_speed', 'auto')}"):
        replace(line, planner=PlannerName.AUTO)


def test_the_schemas_and_the_documents_list_the_planners_of_the_table() -> None:
    listed = MovePose.model_json_schema()["properties"]["planner"]
    assert listed["enum"] == list(PlannerName)
    assert all(f"{name}: {traits.summary}" in listed["description"] for name, traits in PLANNERS.items())
    joints = MoveJoints.model_json_schema()["properties"]["planner"]["enum"]
    assert joints == [name for name, traits in PLANNERS.items() if traits.way is not Way.PATH]
    page = (ROOT / "docs" / "motions.md").read_text(encoding="utf-8")
    rows = page.partition("| `planner` | Path |")[2].partition("\n\n")[0]
    assert [row.split("`")[1] for row in rows.splitlines()[2:]] == list(PlannerName)
    *others, last = joints
    assert f"by {', '.join(others)} or {last}." in page
