"""Reach. Oracles: an exhaustive search from many joints by pinocchio's kinematics and MuJoCo's own contacts;
the planner lin, which answers for one pose.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
import trimesh
from independent_models import LIMITS, Contacts, changed_world, second_robot
from study_functions import reach_study

from cobot.errors import CobotError, ConfigError
from cobot.motions.planners import PlannerName
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.robot.description import RobotDescription
from cobot.robot.limits import load_joint_limits
from cobot.studies.chunks import Columns
from cobot.types import Array, Pose, Scaling

STARTS, STEPS = 60, 40
"""Random starts of the search at a place, and steps of each descent."""
DOWN = np.diag([1.0, -1.0, -1.0])
SPACE = {"box": {"low": [-0.75, -0.5, 0.05], "high": [0.75, 0.5, 1.05]}, "spacing_m": 0.25}


def computed(**more: Any) -> Columns:
    study = reach_study(**more)
    return study.kernel()(0, study.tasks)


@cache
def found_by_search(place: tuple[float, float, float]) -> list[tuple[float, ...]]:
    """Joints within the limits, with the TCP down at a place, that descents from random joints end at."""
    other, random = second_robot(), np.random.default_rng(4)
    limits = load_joint_limits(LIMITS)
    low, high = limits.min_position, limits.max_position
    found = []
    for joints in random.uniform(low, high, (STARTS, len(low))):
        for _ in range(STEPS):
            position, turn = other.forward(joints)
            error = np.concatenate([np.array(place) - position, pinocchio.log3(DOWN @ turn.T)])
            if np.linalg.norm(error) < 1e-8:
                found.append(tuple(joints))
                break
            jacobian = other.jacobian(joints)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), error)
            joints = np.clip(joints + step * min(1.0, 0.5 / np.abs(step).max()), low, high)
    return found


def places_of(columns: Columns) -> list[tuple[float, float, float]]:
    return [
        (float(x), float(y), float(z)) for x, y, z in zip(*(columns[axis] for axis in "xyz"), strict=True)
    ]


@pytest.mark.thorough
def test_places_are_solved_where_an_exhaustive_search_finds_joints() -> None:
    columns = computed(space=SPACE, method="ik")
    places = places_of(columns)
    assert len(places) == 7 * 5 * 5
    searched = [bool(found_by_search(place)) for place in places]
    assert 20 < sum(searched) < len(places) - 20
    assert (columns["solved"] == np.array(searched)).all()


def test_places_are_reached_where_some_of_these_joints_are_free_by_mujoco(
    robot: RobotDescription, tmp_path: Path
) -> None:
    post = {"shape": "box", "size": [0.3, 0.3, 0.7], "pose": [0.5, 0.2, 0.35, 1, 0, 0, 0]}
    columns = computed(space=SPACE, method="free", robot={"objects": {"post": post}})
    world = changed_world(tmp_path, post=(0.5, 0.2, 0.35, 0.15, 0.15, 0.35))
    contacts = Contacts(robot.collision.margin_m, world)
    free = []
    for place in places_of(columns):
        pairs = [contacts.bodies(np.array(joints)) for joints in found_by_search(place)]
        free.append(any(not each for each in pairs))
    assert sum(free) < int((columns["solved"] > 0).sum())
    assert (columns["reached"] == np.array(free)).all()


@pytest.mark.thorough
def test_a_line_reaches_where_the_planner_finds_one(robot: RobotDescription) -> None:
    space = {"box": {"low": [0.3, -0.4, 0.2], "high": [0.7, 0.4, 0.6]}, "spacing_m": 0.2}
    columns = computed(space=space, method="lin", start="home")
    start = np.array(robot.positions["home"].joints)
    planned = []
    for place in places_of(columns):
        goal = Pose(np.array(place), np.array([0.0, 1.0, 0.0, 0.0]))
        try:
            plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(1.0)))
            planned.append(True)
        except CobotError:
            planned.append(False)
    assert 0 < sum(planned) < len(planned)
    assert (columns["reached"] == np.array(planned)).all()


def test_manipulability_is_at_least_that_of_each_joints_of_the_search() -> None:
    columns = computed(space=SPACE, method="ik")
    other = second_robot()

    def measure(joints: Array) -> float:
        jacobian = other.jacobian(joints)
        return float(np.sqrt(max(np.linalg.det(jacobian @ jacobian.T), 0.0)))

    for place, value in zip(places_of(columns), columns["manipulability"], strict=True):
        found = found_by_search(place)
        if found:
            best = max(measure(np.array(joints)) for joints in found)
            assert float(value) > (1.0 - 1e-6) * best


def test_redundancy_is_the_share_of_the_arm_angles() -> None:
    columns = computed(space=SPACE, method="ik")
    values = np.asarray(columns["redundancy"], float)[columns["solved"] > 0]
    assert values.max() <= 1.0
    assert values.min() < 0.5 < values.max()
    free = computed(space=SPACE, method="free")
    assert (np.nan_to_num(np.asarray(free["redundancy"], float)) <= np.nan_to_num(values_of(columns))).all()


def values_of(columns: Columns) -> Array:
    return np.asarray(columns["redundancy"], float)


def test_an_obstacle_takes_reach_away() -> None:
    wall = {"shape": "box", "size": [0.02, 3.0, 3.0], "pose": [0.4, 0, 0.5, 1, 0, 0, 0]}
    plain = computed(space=SPACE)
    walled = computed(space=SPACE, robot={"objects": {"wall": wall}})
    behind = plain["x"] > 0.4  # type: ignore[operator]
    assert plain["reached"][behind].any()
    assert not walled["reached"][behind].any()
    assert not (walled["reached"] > plain["reached"]).any()  # type: ignore[operator]


def test_a_longer_tool_reaches_what_the_bare_flange_reaches_above() -> None:
    tool = {"tcp": [0, 0, 0.25, 1, 0, 0, 0]}
    lower = {"box": {"low": [-0.75, -0.5, -0.2], "high": [0.75, 0.5, 0.8]}, "spacing_m": 0.25}
    bare, tooled = (
        computed(space=SPACE, method="ik"),
        computed(space=lower, method="ik", robot={"tool": tool}),
    )
    assert (bare["solved"] == tooled["solved"]).all()


def test_the_parts_of_the_tasks_are_those_of_the_whole() -> None:
    study = reach_study()
    kernel = study.kernel()
    whole = kernel(0, study.tasks)
    for first, last in ((0, 3), (3, 4), (4, study.tasks)):
        part = study.kernel()(first, last)
        assert all(np.array_equal(part[name], whole[name][first:last], equal_nan=True) for name in whole)


def test_a_surface_is_reached_against_its_normals(tmp_path: Path) -> None:
    mesh = trimesh.creation.box((0.2, 0.2, 0.1))
    mesh.export(tmp_path / "part.stl")
    space = {
        "mesh": {"file": str(tmp_path / "part.stl"), "pose": [0.75, 0, 0.3, 1, 0, 0, 0], "standoff_m": 0.05}
    }
    study = reach_study(space=space | {"spacing_m": 0.05}, approach="inward", spins=2, method="ik")
    columns = study.kernel()(0, study.tasks)
    places = np.array(places_of(columns))
    outside = np.linalg.norm(np.maximum(np.abs(places - [0.75, 0, 0.3]) - [0.1, 0.1, 0.05], 0.0), axis=1)
    np.testing.assert_allclose(outside, 0.05, atol=1e-9)  # the distance from a box
    near, far = places[:, 0] < 0.61, places[:, 0] > 0.89
    assert (columns["share"][near] == 1.0).all()
    assert (columns["share"][far] == 0.0).all()  # the wrist would be beyond it, 1.03 m from the base


def test_a_space_that_is_out_of_reach_says_what_is_nearest() -> None:
    study = reach_study(space={"box": {"low": [2.0, 0, 0.3], "high": [3.0, 0, 0.3]}, "spacing_m": 0.5})
    answer = study.answer(study.kernel()(0, study.tasks))
    assert answer["places reached"] == 0
    said = answer["no place is reached"]
    assert said.startswith("the nearest to it is [2.0, 0.0, 0.3]: it is 1.")
    assert said.endswith(" m beyond the reach")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"metod": "ik"}, r"unknown key 'metod' \(did you mean 'method'\?\); valid keys: "),
        ({"method": "best"}, "method: must be 'ik', 'free' or 'lin', got 'best'"),
        ({"method": "lin"}, "start: must be given for the method lin"),
        ({"start": "home"}, "start: must be given for the method lin and for no other; the method is free"),
        (
            {"approach": "up"},
            r"approach: must be down, inward, a number of directions from 1 to 1000, .* got 'up'",
        ),
        ({"approach": [[0, 0, 0]]}, "approach: must be down"),
        ({"approach": "inward"}, "inward needs space.mesh"),
        ({"spins": 0}, "spins: must be greater than or equal to 1, got 0"),
        ({"space": {"spacing_m": 0.1}}, "space: must have either box or mesh"),
        (
            {"space": {"box": {"low": [1, 0, 0], "high": [0, 0, 0]}, "spacing_m": 0.1}},
            "low x is 1; it must be at most",
        ),
        (
            {"space": {"box": {"low": [0, 0, 0], "high": [1, 1, 1]}, "spacing_m": 0}},
            "spacing_m: must be greater",
        ),
        ({"robot": {"objects": {"a": {"shape": "cone", "size": [1], "pose": [0] * 7}}}}, "objects.a.shape: "),
        ({"question": ""}, "question: must have at least 1 item|question: string should have at least 1"),
    ],
)
def test_a_bad_study_names_the_key_and_what_is_valid(more: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        reach_study(**more)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"method": "lin", "start": "hom"}, r"start: unknown position 'hom' \(did you mean 'home'\?\)"),
        ({"method": "lin", "start": [0.0, 1.0]}, "start: has 2 angles, but the arm has 7 joints"),
        ({"robot": {"name": "iwa"}}, r"robot.name: unknown robot 'iwa' \(did you mean 'iiwa'\?\)"),
        ({"robot": {"settings": "none.yaml"}}, "none.yaml: no such file"),
        ({"robot": {"scene": "none.json"}}, "robot.scene: .*none.json: no such file"),
        ({"robot": {"tool": {"mass": 50.0}}}, "mass"),
        (
            {
                "robot": {
                    "objects": {"link1": {"shape": "sphere", "size": [0.1], "pose": [0, 0, 2, 1, 0, 0, 0]}}
                }
            },
            "robot.objects.link1: is the name of a part of the robot; rename the object",
        ),
        (
            {"robot": {"objects": {"a": {"shape": "box", "size": [1.0], "pose": [0] * 6 + [1]}}}},
            "a box has 3 numbers",
        ),
        (
            {"robot": {"objects": {"a": {"shape": "sphere", "size": [1.0], "pose": [0] * 7}}}},
            "robot.objects.a.pose: the quaternion w, x, y, z has length 0; it must be 1",
        ),
        (
            {"space": {"mesh": {"file": "none.stl"}, "spacing_m": 0.1}},
            "space.mesh.file: .*none.stl: no such file",
        ),
        ({"space": {"box": {"low": [0] * 3, "high": [9] * 3}, "spacing_m": 0.001}}, "use a larger spacing"),
    ],
)
def test_a_study_that_contradicts_the_robot_says_so_before_it_begins(
    more: dict[str, Any], message: str
) -> None:
    with pytest.raises(CobotError, match=message):
        reach_study(**more).kernel()


def test_directions_cover_the_sphere_and_spins_turn_about_them() -> None:
    """Oracle: means over a sphere, and rotation matrices of scipy."""
    from scipy.spatial.transform import Rotation

    from cobot.studies.kinds.reach_space import orientations

    axes = Rotation.from_quat(orientations(400, 1, None), scalar_first=True).as_matrix()[:, :, 2]
    np.testing.assert_allclose(axes.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose((axes**2).mean(axis=0), 1 / 3, atol=0.01)
    turns = Rotation.from_quat(orientations([[1, 2, 3]], 4, None), scalar_first=True)
    np.testing.assert_allclose(turns.as_matrix()[:, :, 2], [np.array([1, 2, 3]) / np.sqrt(14)] * 4)
    steps = [(turns[i].inv() * turns[(i + 1) % 4]).as_rotvec() for i in range(4)]
    np.testing.assert_allclose(steps, [[0, 0, np.pi / 2]] * 4, atol=1e-12)
