"""Collision checks. Oracle: MuJoCo's pairwise geom distances, its contact list; capsules by hand."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from independent_models import MJCF, Contacts, changed_world, robot_in

from cobot.errors import CollisionError, InputError
from cobot.robot.collision import RESOLUTION_M, CollisionChecker, motion_pieces
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.trajectory import Trajectory, from_hermite
from cobot.trajectory_parts import cut
from cobot.types import Array

SEED = 20261121
IN_THE_FLOOR = np.array([0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0])
ON_THE_BASE = np.array([1.8, -2.0, 0.3, 2.0, -0.9, 1.8, -0.3])


def drawn(robot: RobotDescription, count: int) -> Array:
    limits = robot.limits
    return np.random.default_rng(SEED).uniform(limits.min_position, limits.max_position, (count, limits.dof))


def rest_to_rest(first: Array, last: Array, duration_s: float = 2.0) -> Trajectory:
    still = np.zeros((2, len(first)))
    return from_hermite(np.array([0.0, duration_s]), np.array([first, last]), still, still)


class Distances:
    """The smallest distance of any two geoms that may meet, by MuJoCo one pair at a time."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(MJCF))
        self.data = mujoco.MjData(self.model)
        bodies = ["world", "base_link", *(f"link{number}" for number in range(1, 8))]
        apart = {("world", "base_link"), ("base_link", "link1"), ("link5", "link7")}
        apart |= {(f"link{number}", f"link{number + 1}") for number in range(1, 7)}
        self.pairs = [
            (self.geom(first), self.geom(second))
            for i, first in enumerate(bodies)
            for second in bodies[i + 1 :]
            if (first, second) not in apart
        ]

    def geom(self, body: str) -> int:
        return int(self.model.body(body).geomadr[0])

    def smallest(self, joints: Array) -> float:
        self.data.qpos[:] = joints
        mujoco.mj_kinematics(self.model, self.data)
        return min(mujoco.mj_geomDistance(self.model, self.data, *pair, 10.0, None) for pair in self.pairs)


@pytest.mark.parametrize("margin_m", [0.0, 0.005, 0.02])
def test_free_means_that_no_two_geoms_are_nearer_than_the_margin(
    robot: RobotDescription, margin_m: float
) -> None:
    distances, checker = Distances(), CollisionChecker(robot.model, margin_m)
    verdicts = {True: 0, False: 0}
    for joints in drawn(robot, 1000):
        distance_m = distances.smallest(joints)
        if abs(distance_m - margin_m) < 1e-6:
            continue
        assert checker.is_free(joints) == (distance_m > margin_m), joints
        assert (checker.contacts(joints) == []) == (distance_m > margin_m), joints
        verdicts[distance_m > margin_m] += 1
    assert min(verdicts.values()) > 50


def test_contacts_name_the_pairs_with_the_deepest_first(robot: RobotDescription) -> None:
    checker, distances = CollisionChecker(robot.model), Distances()
    seen = 0
    for joints in drawn(robot, 1000):
        found = checker.contacts(joints)
        pairs = {frozenset({contact.first, contact.second}) for contact in found}
        expected = Contacts().bodies(joints) if found else set()
        assert {frozenset(name.replace("floor", "world") for name in pair) for pair in pairs} == expected
        if found:
            seen += 1
            depths = [contact.distance_m for contact in found]
            assert depths == sorted(depths)
            assert depths[0] == pytest.approx(distances.smallest(joints), abs=1e-6)
    assert seen > 50


def test_a_contact_reads_as_two_bodies_and_millimetres(robot: RobotDescription, tmp_path: Path) -> None:
    floating = robot_in(changed_world(tmp_path, floor=False), robot)
    deepest = floating.collision.contacts(ON_THE_BASE)[0]
    assert str(deepest) == "link5 and base_link at -8 mm"


def test_neighbours_never_count_as_colliding(robot: RobotDescription) -> None:
    checker = CollisionChecker(robot.model, margin_m=0.0)
    for joints in drawn(robot, 500):
        for contact in checker.contacts(joints):
            numbers = sorted(int(name[4:]) for name in (contact.first, contact.second) if name[4:].isdigit())
            assert len(numbers) < 2 or numbers[1] - numbers[0] > 1
            assert {contact.first, contact.second} != {"base_link", "link1"}


