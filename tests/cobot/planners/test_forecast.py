"""What a forecast says of a motion.

Oracles: MuJoCo's mj_geomDistance on dense samples, for all pairs that its own rules let collide; pinocchio's
inverse dynamics on dense samples; differences of dense samples for the rates.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio
import pytest
from cobot_run import WAIT_S
from independent_models import MJCF, largest_rates, second_robot

from cobot.motions.forecast import Closest, Forecast
from cobot.motions.requests import MotionRequest
from cobot.planners.forecast import forecast
from cobot.robot.collision import geom_pairs
from cobot.robot.description import RobotDescription
from cobot.robot.nearest import FARTHEST_M, NearestParts
from cobot.robot.scene import Scene, SceneObject
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Scaling

DENSE = 1000
MIN_M = 2e-3
"""Between two of the forecast's 200 looks at a fast motion nothing comes nearer by more than this."""


def free(robot: RobotDescription, random: np.random.Generator) -> Array:
    while True:
        joints = random.uniform(robot.limits.min_position, robot.limits.max_position)
        if robot.collision.is_free(joints):
            return np.asarray(joints)


@pytest.fixture(scope="module")
def forecasts(robot: RobotDescription) -> list[tuple[Forecast, Trajectory]]:
    """Some full-speed motions between random joint angles."""
    random, made = np.random.default_rng(61), []
    while len(made) < 4:
        request = MotionRequest(
            free(robot, random), free(robot, random), PlannerName.AUTO, Scaling(1.0), timeout_s=WAIT_S
        )
        found = forecast(robot, request, 2)
        assert found.trajectory is not None
        made.append((found, found.trajectory))
    return made


def dense(trajectory: Trajectory) -> Array:
    return np.linspace(0.0, trajectory.duration_s, DENSE)


def distances(model: mujoco.MjModel, rows: Array, pairs: list[tuple[int, int]]) -> Array:
    """Of each pair at each row, shape (n, pairs), m; `FARTHEST_M` if it is more."""
    data = mujoco.MjData(model)
    found = np.empty((len(rows), len(pairs)))
    for row, joints in zip(found, rows, strict=True):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        row[:] = [mujoco.mj_geomDistance(model, data, *pair, FARTHEST_M, None) for pair in pairs]
    return found


def test_the_closest_distances_are_those_of_mujoco(
    robot: RobotDescription, forecasts: list[tuple[Forecast, Trajectory]]
) -> None:
    model = mujoco.MjModel.from_xml_path(str(MJCF))
    pairs = geom_pairs(model)
    drawn = np.random.default_rng(62).uniform(*model.jnt_range.T, (20, model.nq))
    spread = np.ptp(distances(model, drawn, pairs), axis=0)
    assert (spread < 1e-9).sum() == 1, "the first link turns over the floor"
    pairs = [pair for pair, changes in zip(pairs, spread > 1e-9, strict=True) if changes]
    world = [0 in (model.geom_bodyid[first], model.geom_bodyid[second]) for first, second in pairs]
    for found, trajectory in forecasts:
        times = dense(trajectory)
        all_m = distances(model, trajectory.sample(times), pairs)
        for closest, of_world in ((found.closest_self, False), (found.closest_environment, True)):
            chosen = [column for column, is_world in enumerate(world) if is_world == of_world]
            least_m = float(all_m[:, chosen].min())
            assert closest is not None
            assert least_m - 1e-5 <= closest.distance_m <= least_m + MIN_M
            there = trajectory.sample([closest.share * trajectory.duration_s])
            here = distances(model, there, [pairs[column] for column in chosen])[0]
            assert closest.distance_m == pytest.approx(here.min(), abs=1e-5)
            assert named(model, pairs[chosen[int(here.argmin())]], closest)


def test_the_nearest_parts_are_found_near_and_far(robot: RobotDescription) -> None:
    """Near parts are looked for first. Oracle: all of MuJoCo's distances."""
    model = mujoco.MjModel.from_xml_path(str(MJCF))
    nearest, pairs = robot.collision.nearest, geom_pairs(model)
    world = np.array([0 in (model.geom_bodyid[first], model.geom_bodyid[second]) for first, second in pairs])
    drawn = np.random.default_rng(64).uniform(*model.jnt_range.T, (400, model.nq))
    changes = np.ptp(distances(model, drawn[:20], pairs), axis=0) > 1e-9
    kinds = set()
    for joints in drawn[robot.collision.clearance.are_free(drawn)][:40]:
        all_m = distances(model, joints[None], pairs)[0]
        for found, chosen in zip(nearest.at(joints), (~world & changes, world & changes), strict=True):
            assert found is not None
            assert found.distance_m == pytest.approx(all_m[chosen].min(), abs=1e-5)
            kinds.add(found.distance_m < 0.1)
    assert kinds == {True, False}


def named(model: mujoco.MjModel, pair: tuple[int, int], closest: Closest) -> bool:
    names = {
        model.body(body).name if (body := int(model.geom_bodyid[geom])) else model.geom(geom).name
        for geom in pair
    }
    return names == {closest.first, closest.second}


def test_a_large_scene_is_looked_through_once_for_each_joint(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once for each object took half a second with 200 of them, in the service's event loop."""
    objects = {
        f"box {n}": SceneObject("box", (0.05, 0.05, 0.05), (1.0 + n, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0))
        for n in range(40)
    }
    checker = robot.collision.among(Scene(1, objects))
    looks, distances = [], NearestParts.distances

    def count(self: NearestParts, rows: Array) -> Array:
        looks.append(len(rows))
        return distances(self, rows)

    monkeypatch.setattr(NearestParts, "distances", count)
    assert checker.nearest is not None
    assert 0 < len(looks) <= robot.limits.dof


def test_torque_peaks_are_those_of_pinocchio(forecasts: list[tuple[Forecast, Trajectory]]) -> None:
    other = second_robot()
    for found, trajectory in forecasts:
        times = dense(trajectory)
        peaks = np.zeros(trajectory.dof)
        for joints, velocity, acceleration in zip(
            *(trajectory.sample(times, derivative) for derivative in range(3)), strict=True
        ):
            bias = pinocchio.nonLinearEffects(other.model, other.data, joints, velocity)
            torque = other.mass_matrix(joints) @ acceleration + bias
            peaks = np.maximum(peaks, np.abs(torque))
        # The forecast looks every 20 ms and at all knots: between them a peak may be a little higher.
        np.testing.assert_allclose(found.peaks["torque"], peaks, rtol=0.02, atol=0.05)


def test_rates_are_true_extrema_and_shares_are_of_the_robots_limits(
    robot: RobotDescription, forecasts: list[tuple[Forecast, Trajectory]]
) -> None:
    limits = robot.limits
    for found, trajectory in forecasts:
        rates = largest_rates(trajectory)
        for order, name in enumerate(("velocity", "acceleration", "jerk")):
            assert (found.peaks[name] >= rates[order] * (1.0 - 1e-6) - 1e-6).all()
            np.testing.assert_allclose(found.peaks[name], rates[order], rtol=0.05, atol=0.02)
        np.testing.assert_allclose(
            found.utilisation["velocity"], found.peaks["velocity"] / limits.max_velocity
        )
        np.testing.assert_allclose(found.utilisation["torque"], found.peaks["torque"] / limits.max_effort)
