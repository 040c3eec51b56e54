"""Distances between geoms. Oracle: MuJoCo's."""

from __future__ import annotations

from itertools import combinations

import mujoco
import numpy as np
import pytest

from cobot.robot.collision import geom_pairs
from cobot.robot.description import RobotDescription
from cobot.robot.distances import GeomDistances
from cobot.types import Array

SCENE = """<mujoco>
<asset><mesh name="cube" vertex="0 0 0  .2 0 0  0 .2 0  0 0 .2  .2 .2 0  .2 0 .2  0 .2 .2  .2 .2 .2"/></asset>
<worldbody>
<geom type="plane" size="1 1 1" pos="0 0 -.3" quat="1 .1 .2 0"/>
<geom type="box" size=".1 .2 .3" pos=".5 .4 .1" quat="1 .5 .2 .3"/>
<geom type="sphere" size=".2" pos="-.5 .4 .1"/>
{arm}
</worldbody></mujoco>"""
LINKS = (
    'type="capsule" size=".05 .1"',
    'type="sphere" size=".07"',
    'type="capsule" size=".02 .3"',
    'type="cylinder" size=".05 .1"',
    'type="ellipsoid" size=".05 .1 .07"',
    'type="mesh" mesh="cube"',
    'type="cylinder" size=".2 .01"',
    'type="box" size=".05 .1 .02"',
)


def scene() -> mujoco.MjModel:
    random = np.random.default_rng(4)
    arm = ""
    for link in LINKS:
        pos, quat, axis = random.uniform(-0.2, 0.2, 3), random.normal(size=4), random.normal(size=3)
        arm += '<body pos="{} {} {}" quat="{} {} {} {}"><joint axis="{} {} {}"/>'.format(*pos, *quat, *axis)
        arm += f'<geom {link} pos=".1 0 0"/>'
    return mujoco.MjModel.from_xml_string(SCENE.format(arm=arm + "</body>" * len(LINKS)))


def by_mujoco(
    mj: mujoco.MjModel, data: mujoco.MjData, pairs: list[tuple[int, int]], farthest_m: float
) -> Array:
    return np.array([mujoco.mj_geomDistance(mj, data, *pair, farthest_m, None) for pair in pairs])


@pytest.mark.parametrize("farthest_m", [0.12, 5.0])
def test_distances_of_all_shapes_are_those_of_mujoco(farthest_m: float) -> None:
    mj = scene()
    data = mujoco.MjData(mj)
    pairs = [pair for pair in combinations(range(mj.ngeom), 2) if pair != (0, 1)]
    pairs += [pair[::-1] for pair in pairs[::5]]
    distances = GeomDistances(mj, len(pairs), farthest_m)
    own_m = np.random.default_rng(5).uniform(0.0, farthest_m, len(pairs))
    distances.watch(pairs, own_m.tolist())
    for joints in np.random.default_rng(6).uniform(-3.0, 3.0, (1000, mj.nq)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        expected = np.minimum(by_mujoco(mj, data, pairs, farthest_m), own_m)
        assert abs(distances.find(joints) - expected).max() < 1e-12, joints


def test_distances_of_the_shipped_arm_are_those_of_mujoco(robot: RobotDescription) -> None:
    mj, data = robot.model.mj, mujoco.MjData(robot.model.mj)
    pairs = geom_pairs(mj)
    distances = GeomDistances(mj, len(pairs), 0.12)
    distances.watch(pairs)
    for joints in np.random.default_rng(7).uniform(-3.0, 3.0, (5000, mj.nq)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        assert abs(distances.find(joints) - by_mujoco(mj, data, pairs, 0.12)).max() < 1e-12, joints


def test_capsules_in_line_side_by_side_and_through_each_other_are_those_of_mujoco() -> None:
    """Where the formula has no unique solution. MuJoCo takes what is 1e-8 rad from parallel for parallel."""
    text = """<mujoco><worldbody><geom type="capsule" size=".1 .3"/>
    <body pos="{} {} {}" euler="{} {} 0"><joint/><geom type="capsule" size=".05 .2"/></body>
    </worldbody></mujoco>"""
    places = [(0, 0, 0), (0, 0, 1), (0.4, 0, 0), (0.4, 0, 0.3), (0.4, 0, 0.7), (0.4, 0, -0.7)]
    turns = [(0, 0), (180, 0), (90, 0), (0, 1e-6), (1e-7, 1e-7)]
    for place in places:
        for turn in turns:
            mj = mujoco.MjModel.from_xml_string(text.format(*place, *turn))
            data = mujoco.MjData(mj)
            mujoco.mj_kinematics(mj, data)
            distances = GeomDistances(mj, 1, 5.0)
            distances.watch([(0, 1)])
            expected = by_mujoco(mj, data, [(0, 1)], 5.0)
            tolerance = 1e-8 if 0.0 < max(turn) < 1.0 else 1e-12
            assert abs(distances.find(np.zeros(1)) - expected) < tolerance, (place, turn)


def test_joints_that_are_not_finite_and_geoms_that_are_not_there_are_refused() -> None:
    mj = scene()
    distances = GeomDistances(mj, 1, 1.0)
    with pytest.raises(ValueError, match="not finite"):
        distances.find(np.full(mj.nq, np.nan))
    with pytest.raises(ValueError, match="no geoms 0 and 99"):
        distances.watch([(0, 99)])
    with pytest.raises(ValueError, match="2 pairs of geoms, allowed: up to 1"):
        distances.watch([(0, 2), (0, 3)])
    assert distances.count == 0
