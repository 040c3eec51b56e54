"""Streams that lead the arm into itself, driven at random. Oracle: MuJoCo's own distances at each commanded
position."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Interpolation
from cobot.robot.collision import geom_pairs
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.streaming.collision_monitor import CollisionMonitor

CYCLES, EVERY, CHANGE_CYCLES = 2000, 10, 500


def nearest_m(robot: RobotDescription, rows: Array) -> float:
    """The smallest distance between any two parts that may collide."""
    mj = robot.model.mj
    data, pairs, found = mujoco.MjData(mj), geom_pairs(mj), np.inf
    for row in rows:
        data.qpos[:] = row
        mujoco.mj_kinematics(mj, data)
        found = min(found, *(mujoco.mj_geomDistance(mj, data, *pair, 0.1, None) for pair in pairs))
    return float(found)


def blocked_place(robot: RobotDescription, random: np.random.Generator) -> Array:
    """Where two parts of the arm overlap."""
    limits = robot.limits
    while True:
        place = random.uniform(limits.min_position, limits.max_position)
        if any("floor" not in (each.first, each.second) for each in robot.collision.contacts(place)):
            return place


@pytest.mark.parametrize("kind", Interpolation)
@pytest.mark.parametrize("seed", [1, 2])
def test_no_stream_at_any_speed_brings_two_parts_nearer_than_the_margin(
    settings: Settings, robot: RobotDescription, kind: Interpolation, seed: int
) -> None:
    random, rig = np.random.default_rng([seed, kind]), Rig(settings, robot)
    fastest = np.minimum(robot.limits.max_velocity, settings.streaming.joint_velocity)
    assert rig.stream(interpolation=kind, decimation=EVERY) == ""
    target = rig.home
    for cycle in range(CYCLES):
        if cycle % CHANGE_CYCLES == 0:
            goal, speed = blocked_place(robot, random), random.uniform(0.2, 0.95) * fastest
        if cycle % EVERY == 0:
            step = speed * EVERY * settings.rt.period_s
            target = target + np.clip(goal - target, -step, step)
            rig.aim(joints=target)
        rig.step()
    rows = np.array(rig.commanded)
    rig.close()
    assert rig.counted().get("COLLISION", 0) > 0, "no stream was held, so the test says nothing"
    assert nearest_m(robot, rows[::4]) >= settings.streaming.collision_margin_m


def test_links_that_pass_closely_do_not_slow_a_stream(settings: Settings, robot: RobotDescription) -> None:
    """Nor does the base that they pass: only links whose stopping way takes more than half of their room."""
    section, limits, mj = settings.streaming, robot.limits, robot.model.mj
    monitor, random = CollisionMonitor(robot.model, section, limits), np.random.default_rng(3)
    monitor.begin(touching=False)
    pairs, data = geom_pairs(mj), mujoco.MjData(mj)
    of_floor = np.array([mj.geom("floor").id in pair for pair in pairs])
    passed = 0
    for _ in range(300):
        joints = random.uniform(limits.min_position, limits.max_position)
        velocity = random.uniform(-0.3, 0.3, limits.dof)
        stopping_s = np.abs(velocity) / (2.0 * limits.max_acceleration)
        stopping_s += limits.max_acceleration / limits.max_jerk
        found = []
        for row in (joints, joints + velocity * stopping_s):
            data.qpos[:] = row
            mujoco.mj_kinematics(mj, data)
            found.append([mujoco.mj_geomDistance(mj, data, *pair, 1.0, None) for pair in pairs])
        here, there = np.array(found)
        room_m = here - section.collision_margin_m
        if room_m.min() <= 0.0 or there[of_floor].min() < section.collision_margin_m + section.slow_down_m:
            continue
        if ((here - there) / room_m)[~of_floor].max() > 0.5:
            continue
        for _ in range(4):
            monitor.look(np.array([joints, velocity, 0.0 * joints]))
        assert monitor.share == 1.0
        passed += 1
    assert passed > 30