def test_the_checkers_margin_is_not_felt_by_the_model_it_was_made_from(robot: RobotDescription) -> None:
    CollisionChecker(robot.model, margin_m=0.05)
    assert not robot.model.mj.geom_margin.any()


def test_every_named_position_is_free(robot: RobotDescription) -> None:
    for name, position in robot.positions.items():
        assert robot.collision.is_free(np.array(position.joints)), name
        assert not Contacts().bodies(np.array(position.joints)), name


def test_a_motion_through_the_base_names_bodies_share_time_and_joints(
    robot: RobotDescription, tmp_path: Path
) -> None:
    floating = robot_in(changed_world(tmp_path, floor=False), robot)
    away = np.array([0.6, 0.1, 0.4, -0.3, 0.6, -0.5, 0.0])
    motion = rest_to_rest(ON_THE_BASE - away, ON_THE_BASE + away, 4.0)
    contacts = Contacts(file=changed_world(tmp_path, floor=False))
    times = np.linspace(0.0, 4.0, 2001)
    touching = [time for time in times if contacts.bodies(motion.sample([time])[0])]
    assert touching
    with pytest.raises(CollisionError) as caught:
        floating.collision.check_trajectory(motion)
    words = str(caught.value).split()
    assert words[:2] == ["collision", "of"]
    assert "base_link" in words
    reported_s = float(str(caught.value).split("(")[1].split(" s")[0])
    assert reported_s == pytest.approx(touching[0], abs=0.2)
    assert f"after {100 * reported_s / 4.0:.0f} %" in str(caught.value)


@pytest.mark.parametrize("wait_s", [1.0, 10.0, 600.0])
def test_a_dip_into_the_floor_is_found_however_long_the_arm_stands_still_around_it(
    robot: RobotDescription, wait_s: float
) -> None:
    home, low = np.array(robot.positions["home"].joints), IN_THE_FLOOR
    assert frozenset({"world", "link7"}) in Contacts().bodies(low)
    times = np.array([0.0, wait_s, wait_s + 2.9, wait_s + 5.8, 2.0 * wait_s + 6.0])
    still = np.zeros((5, 7))
    dip = from_hermite(times, np.array([home, home, low, home, home]), still, still)
    with pytest.raises(CollisionError, match=r"collision of floor and link\d at .* mm after \d+ %"):
        robot.collision.check_trajectory(dip)


def test_a_motion_is_free_until_its_first_contact(robot: RobotDescription) -> None:
    """The oracle is the check of the part before that time, and of a part that includes it."""
    collision, low = robot.collision, IN_THE_FLOOR
    motion = rest_to_rest(np.zeros(7), low)
    found = collision.first_contact(motion)
    assert found is not None
    assert 0.0 < found.free_s == found.time_s < motion.duration_s
    collision.check_trajectory(cut(motion, 0.0, found.free_s - 1e-3))
    with pytest.raises(CollisionError, match=re.escape(str(found.contact))):
        collision.check_trajectory(motion)
    with pytest.raises(CollisionError):
        collision.check_trajectory(cut(motion, 0.0, found.free_s + 0.02))
    assert collision.first_contact(rest_to_rest(np.zeros(7), 0.1 * low)) is None


def test_a_contact_is_reported_even_if_a_later_check_proves_its_distance_within_the_resolution(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    collision, motion = robot.collision, rest_to_rest(np.zeros(7), IN_THE_FLOOR)
    hit = collision.clearance.contact(motion_pieces(motion))
    assert hit is not None
    answers: list[tuple[int, float, int, float] | None] = [hit, None, None]

    class Stub:
        def contact(self, pieces: Array, first: bool = False) -> tuple[int, float, int, float] | None:
            return answers.pop(0)

    monkeypatch.setattr(collision, "clearance", Stub())
    found = collision.first_contact(motion)
    assert found is not None
    assert found.free_s == 0.0
    assert found.contact.distance_m == hit[3]
    assert not collision.has_proven(motion)


def test_nothing_comes_nearer_between_two_checks_than_a_free_motion_is_proven_to(
    robot: RobotDescription,
) -> None:
    """Dense samples against the proof: of what passes none is nearer than stated, what is refused has one."""
    random, distances = np.random.default_rng(SEED), Distances()
    verdicts = {True: 0, False: 0}
    for _ in range(80):
        count = int(random.integers(2, 5))
        times = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 3.0, count - 1))])
        home = np.array(robot.positions["work"].joints)
        values = [offset + random.uniform(-0.8, 0.8, (count, 7)) for offset in (home, 0.0, 0.0)]
        motion = from_hermite(times, *values)
        samples = motion.sample(np.linspace(0.0, motion.duration_s, 300))
        nearest_m = min(distances.smallest(joints) for joints in samples)
        try:
            robot.collision.check_trajectory(motion)
        except CollisionError as exc:
            time_s = float(str(exc).split("(")[1].split(" s")[0])
            near = [motion.sample([time_s + offset])[0] for offset in (-0.006, 0.0, 0.006)]
            assert min(distances.smallest(joints) for joints in near) < robot.collision.margin_m
            verdicts[False] += 1
        else:
            assert nearest_m >= robot.collision.margin_m - RESOLUTION_M
            verdicts[True] += 1
    assert min(verdicts.values()) > 10, verdicts


def test_both_ends_of_a_motion_are_looked_at(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    for first, last in ((home, IN_THE_FLOOR), (IN_THE_FLOOR, home), (IN_THE_FLOOR, IN_THE_FLOOR)):
        with pytest.raises(CollisionError, match=r"collision of floor and link\d"):
            robot.collision.check_trajectory(rest_to_rest(first, last))


def test_a_motion_too_long_to_be_checked_is_refused_with_its_length(robot: RobotDescription) -> None:
    far = rest_to_rest(np.zeros(7), np.full(7, 1e6))
    with pytest.raises(InputError, match=r"the motion travels .* rad, but only 20000 rad can be checked"):
        robot.collision.check_trajectory(far)


def test_a_position_in_collision_is_refused_under_the_name_it_was_given(robot: RobotDescription) -> None:
    with pytest.raises(CollisionError, match=r"^the goal is in collision: floor and link\d at -\d+ mm, at "):
        robot.collision.check_position(ON_THE_BASE, "the goal")
    robot.collision.check_position(np.array(robot.positions["home"].joints), "home")


def test_a_twin_has_the_same_distances_in_a_memory_of_its_own(robot: RobotDescription) -> None:
    ball = SceneObject("sphere", (0.1,), (0.5, 0.2, 0.5, 1.0, 0.0, 0.0, 0.0))
    checker = robot.collision.among(Scene(version=1, objects={"ball": ball}))
    twin, rows = checker.twin(), np.random.default_rng(4).uniform(-1.5, 1.5, (50, robot.limits.dof))
    before = checker.clearance.distances(rows, 1.0)
    twin.clearance.distances(rows[::-1], 1.0)
    with twin.keeping(0.2):
        np.testing.assert_array_equal(checker.clearance.distances(rows, 1.0), before)
        assert [checker.is_free(row) for row in rows] == list((before >= checker.margin_m).all(axis=1))
    np.testing.assert_array_equal(twin.clearance.distances(rows, 1.0), before)
    assert (twin.pairs, twin.scene, twin.tool) == (checker.pairs, checker.scene, checker.tool)
    assert twin.clearance is not checker.clearance


def test_a_motion_that_passed_is_proven_again_only_after_a_change_around_the_arm(
    robot: RobotDescription,
) -> None:
    """The oracle is the number of configurations that the proof looks at, and a box in the way."""
    collision = robot.collision.among(Scene())
    ends = np.zeros((2, 7))
    ends[1, 0] = 1.0
    motion = rest_to_rest(*ends)
    collision.check_trajectory(motion)
    looks = collision.clearance.evaluations
    collision.check_trajectory(replace(motion, note="the same motion"))
    assert collision.clearance.evaluations == looks
    collision.check_trajectory(rest_to_rest(*ends))
    assert collision.clearance.evaluations > looks, "another motion, though an equal one"
    collision.check_trajectory(motion)
    with collision.keeping(0.02):
        looks = collision.clearance.evaluations
        collision.check_trajectory(motion)
        assert collision.clearance.evaluations > looks, "another required distance"
    tip = robot.model.poses(motion.sample([1.0]))[0, :3]
    collision.surround(
        Scene(version=1, objects={"box": SceneObject("box", (0.1, 0.1, 0.1), (*tip, 1.0, 0.0, 0.0, 0.0))})
    )
    with pytest.raises(CollisionError, match="box"):
        collision.check_trajectory(motion)
